"""A pickle read as data: what it would import or call is named, and nothing is imported or called.

Purpose: the opcodes that Stable-Baselines3, torch and NumPy write become plain values, and a
`Made` for everything that a pickle makes with a class or a function. Arrays are built from the
bytes that the pickle holds.
Non-goals: opcodes of protocols 0 and 1 that none of the three writes; objects with code.
"""

from __future__ import annotations

import pickletools
import warnings
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

OPERATIONS_MAX = 200_000
DTYPES = ("f4", "f8", "i4", "i8", "b1", "u1", "u4", "u8")
PLAIN = frozenset(
    {"BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT", "NONE", "NEWTRUE", "NEWFALSE"}
    | {"BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8"}
    | {"BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8"}
)
"""Opcodes whose argument is the value."""
TUPLES = {"EMPTY_TUPLE": 0, "TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}


class PickleError(ValueError):
    """Reports bytes that are no pickle, or that have unsupported opcodes."""


@dataclass(frozen=True)
class Name:
    """The module and name of a class or function, which is not imported."""

    text: str


@dataclass
class Made:
    """A value that a pickle makes by a call: the name of the called object, and the arguments."""

    name: str
    arguments: tuple[Any, ...]
    state: Any = None
    items: dict[str, Any] = field(default_factory=dict)
    """The entries of a mapping, those whose keys are texts."""


@dataclass(frozen=True)
class Persistent:
    """A value that is stored outside of the pickle; `about` is its identifier in the pickle."""

    about: Any


class _Mark:
    """The mark at which the parts of a tuple, list or dict begin."""


def read_pickle(data: bytes) -> Any:  # noqa: ANN401 - whatever it holds
    """The value in a pickle; raises PickleError if a part of it is not supported."""
    machine = _Machine()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of names that have an odd escape
            for opcode, argument, _ in islice(pickletools.genops(data), OPERATIONS_MAX):
                machine.run_opcode(opcode.name, argument)
    except PickleError:
        raise
    except (ValueError, IndexError, KeyError, TypeError, OverflowError, MemoryError) as error:
        raise PickleError(f"it is no pickle: {str(error)[:100]}") from error
    if not machine.ended:
        raise PickleError(f"it has more than {OPERATIONS_MAX:,} opcodes")
    return machine.result


class _Machine:
    """The stack machine that runs a pickle's opcodes on data."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.memo: dict[int, Any] = {}
        self.result: Any = None
        self.ended = False

    def run_opcode(self, name: str, argument: Any) -> None:  # noqa: ANN401 - as the opcode has it
        """Executes one opcode."""
        stack = self.stack
        if name in PLAIN:
            stack.append(_constant_value(name, argument))
        elif name in {"PROTO", "FRAME"}:
            pass
        elif name == "MEMOIZE":
            self.memo[len(self.memo)] = stack[-1]
        elif name in {"BINPUT", "LONG_BINPUT"}:
            self.memo[argument] = stack[-1]
        elif name in {"BINGET", "LONG_BINGET"}:
            stack.append(self.memo[argument])
        elif name == "MARK":
            stack.append(_Mark)
        elif name == "STOP":
            self.result, self.ended = stack.pop(), True
        else:
            self._push_composed(name, argument)

    def _push_composed(self, name: str, argument: Any) -> None:  # noqa: ANN401 - as above
        stack = self.stack
        if name == "EMPTY_DICT":
            stack.append({})
        elif name == "EMPTY_LIST":
            stack.append([])
        elif name in TUPLES:
            at = len(stack) - TUPLES[name]
            if at < 0:
                raise PickleError("it is no pickle: a tuple of what is not there")
            stack[at:] = [tuple(stack[at:])]
        elif name == "TUPLE":
            stack.append(tuple(self._pop_to_mark()))
        elif name == "APPEND":
            self._extend_list([stack.pop()])
        elif name == "APPENDS":
            self._extend_list(self._pop_to_mark())
        elif name == "SETITEM":
            value = stack.pop()
            self._enter_items([stack.pop(), value])
        elif name == "SETITEMS":
            self._enter_items(self._pop_to_mark())
        else:
            self._push_made(name, argument)

    def _push_made(self, name: str, argument: Any) -> None:  # noqa: ANN401 - as above
        stack = self.stack
        if name == "GLOBAL":
            stack.append(Name(argument.replace(" ", ".", 1)))
        elif name == "STACK_GLOBAL":
            local, module = stack.pop(), stack.pop()
            stack.append(Name(f"{module}.{local}"))
        elif name in {"REDUCE", "NEWOBJ"}:
            arguments, called = stack.pop(), stack.pop()
            if not isinstance(called, Name) or not isinstance(arguments, tuple):
                raise PickleError("it calls what is no named class or function")
            stack.append(Made(called.text, arguments))
        elif name == "BUILD":
            state = stack.pop()
            if not isinstance(stack[-1], Made):
                raise PickleError("it sets the state of what has none")
            stack[-1].state = state
        elif name == "BINPERSID":
            stack.append(Persistent(stack.pop()))
        else:
            raise PickleError(f"it has the opcode {name}, which is not read here")

    def _pop_to_mark(self) -> list[Any]:
        """Pops the values above the last mark, and the mark itself."""
        at = max(i for i, x in enumerate(self.stack) if x is _Mark)
        parts = self.stack[at + 1 :]
        del self.stack[at:]
        return parts

    def _extend_list(self, parts: list[Any]) -> None:
        if isinstance(self.stack[-1], list):
            self.stack[-1].extend(parts)
        elif not isinstance(self.stack[-1], Made):
            raise PickleError("it appends to what is no list")

    def _enter_items(self, parts: list[Any]) -> None:
        target = self.stack[-1]
        entries = target.items if isinstance(target, Made) else target
        if not isinstance(entries, dict):
            raise PickleError("it sets items of what is no dict")
        for key, value in zip(parts[::2], parts[1::2], strict=True):
            if isinstance(key, str):  # no reader looks up a key of another type
                entries[key] = value


def _constant_value(name: str, argument: Any) -> Any:  # noqa: ANN401 - as above
    if name in {"NONE", "NEWTRUE", "NEWFALSE"}:
        return {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}[name]
    return bytes(argument) if name == "BYTEARRAY8" else argument


# ---------------------------------------------------------------- NumPy's arrays


def read_array(value: Any) -> npt.NDArray[Any]:  # noqa: ANN401 - whatever it holds
    """The array in a pickle, in its shape, little-endian; raises PickleError if it has no array."""
    made = value if isinstance(value, Made) else Made("", ())
    shape: Any = ()
    order: Any = "C"
    try:
        if made.name.endswith("._reconstruct"):
            _, shape, dtype, fortran, data = made.state
            order = "F" if fortran else "C"
        elif made.name.endswith("._frombuffer"):
            data, dtype, shape, order = made.arguments
        else:  # a scalar of NumPy's, or nothing of the kind
            dtype, data = made.arguments
        flat: npt.NDArray[Any] = np.frombuffer(data, read_dtype(dtype))
        shaped: npt.NDArray[Any] = flat.reshape(shape, order=order)
    except (TypeError, ValueError) as error:
        raise PickleError(f"there is no array where one belongs: {error}") from error
    return shaped


def read_dtype(value: Any) -> np.dtype[Any]:  # noqa: ANN401 - whatever it holds
    """The NumPy type that a pickle names; raises PickleError unless it is one of `DTYPES`."""
    if isinstance(value, Made) and value.name == "numpy.dtype" and value.arguments:
        text, state = value.arguments[0], value.state
        big = isinstance(state, tuple) and len(state) > 1 and state[1] == ">"
        if isinstance(text, str) and text in DTYPES and not big:
            return np.dtype(text)
    raise PickleError("its numbers are of a kind that is not read here")

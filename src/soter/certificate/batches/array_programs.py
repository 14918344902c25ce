"""Functions of many forms, compiled to programs that C runs (`soter_array_program.c`).

Purpose: `ArrayFunction`: calls a function of arrays of balls with NumPy at first, then as what was
recorded of it (`recorded_arrays.py`), with the same numbers, bit for bit.
Non-goals: what has to be so of balls. Without a C compiler, and where a function cannot be
recorded, NumPy does all.

The first call is NumPy's; at the second one the function is recorded, and C makes the first once
more: where any number is another one, C is not asked again.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.batches.ball_arrays import BallArray, no_underflow
from soter.certificate.batches.recorded_arrays import (
    COPY,
    REFUSED,
    RecordedArray,
    RecordedBits,
    Recording,
)
from soter.diagnostics.diagnostic import SoterError
from soter.native.build import CHECK_FAILED, include_flags
from soter.native.compiler import STRICT, find
from soter.native.vector_instructions import vector_flags

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from soter.certificate.batches.ball_arrays import Floats
    from soter.certificate.batches.form_arrays import Forms

    Function = Callable[[Forms], Any]

HERE = Path(__file__).resolve().parent
SOURCE = HERE / "soter_array_program.c"
FLAGS = (*STRICT, "-O2", "-ftree-vectorize", "-fPIC", "-shared")
WIDE, ROWS_MAX = 64, 16384
"""As in the C file."""
NO_RADIUS = np.zeros(1)


class _Record(ctypes.Structure):
    """As `soter_array_program`."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("all", "constants")),
        *((name, ctypes.c_int32) for name in ("operations", "inputs", "outputs", "between")),
    )


class _Library:
    """The library, compiled from the package's source for this process and its children alone.

    Nothing that was compiled before is loaded: whoever can write into a cache could accept.
    """

    def __init__(self) -> None:
        self._work: TemporaryDirectory[str] | None = None
        self._compiling: subprocess.Popen[bytes] | None = None
        self._function: Any = None
        self._told = False
        """Whether it is known if there is one."""
        self._owner = 0
        """The process that has it compiled."""

    def begin(self) -> None:
        """Have it compiled while this process goes on."""
        if self._work is not None or self._told:
            return
        try:
            compiler = find()
        except SoterError:  # there is none
            self._told = True
            return
        self._work = TemporaryDirectory(prefix="soter-recheck-")
        flags = (*FLAGS, *vector_flags(), *include_flags(SOURCE))
        files = (str(SOURCE), str(CHECK_FAILED), "-o", self._at, "-lm")
        self._owner = os.getpid()
        self._compiling = subprocess.Popen(
            (*compiler.command, *flags, *files),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    @property
    def _at(self) -> str:
        assert self._work is not None
        return str(Path(self._work.name) / "arrays.so")

    def function(self) -> Any:  # noqa: ANN401  of ctypes
        """`soter_array_run`; None where it could not be made, or was not before a fork."""
        self.begin()
        if self._owner not in (0, os.getpid()) and not self._told:
            return None
        if not self._told:
            self._told = True
            assert self._compiling is not None
            if self._compiling.wait() == 0:
                with suppress(OSError, AttributeError):
                    self._function = ctypes.CDLL(self._at).soter_array_run
                    at = ctypes.c_void_p
                    self._function.argtypes = (at, ctypes.c_int64, at, at, at)
            self.end()
        return self._function

    def end(self) -> None:
        """What is compiled still is not waited for; what is loaded stays."""
        if self._owner != os.getpid():
            return
        if self._compiling is not None:
            self._compiling.kill()
            self._compiling.wait()
        if self._work is not None:
            self._work.cleanup()
        self._compiling = self._work = None


LIBRARY = _Library()


@dataclass(frozen=True, eq=False)
class Program:
    """Operations as rows (code, to, a, b, c), and what is made of the outputs' rows."""

    operations: NDArray[np.int32]
    constants: Floats
    inputs: int
    outputs: int
    between: int
    template: Any
    """As the function gives it, with recorded arrays for what differs from column to column."""
    row_of: dict[int, int]
    """Recorded value -> row of the outputs."""

    @cached_property
    def _as_c(self) -> _Record:
        at = self.operations.ctypes.data, self.constants.ctypes.data
        return _Record(*at, len(self.operations), self.inputs, self.outputs, self.between)

    def run(self, arrays: list[Floats], columns: int) -> Any:  # noqa: ANN401  as the function has it
        """What the function gives of rows (columns,), none of them strided.

        FloatingPointError where something underflows.
        """
        function = LIBRARY.function()
        assert function is not None
        out = np.empty((self.outputs, columns))
        scratch = np.empty(max(self.between, 1) * WIDE)
        at = np.array([a.__array_interface__["data"][0] for a in arrays], dtype=np.uint64)
        record, data = ctypes.byref(self._as_c), at.ctypes.data
        failed = function(record, columns, data, out.ctypes.data, scratch.ctypes.data)
        assert failed >= 0, "a program has no more rows than C knows"
        if failed:
            raise FloatingPointError("underflow")
        return self._filled(self.template, out)

    def _filled(self, x: Any, out: Floats) -> Any:  # noqa: ANN401  the template, or part of it
        if isinstance(x, (tuple, list)):
            return tuple(self._filled(y, out) for y in x)
        if isinstance(x, RecordedBits):
            fail, hold = (self._filled(y, out) for y in (x.may_fail, x.may_hold))
            return np.asarray(fail + 2 * np.asarray(hold, dtype=np.uint8), dtype=np.uint8)
        if isinstance(x, RecordedArray):
            row = out[self.row_of[x.value]]
            return row != 0 if x.is_truth else row
        if isinstance(x, BallArray):
            centre = self._filled(x.centre, out)
            if x.radius is None:
                return BallArray(centre)
            radius = self._filled(x.radius, out)
            if centre.shape != radius.shape:
                centre, radius = np.broadcast_arrays(centre, radius)
            return BallArray(centre, radius)
        return x[:1] if isinstance(x, np.ndarray) else x  # the same for all boxes


def record(function: Function, length: int) -> Program | None:
    """The program of a function of forms of so many balls; None where it cannot be recorded."""
    recording = Recording(2 * length)
    values: list[Any] = [RecordedArray(recording, k) for k in range(2 * length)]
    form = tuple(BallArray(c, r) for c, r in zip(values[::2], values[1::2], strict=True))
    try:
        with no_underflow():
            template = function(form)
    except REFUSED:
        return None
    return _program(recording, template)


def _recorded(x: Any) -> Iterator[RecordedArray]:  # noqa: ANN401  a template, or part of it
    if isinstance(x, (tuple, list)):
        for y in x:
            yield from _recorded(y)
    elif isinstance(x, RecordedArray):
        yield x
    elif isinstance(x, BallArray):
        yield from _recorded((x.centre, x.radius))
    elif isinstance(x, RecordedBits):
        yield from _recorded((x.may_fail, x.may_hold))


def _program(recording: Recording, template: Any) -> Program | None:  # noqa: ANN401  of a function
    """What of the operations is needed, each value in a row that nobody needs any more."""
    inputs, all_operations = recording.inputs, recording.operations
    wanted = list(dict.fromkeys(x.value for x in _recorded(template)))
    row_of = {v: i for i, v in enumerate(wanted)}
    last = dict.fromkeys(wanted, len(all_operations))
    """Of each value that is needed the last operation that needs it."""
    for k in range(len(all_operations) - 1, -1, -1):
        if inputs + k in last:
            for v in all_operations[k][1:]:
                if v not in last:
                    last[v] = k
    row = {v: v for v in range(inputs)}
    free: list[int] = []
    first = following = inputs + len(wanted)
    operations = []
    for k, (code, *operands) in enumerate(all_operations):
        value = inputs + k
        if value not in last:
            continue
        at = [row[v] if v >= 0 else v for v in operands]
        if value in row_of:
            to = inputs + row_of[value]
        elif free:
            to = free.pop()
        else:
            to, following = following, following + 1
        row[value] = to
        operations.append((code, to, *at))
        free += {y for v, y in zip(operands, at, strict=True) if y >= first and last[v] == k}
    as_they_are = [v for v in wanted if v < inputs]
    operations += [(COPY, inputs + row_of[v], v, v, v) for v in as_they_are]
    if following > ROWS_MAX:
        return None
    return Program(
        np.array(operations, dtype=np.int32).reshape(-1, 5),
        np.array(recording.constants or [0.0]),
        inputs,
        len(wanted),
        following - first,
        template,
        row_of,
    )


class ArrayFunction:
    """A function of forms of arrays of balls; `recorded` makes the same, to be recorded."""

    def __init__(self, function: Function, recorded: Callable[[], Function]) -> None:
        self._function, self._recorded = function, recorded
        self._first: tuple[Forms, int, Any] | None = None
        """The first form, its columns, and what NumPy gave."""
        self._program: Program | None = None
        self._prepared: Program | None = None
        self._tried = False

    def prepare(self, length: int) -> None:
        """Record it now, of forms of so many balls: whoever is forked later has it."""
        if not self._tried and self._prepared is None:
            self._prepared = record(self._recorded(), length)

    def __call__(self, form: Forms) -> Any:  # noqa: ANN401  as the function has it
        """What the function gives, by a program where there is one."""
        columns = max((x.centre.size for x in form), default=1)
        if columns == 1:
            return self._function(form)
        if self._first is not None:
            self._program, self._first = self._checked(*self._first), None
        if self._program is not None:
            with suppress(FloatingPointError):  # a program takes both ways of a choice
                return self._program.run(_rows(form, columns), columns)
        result = self._function(form)
        if not self._tried:
            self._first, self._tried = (form, columns, result), True
        return result

    def _checked(self, form: Forms, columns: int, result: Any) -> Program | None:  # noqa: ANN401
        """The program, if there is one and it gives what NumPy gave."""
        if not LIBRARY.function():
            return None
        program = self._prepared or record(self._recorded(), len(form))
        if program is not None:
            with suppress(FloatingPointError):
                if same(program.run(_rows(form, columns), columns), result):
                    return program
        return None


def _rows(form: Forms, columns: int) -> list[Floats]:
    """Centres and radii, each with a number for every box."""
    return [
        x if x.size == columns and x.flags.c_contiguous else np.full(columns, x)
        for ball in form
        for x in (ball.centre, NO_RADIUS if ball.radius is None else ball.radius)
    ]


def same(one: Any, other: Any) -> bool:  # noqa: ANN401  results
    """Whether two results are the same numbers, bit for bit but for the sign of 0."""
    if isinstance(one, (tuple, list)):
        pairs = zip(one, other, strict=False)
        return len(one) == len(other) and all(same(x, y) for x, y in pairs)
    if isinstance(one, BallArray):
        radii = (NO_RADIUS if x.radius is None else x.radius for x in (one, other))
        return same(one.centre, other.centre) and same(*radii)
    x, y = np.broadcast_arrays(one, other)
    return np.array_equal(x, y, equal_nan=x.dtype.kind == "f")

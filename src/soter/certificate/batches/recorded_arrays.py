"""What a function of arrays does with each column, recorded as a straight line of operations.

Purpose: `record`: calls a function once with arrays that stand for any numbers, and keeps every
operation on them. A function that asks for a value (`if`, an index) is refused: so what is recorded
is what the function does, whatever the numbers are.
Non-goals: running it (`array_programs.py`); what is computed (`ball_arrays.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Operation = tuple[int, int, int, int]

MANY = 2
"""What a recorded array says that its length is: more than one."""
CODES = (
    *("add", "subtract", "multiply", "divide", "maximum", "minimum", "less", "less_equal", "equal"),
    *("negative", "absolute", "sqrt", "floor", "copy", "where"),
)
"""In the order of soter_array_program.c; the names of numpy."""
CODE_OF = {name: k for k, name in enumerate(CODES)}
COPY, WHERE = CODE_OF["copy"], CODE_OF["where"]
MOST, LEAST, EQUAL = CODE_OF["maximum"], CODE_OF["minimum"], CODE_OF["equal"]
COMPARED = {"less", "less_equal", "equal"}
SWAPPED = {"greater": "less", "greater_equal": "less_equal"}
REFUSED = (TypeError, ValueError, AttributeError, IndexError, KeyError, FloatingPointError)
"""What a function raises that cannot be recorded."""


@dataclass(eq=False)
class Recording:
    """The operations so far. An operand is the number of a value, or ~k for the kth constant.

    Values are first the inputs, then the results of the operations, one each.
    """

    inputs: int
    operations: list[Operation] = field(default_factory=list)
    constants: list[float] = field(default_factory=list)
    _results: dict[Operation, int] = field(default_factory=dict)
    _places: dict[tuple[float, float], int] = field(default_factory=dict)

    def result(self, operation: Operation) -> int:
        """Of a code and three operands; what was made already is not made again."""
        value = self._results.get(operation)
        if value is None:
            value = self._results[operation] = self.inputs + len(self.operations)
            self.operations.append(operation)
        return value

    def constant(self, x: float) -> int:
        """The operand that is this number."""
        key = x, math.copysign(1.0, x)
        if key not in self._places:
            self._places[key] = ~len(self.constants)
            self.constants.append(x)
        return self._places[key]

    def operand(self, x: Any, *, truth: bool) -> int:  # noqa: ANN401  of numpy
        """Of a recorded array, or of what is one number in all columns. TypeError for others."""
        if isinstance(x, RecordedArray):
            if x.recording is not self or x.is_truth != truth:
                raise TypeError("not an array of this kind")
            return x.value
        if type(x) is float and not truth and x == x:  # noqa: PLR0124  no NaN
            return self.constant(x)
        numbers = np.asarray(x)
        if (numbers.dtype.kind == "b") != truth or numbers.dtype.kind not in "bif":
            raise TypeError("not numbers of this kind")
        if numbers.size > 1:
            if any(numbers.strides) and (numbers != numbers.flat[0]).any():
                raise TypeError("more than one number")
            numbers = numbers.reshape(-1)[:1]
        number = float(numbers.item())
        if math.isnan(number):
            raise TypeError("no number")
        return self.constant(number)


def _operator(name: str, *, swapped: bool = False) -> Callable[..., RecordedArray]:
    """One of Python's operators on two arrays of numbers."""
    code, is_truth = CODE_OF[name], name in COMPARED

    def operator(self: RecordedArray, other: Any) -> RecordedArray:  # noqa: ANN401  of numpy
        r = self.recording
        a, b = self.value, r.operand(other, truth=False)
        if self.is_truth:
            raise TypeError("truths are no numbers")
        if swapped:
            a, b = b, a
        return RecordedArray(r, r.result((code, a, b, b)), is_truth)

    return operator


class RecordedArray(NDArrayOperatorsMixin):
    """A value of a recording, in place of an array of numbers or of truths."""

    __slots__ = ("is_truth", "recording", "value")
    shape, size, ndim = (MANY,), MANY, 1

    __add__ = __iadd__ = _operator("add")  # the usual ones, without the way through numpy
    __radd__ = _operator("add", swapped=True)
    __sub__ = _operator("subtract")
    __rsub__ = _operator("subtract", swapped=True)
    __mul__ = __imul__ = _operator("multiply")
    __rmul__ = _operator("multiply", swapped=True)
    __lt__, __le__ = _operator("less"), _operator("less_equal")
    __gt__, __ge__ = _operator("less", swapped=True), _operator("less_equal", swapped=True)

    def __init__(self, recording: Recording, value: int, is_truth: bool = False) -> None:
        self.recording, self.value, self.is_truth = recording, value, is_truth

    def __bool__(self) -> bool:
        raise TypeError("what a function does may not depend on a value")

    def any(self) -> bool:
        """Whether some may be true: what is done then has to be right whichever are."""
        return True

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *x: Any, **how: Any) -> Any:  # noqa: ANN401
        """One operation; `out` is another name for what it gives."""
        if method != "__call__" or how.keys() - {"out"}:
            return NotImplemented
        name = ufunc.__name__
        if name in SWAPPED:
            name, x = SWAPPED[name], x[::-1]
        if name in ("bitwise_and", "bitwise_or"):
            return self._made(
                LEAST if name == "bitwise_and" else MOST, x, of_truths=True, is_truth=True
            )
        if name == "invert":
            return self._negated()
        if name == "not_equal":
            return ~self._made(EQUAL, x, of_truths=False, is_truth=True)
        code = CODE_OF.get(name)
        if code is None:
            return NotImplemented
        return self._made(code, x, of_truths=False, is_truth=name in COMPARED)

    def _made(
        self, code: int, x: Sequence[Any], *, of_truths: bool, is_truth: bool
    ) -> RecordedArray:
        r = self.recording
        a = r.operand(x[0], truth=of_truths)
        b = a if len(x) == 1 else r.operand(x[1], truth=of_truths)
        return RecordedArray(r, r.result((code, a, b, b)), is_truth=is_truth)

    def _negated(self) -> RecordedArray:
        r, x = self.recording, self.recording.operand(self, truth=True)
        one = r.constant(1.0)
        value = r.result((CODE_OF["subtract"], one, x, x))
        return RecordedArray(r, value, is_truth=True)

    def __array_function__(
        self,
        function: Callable[..., Any],
        types: Any,  # noqa: ANN401
        x: Sequence[Any],
        how: dict[str, Any],
    ) -> Any:  # noqa: ANN401
        """The few functions of numpy that are no single operation."""
        del types
        if function is np.where and len(x) == len(("where", "one", "other")) and not how:
            return self._where(*x)
        if function is np.clip and len(x) == len(("x", "low", "high")) and not how:
            return np.minimum(np.maximum(x[0], x[1]), x[2])
        if function is np.broadcast_to and tuple(x[1]) == self.shape:
            return self
        if function is np.zeros_like and not how:
            return np.zeros(self.shape)
        return NotImplemented

    def _where(self, where: Any, one: Any, other: Any) -> Any:  # noqa: ANN401  of numpy
        r = self.recording
        if not isinstance(where, RecordedArray):  # the same everywhere
            return one if r.constants[~r.operand(where, truth=True)] else other
        truths = any(isinstance(x, RecordedArray) and x.is_truth for x in (one, other))
        condition = r.operand(where, truth=True)
        both = r.operand(one, truth=truths), r.operand(other, truth=truths)
        return RecordedArray(r, r.result((WHERE, condition, *both)), is_truth=truths)


class RecordedBits:
    """What is known of propositions, as bits: it may fail, it may hold."""

    __array_ufunc__ = None
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, may_fail: Any, may_hold: Any) -> None:  # noqa: ANN401  truths
        self.may_fail, self.may_hold = may_fail, may_hold

    @staticmethod
    def of(yes: Any, no: Any) -> RecordedBits:  # noqa: ANN401  truths
        """As `array_lines.bits`: certainly true, else certainly false, else either."""
        yes, no = (x if isinstance(x, RecordedArray) else bool(np.all(x)) for x in (yes, no))
        return RecordedBits(_not(yes), yes | _not(no))

    def __or__(self, other: Any) -> RecordedBits:  # noqa: ANN401  bits
        fail, hold = _both(other)
        return RecordedBits(self.may_fail | fail, self.may_hold | hold)

    def __and__(self, other: Any) -> RecordedBits:  # noqa: ANN401  bits
        fail, hold = _both(other)
        return RecordedBits(self.may_fail & fail, self.may_hold & hold)

    __ror__, __rand__ = __or__, __and__

    def __eq__(self, other: object) -> Any:  # noqa: ANN401  a truth of each column
        fail, hold = _both(other)
        one = self.may_fail if fail else _not(self.may_fail)
        return one & (self.may_hold if hold else _not(self.may_hold))


class Negations:
    """`NOT` of `array_lines.NAMES`, for recorded bits as well."""

    def __getitem__(self, x: Any) -> Any:  # noqa: ANN401  bits
        if isinstance(x, RecordedBits):
            return RecordedBits(x.may_hold, x.may_fail)
        return np.array([0, 2, 1, 3], dtype=np.uint8)[x]


def bits(yes: Any, no: Any) -> Any:  # noqa: ANN401  truths
    """`bits` of `array_lines.NAMES`, recorded."""
    return RecordedBits.of(yes, no)


def _not(x: Any) -> Any:  # noqa: ANN401  a truth
    return ~x if isinstance(x, RecordedArray) else not x


def _both(x: Any) -> tuple[Any, Any]:  # noqa: ANN401  bits
    if isinstance(x, RecordedBits):
        return x.may_fail, x.may_hold
    number = int(np.asarray(x).reshape(-1)[0])
    return bool(number & 1), bool(number & 2)


RECORDED: dict[str, Any] = {"NOT": Negations(), "bits": bits}
"""What generated code refers to while it is recorded, in place of `array_lines.NAMES`."""

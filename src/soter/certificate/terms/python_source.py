"""Straight Python code as text, line by line, and the function that it is.

Purpose: names for values and constants, sums and products of named balls. What needs no input is
computed once, at once; what is written twice, too; what nothing depends on is left out.
Non-goals: what is to be computed (`affine_forms.py`, `atom_code.py`).
"""

from __future__ import annotations

import re
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from flint import arb

from soter.certificate.batches.array_lines import NAMES
from soter.certificate.batches.array_programs import ArrayFunction
from soter.certificate.batches.ball_arrays import BallArray
from soter.certificate.batches.recorded_arrays import RECORDED
from soter.certificate.terms.arb_balls import (
    HALF,
    ONE,
    UNIVARIATE,
    ZERO,
    above,
    below,
    key_of,
    larger,
    line_noisy_max0,
    line_or_range,
    range_max0,
    smaller,
)
from soter.certificate.terms.runtime_calls import bits, by_truth, corners, pick, swept

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


WORD = re.compile(r"(?<![\w.])[A-Za-z_]\w*")
"""A name in our own code; `.max` is none."""
DEMAND = re.compile(r"if (\w+) != 2: return None$")
"""How `atom_code.demand` writes that something has to be certain."""
FUNCTIONS_MAX = 1000
"""Of arrays, that are remembered."""
PLAIN = {"abs", "if", "else", "return", "None"}


class PythonSource:
    """The lines of one function."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: dict[str, Any] = {
            "HALF": HALF,
            "ONE": ONE,
            "line_noisy_max0": line_noisy_max0,
            "line_or_range": line_or_range,
            "range_max0": range_max0,
            "ZERO": ZERO,
            "larger": larger,
            "smaller": smaller,
            "below": below,
            "above": above,
            "bits": bits,
            "by_truth": by_truth,
            "pick": pick,
            "swept": swept,
            "corners": corners,
            "NOT": (0, 2, 1, 3),
            **{f"line_{name}": f for name, f in UNIVARIATE.items()},
        }
        self.count = 0
        self.written: dict[str, list[str]] = {}
        """Code -> the names of its values."""
        self.numbers: dict[object, str] = {key_of(ZERO): "ZERO", key_of(HALF): "HALF"}
        """Constant -> its name."""

    def new(self, code: str) -> str:
        """A name for a value."""
        if code.isidentifier():
            return code
        return self.values(code, 1)[0]

    def values(self, code: str, count: int) -> list[str]:
        """Names for the values of some code: constants where no input is in it."""
        if code in self.written:
            return self.written[code]
        if all(w in self.names or w in PLAIN for w in WORD.findall(code)):
            value = eval(code, self.names)  # noqa: S307  our own text
            names = [self.constant(v) for v in (value if count > 1 else (value,))]
        else:
            names = []
            for _ in range(count):
                self.count += 1
                names.append(f"v{self.count}")
            self.lines.append(f"{', '.join(names)} = {code}")
        self.written[code] = names
        return names

    def constant(self, x: Any) -> str:  # noqa: ANN401  a ball, a truth, a pair of balls
        """The name of a number; equal ones have one name."""
        key: object = key_of(x) if isinstance(x, arb) else (type(x), id(x))
        if key not in self.numbers:
            self.count += 1
            name = f"K{self.count}"
            self.names[name] = x
            self.numbers[key] = name
        return self.numbers[key]

    def absolute(self, code: str) -> str:
        """The absolute value of a name, computed at once where it is a constant."""
        return self.constant(abs(self.names[code])) if code in self.names else f"abs({code})"

    def product_of(self, a: str, b: str) -> str:
        """A * b."""
        for one, other in ((a, b), (b, a)):
            if one in self.names and self.names[one] == 1 and isinstance(self.names[one], arb):
                return other
        return f"{a}*{b}"

    def times(self, factor: arb | str, code: str) -> str | None:
        """`factor * code`; None for zero."""
        if isinstance(factor, str):
            return None if "ZERO" in (factor, code) else self.product_of(factor, code)
        if factor.is_zero() or code == "ZERO":  # what is unbounded is finite all the same
            return None
        if factor == 1:
            return code
        if factor == -1:
            return f"(-{code})"
        return f"{self.constant(factor)}*{code}"

    def sum(self, parts: Sequence[str | None], offset: arb = ZERO) -> str | None:
        """A name for the sum; None for zero."""
        kept = [p for p in parts if p is not None and p != "ZERO"]
        if not offset.is_zero() or not kept:
            if not kept and offset.is_zero():
                return None
            kept.insert(0, self.constant(offset))
        return self.new(" + ".join(kept))

    def code(self, factor: arb | str) -> str:
        """A coefficient as a name."""
        return factor if isinstance(factor, str) else self.constant(factor)

    def function(self, arguments: Sequence[str]) -> WrittenFunction:
        """The function of a form of these names that the lines are."""
        head = [f"{tuple_of(arguments)} = form"] if arguments else []
        return WrittenFunction([*head, *_used(self.lines)], self.names)


class WrittenFunction:
    """A function that was written as text: of one form, and of many forms at once."""

    def __init__(self, lines: Sequence[str], names: dict[str, Any]) -> None:
        self._lines, self._names = lines, names

    @cached_property
    def _of_one(self) -> Callable[[tuple[arb, ...]], Any]:
        function: Callable[[tuple[arb, ...]], Any] = _compiled(self._lines, self._names)
        return function

    def __call__(self, form: tuple[arb, ...]) -> Any:  # noqa: ANN401  made from text
        """What the lines make of a form."""
        return self._of_one(form)

    def prepare(self) -> None:
        """Record what `of_many` does, for all processes that are forked later."""
        names, _, _ = self._lines[0].partition(" = form")
        self.of_many.prepare(names.count(","))

    @cached_property
    def content(self) -> object:
        """Equal for functions of the same lines and constants only."""
        used = {w for line in self._lines for w in WORD.findall(line)} & self._names.keys()
        constants = sorted(used - NAMES.keys())
        return tuple(self._lines), tuple((w, content_of(self._names[w])) for w in constants)

    @cached_property
    def of_many(self) -> ArrayFunction:
        """The same lines over arrays of balls, and for which boxes none would give back None."""
        if self.content not in _ARRAY_FUNCTIONS:
            if len(_ARRAY_FUNCTIONS) == FUNCTIONS_MAX:
                _ARRAY_FUNCTIONS.clear()
            _ARRAY_FUNCTIONS[self.content] = self._as_array_function()
        return _ARRAY_FUNCTIONS[self.content]

    def _as_array_function(self) -> ArrayFunction:
        lines = ["sure = True"]
        for line in self._lines:
            demanded = DEMAND.match(line)
            if demanded:
                lines.append(f"sure = sure & ({demanded[1]} == 2)")
            elif line.startswith("return "):
                lines.append(f"return {line.removeprefix('return ')}, sure")
            else:
                lines.append(line)
        used = {w for line in lines for w in WORD.findall(line)} & self._names.keys()
        constants = {w: _as_arrays(self._names[w]) for w in used - NAMES.keys()}
        names = {**constants, **NAMES}
        recorded = partial(_compiled, lines, {**names, **RECORDED})
        return ArrayFunction(_compiled(lines, names), recorded)


_ARRAY_FUNCTIONS: dict[object, ArrayFunction] = {}
"""By all that they are made of: groups that are alike have them in common."""


def content_of(constant: Any) -> object:  # noqa: ANN401  as `_as_arrays`
    """Equal for equal constants only; of what is no number or table equal to nothing else."""
    if isinstance(constant, tuple):
        return tuple(content_of(x) for x in constant)
    if isinstance(constant, arb) and constant.is_finite():
        return key_of(constant)
    if isinstance(constant, np.ndarray):
        return constant.dtype.str, constant.shape, constant.tobytes()
    return (type(constant), repr(constant)) if isinstance(constant, (int, float)) else object()


def _compiled(lines: Sequence[str], names: dict[str, Any]) -> Any:  # noqa: ANN401  made from text
    body = "\n    ".join(lines)
    exec(f"def run(form):\n    {body}\n", names)  # noqa: S102  our own text
    return names["run"]


def _as_arrays(constant: Any) -> Any:  # noqa: ANN401  a ball, a pair of balls, a table, a truth
    if isinstance(constant, tuple):
        return tuple(_as_arrays(x) for x in constant)
    return BallArray.of(constant) if isinstance(constant, arb) else constant


def tuple_of(parts: Sequence[str]) -> str:
    """A tuple of these."""
    return f"({', '.join(parts)},)" if parts else "()"


def _used(lines: Sequence[str]) -> list[str]:
    """The lines on which the last one, or one that may return, depends."""
    needed: set[str] = set()
    kept = []
    for line in reversed(lines):
        names, separator, code = line.partition(" = ")
        if not separator or line.startswith(("return", "if ")):
            code = line
        elif needed.isdisjoint(WORD.findall(names)):
            continue
        needed.update(WORD.findall(code))
        kept.append(line)
    return kept[::-1]

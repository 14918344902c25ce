"""The numbers of a system: parameters fixed, constant expressions computed.

Purpose: periods, counts and intervals, each with what is possible.
Non-goals: what the numbers are for (`elaborator.py`), values of parameters (`parameter_values.py`).
"""

from __future__ import annotations

import math
from contextlib import contextmanager
from typing import TYPE_CHECKING

from soter.diagnostics.fix import the_other_way
from soter.language.check.constants import Calculator
from soter.language.check.parts.node import UNKNOWN
from soter.language.elaborate.parameter_values import Parameters
from soter.language.model import typed
from soter.language.model.durations import show_ns

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.language.elaborate.parameter_values import Values
    from soter.language.model.types import Value

MIN_PERIOD_NS = 1_000
MAX_PERIOD_NS = 3_600_000_000_000
MAX_TIME_NS = 2**62


class Numbers:
    """Computes the numbers of one system under its parameters."""

    def __init__(
        self,
        program: typed.TypedProgram,
        symbol: typed.SystemSymbol,
        overrides: Mapping[str, Value],
        diagnostics: Diagnostics,
    ) -> None:
        self.program = program
        self.symbol = symbol
        self.diagnostics = diagnostics
        self.parameters = Parameters(program, symbol.sets, overrides, diagnostics)
        self.params = self.parameters.everywhere
        self.calculator = Calculator(diagnostics, self.params)
        self._calculators = {id(self.params): (self.params, self.calculator)}

    @contextmanager
    def under(self, params: Values) -> Iterator[None]:
        """Compute with these values of the parameters meanwhile; one budget for all."""
        before, outer = self.params, self.calculator
        if params is not before:
            known = self._calculators.get(id(params))
            if known is None:
                known = params, Calculator(self.diagnostics, params)
                self._calculators[id(params)] = known
            self.params, self.calculator = known
            self.calculator.left = outer.left
        try:
            yield
        finally:
            outer.left = self.calculator.left
            self.params, self.calculator = before, outer

    # ------------------------------------------------------------ numbers

    def number(self, expr: typed.TypedExpr, what: str) -> Value | None:
        """The value of a constant expression under this system's parameters."""
        return self.calculator.value(expr, what)

    def duration(self, expr: typed.TypedExpr, what: str) -> int | None:
        """A time in ns, None after a report: C001 when it is impossible, C002 when absurd."""
        if isinstance(expr, typed.Literal) and expr.name == UNKNOWN:
            return None
        value = self.number(expr, what)
        if value is None:
            return None
        assert isinstance(value, int)
        if value <= 0:
            self.diagnostics.error(
                "C001", f"{what} must be longer than zero", expr.span, f"this is {show_ns(value)}"
            )
            return None
        if not MIN_PERIOD_NS <= value <= MAX_PERIOD_NS:
            self.diagnostics.error(
                "C002",
                f"{what} cannot be {show_ns(value)}",
                expr.span,
                f"{show_ns(MIN_PERIOD_NS)} to {show_ns(MAX_PERIOD_NS)} are possible",
            )
            return None
        return value

    def long_duration(self, expr: typed.TypedExpr | None, what: str) -> int | None:
        """The length of a run in ns, None where there is none or after a report."""
        value = self.number(expr, what) if expr is not None else None
        if value is None or expr is None:
            return None
        if value <= 0:
            self.diagnostics.error(
                "C001", f"{what} must be longer than zero", expr.span, f"this is {show_ns(value)}"
            )
            return None
        if value > MAX_TIME_NS:
            self.diagnostics.error(
                "C002", f"{what} is too long", expr.span, "at most 146 years are possible"
            )
            return None
        return int(value)

    def delay(self, expr: typed.TypedExpr | None, what: str) -> int | None:
        """A delay in ns, zero allowed; None where there is none or after a report."""
        value = self.number(expr, what) if expr is not None else None
        if value is None or expr is None:
            return None
        if value < 0:
            self.diagnostics.error(
                "C001", f"{what} cannot be negative", expr.span, f"this is {show_ns(value)}"
            )
            return None
        if value > MAX_PERIOD_NS:
            self.diagnostics.error(
                "C002",
                f"{what} cannot be {show_ns(value)}",
                expr.span,
                f"0 s to {show_ns(MAX_PERIOD_NS)} are possible",
            )
            return None
        return int(value)

    def count(self, expr: typed.TypedExpr | None, what: str, low: int, high: int) -> int | None:
        """A whole number in [low, high]; None where there is none or after a report (C002)."""
        value = self.number(expr, what) if expr is not None else None
        if value is None or expr is None:
            return None
        if not low <= value <= high:
            self.diagnostics.error(
                "C002", f"{what} cannot be {value}", expr.span, f"{low} to {high} are possible"
            )
            return None
        return int(value)

    def interval(
        self, low: typed.TypedExpr, high: typed.TypedExpr, span: Span, what: str
    ) -> tuple[float, float] | None:
        """Bounds, None after a report: V006 when they are not finite, V001 when out of order."""
        a, b = self.number(low, what), self.number(high, what)
        if a is None or b is None:
            return None
        shown = f"[{a!r}, {b!r}]"
        if not (math.isfinite(a) and math.isfinite(b)):
            self.diagnostics.error("V006", f"{what} must be bounded", span, f"this is {shown}")
            return None
        if not math.isfinite(b - a):
            self.diagnostics.error(
                "V006", f"{what} is wider than any float", span, f"this is {shown}"
            )
            return None
        if a > b:
            self.diagnostics.error(
                "V001",
                f"{shown} is empty",
                span,
                "the lower bound is above the upper one",
                helps=(the_other_way(low.span, high.span),),
            )
            return None
        return a, b

    def skew(self, expr: typed.TypedExpr | None) -> int:
        """The skew of a test in ns: zero is allowed, and what stands for a wrong one."""
        value = self.number(expr, "`skew`") if expr is not None else None
        if expr is None or value is None:
            return 0
        if not 0 <= value <= MAX_PERIOD_NS:
            self.diagnostics.error(
                "C002",
                f"`skew` cannot be {show_ns(value)}",
                expr.span,
                f"0 s to {show_ns(MAX_PERIOD_NS)} are possible",
            )
            return 0
        return int(value)

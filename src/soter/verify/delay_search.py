"""How late commands may act so that everything of a module is still proved.

Purpose: `acts within` of the program is made longer, and the module verified anew with each value:
the largest that was proved, the smallest that was not, and what stood in the way of that.
Non-goals: a bound that nobody verified; changing a program; other times (`period_sweep.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import phase, share_done
from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate import derived_systems
from soter.language.model import typed
from soter.language.model.types import DURATION, show_ns, write_ns
from soter.verify.claims.results import PROVED
from soter.verify.module_methods import module_method
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.system import Module, System

    Progress = Callable[[float], None]

CLOSE = 0.1
"""The search ends where the least that failed is that share above the largest that was proved."""
TRIES_MAX = 14
"""So many verifications of a module at most."""
FIRST = 0.1
"""The first step, as a share of SC's period."""


@dataclass
class DelayAdvice:
    """Values of `acts within` in ns: `declared`, and each that was tried, with what failed."""

    module: str
    declared_ns: int
    least_ns: int = 0
    """The least time of each, which stays."""
    why_not: dict[int, str] = field(default_factory=dict)
    """By value in ns, in the order of the trials: "" where everything was proved."""

    @property
    def largest_ns(self) -> int | None:
        """The largest with which everything is proved; None: not even with the declared one."""
        return max((ns for ns, why in self.why_not.items() if not why), default=None)

    @property
    def refused_ns(self) -> int | None:
        """The smallest above that with which something is not proved; None: all that were tried."""
        least = self.largest_ns if self.largest_ns is not None else -1
        return min((ns for ns, why in self.why_not.items() if why and ns > least), default=None)

    @property
    def summary(self) -> str:
        """One or two sentences."""
        largest, refused = self.largest_ns, self.refused_ns
        if largest is None:
            why = self.why_not[self.declared_ns]
            return f"not proved with `{self._written(self.declared_ns)}` as declared: {why}"
        more = show_ns(largest - self.declared_ns)
        said = (
            f"commands may act {show_ns(largest)} late, {more} more than declared, and everything "
        )
        said += f"is proved: `{self._written(largest)}`"
        if refused is None:
            return f"{said}; nothing longer was tried"
        return f"{said}; not with {show_ns(refused)}: {self.why_not[refused]}"

    def _written(self, most_ns: int) -> str:
        """As a program says it."""
        least = f"{write_ns(self.least_ns)} to " if self.least_ns else ""
        return f"acts within {least}{write_ns(most_ns)}"


def largest_delay(flat: System, module: Module) -> DelayAdvice:
    """Verify a module of a flat system with longer and longer delays of its commands.

    Times that the theorem does not cover count as not proved. `SoterError` where the problem
    cannot be posed as it is declared.
    """
    problem = extract(flat, module)
    advice = DelayAdvice(module.name, problem.times.acts, problem.times.acts_least)
    proved, failed = advice.declared_ns, None
    while len(advice.why_not) < TRIES_MAX:
        at = _next(proved, failed, advice, problem.times.delta_sc)
        if at is None:
            break
        phase(f"{module.name}: commands that act {show_ns(at)} late")
        share_done(len(advice.why_not) / TRIES_MAX)
        advice.why_not[at] = _what_fails(flat, module, at)
        if advice.why_not[at]:
            failed = at
        else:
            proved = at
        if failed == advice.declared_ns:
            break
    return advice


def _next(proved: int, failed: int | None, advice: DelayAdvice, period_ns: int) -> int | None:
    """The value to try next: what is declared, then twice as much more, then halves between."""
    if not advice.why_not:
        return advice.declared_ns
    if failed is None:
        more = 2 * (proved - advice.declared_ns)
        return advice.declared_ns + max(more, _rounded(FIRST * period_ns))
    middle = _rounded((proved + failed) / 2)
    near = failed - proved <= CLOSE * max(proved, FIRST * period_ns)
    return None if near or not proved < middle < failed else middle


def _rounded(ns: float) -> int:
    """A time to two digits, so that it can be read."""
    return max(1, int(float(f"{ns:.2g}")))


def _what_fails(flat: System, module: Module, acts_ns: int) -> str:
    """The first of all that is not proved with commands that act so late; "" for nothing."""
    at = module.symbol.verify.span or module.symbol.span
    verify = replace(module.symbol.verify, acts=typed.Literal(DURATION, at, acts_ns))
    changed = replace(module, symbol=replace(module.symbol, verify=verify))
    try:
        problem = extract(derived_systems.with_module(flat, changed), changed)
        result = module_method(problem).verify(problem, refute=False, explain=False)
    except SoterError as error:
        first = error.diagnostics[0]
        return f"{first.code}: {first.message}"
    if result.verdict == PROVED:
        return ""
    claim, finding = next((c, f) for c, f in result.findings.items() if f.verdict == result.verdict)
    return f"{claim} {finding.verdict}: {finding.text}"

"""The check of a decision module by tubes, as Soter source.

Purpose: `check_source`: a program text with `fun good(estimate: float[n]): bool`, made of what is the
same for all (`forms.soter`, `tube.soter`, `check.soter`) and of a module's rates, law and predicates.
Non-goals: what is proved of it offline (`rest_claims.py`), where it is put (`deploy/`).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from importlib.resources import files
from math import inf, nextafter
from typing import TYPE_CHECKING

from soter.verify.tubes.expressions import NoExpressionError
from soter.verify.tubes.module_expressions import ModuleExpressions
from soter.verify.tubes.print_forms import certain, function, number

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from soter.verify.problem.problem import Problem

PARTS = ("forms.soter", "tube.soter", "check.soter")
SYMBOLS_MAX = 2000
"""How many a form may have, for what `forms.soter` says of sums."""
ATTEMPTS = 8


@dataclass(frozen=True)
class TubeTimes:
    """Times of a tube in ns (docs/proof.md, "Decisions by tubes"): alpha, H, d, j, delta."""

    earliest: int
    latest: int
    delay: int
    jitter: int
    period: int
    holds: int

    @property
    def depth(self) -> int:
        """Holds over which a read may go back: until the last one acts, j more than d."""
        return max(1, -(-(self.delay + self.jitter) // self.period))

    @staticmethod
    def of(problem: Problem, within_ns: int) -> TubeTimes:
        """Of a module that comes to rest within a time."""
        t = problem.times
        j, period = t.jitter_sc, t.delta_sc
        least = 0  # L_min
        earliest = max(t.delta_dm - t.late_dm + least, t.horizon_ns - period - j, 0)
        return TubeTimes(
            min(earliest, t.horizon_ns),
            t.horizon_ns,
            t.delay_sc,
            j,
            period,
            (within_ns - j) // period,
        )


@dataclass(frozen=True)
class Cut:
    """How finely a tube is cut: steps until SC acts, steps a hold, columns that are kept."""

    free: int = 2
    steps: int = 1
    keep: int = 6


def check_source(
    problem: Problem, times: TubeTimes, cut: Cut, rest: str, module: ModuleExpressions | None = None
) -> str:
    """The text. `rest`: that of `at_rest`. `NoExpressionError` where something is no expression."""
    module = module or ModuleExpressions(problem)
    rates = module.rates()
    still = module.still(rates, "w")
    effects = [e for row in module.effects(rates) for e in row]
    over = {"x": "x", "u": "u", "v": "v", "y": "y"}
    parts = [
        constants(problem, times, cut),
        *[(files(__package__) / name).read_text(encoding="utf-8") for name in PARTS[:2]],
        function("rates", "x: Forms, u: Controls", still, over, "Forms"),
        function("effects", "x: Forms, u: Controls", effects, over, "Effects"),
        function("bends", "x: Forms, u: Controls, v: Forms", module.bends(still), over, "Forms"),
        function("law", "y: Forms", module.law(), over, "Controls"),
        certain("safe", "x: Forms", module.predicate(problem.module.symbol.safe), over),
        rest,
        (files(__package__) / PARTS[2]).read_text(encoding="utf-8"),
    ]
    return "\n".join(parts)


def constants(problem: Problem, times: TubeTimes, cut: Cut) -> str:
    """Sizes, times and ranges."""
    q = problem.quantities
    n, m, w = len(q.states), len(q.controls), len(q.disturbances)
    moved = m + w
    read = 2 * n + cut.keep
    opened, closed, moves = read + n, read + n + moved, read + n + 2 * moved
    symbols = moves + moved * cut.steps
    whole = {
        "SYMBOLS": symbols, "STATES": n, "CONTROLS": m, "DISTURBANCES": w, "MOVED": moved,
        "EFFECTS": n * moved, "KEEP": cut.keep, "READS": read, "OPEN": opened, "CLOSED": closed,
        "MOVES": moves, "ATTEMPTS": ATTEMPTS, "FREE_STEPS": cut.free, "STEPS": cut.steps,
        "HOLDS": times.holds, "DEPTH": times.depth,
    }  # fmt: skip
    if symbols > SYMBOLS_MAX:
        msg = f"{symbols} symbols: more than {SYMBOLS_MAX}"
        raise NoExpressionError(msg)
    seconds = {
        "FREE_STEP": near(times.earliest, cut.free),
        "WINDOW": near(times.latest - times.earliest),
        "LATE_READ": above(Fraction(times.delay, 10**9)),
        "JITTER": near(times.jitter),
        "FIRST_STEP": near(times.period - times.jitter, cut.steps),
        "LATER_STEP": near(times.period - 2 * times.jitter, cut.steps),
    }
    lines = [f"const {name}: int = {value};" for name, value in whole.items()]
    lines += [f"const {name}: float = {number(value)};" for name, value in seconds.items()]
    middles = [0.5 * c.low + 0.5 * c.high for c in problem.controls]
    half = [
        above(max(Fraction(c.high) - Fraction(m), Fraction(m) - Fraction(c.low)))
        for c, m in zip(problem.controls, middles, strict=True)
    ]
    wide = [max(abs(d.low), abs(d.high)) for d in problem.disturbances]
    errors = [max(abs(e.low), abs(e.high)) for e in problem.errors]
    zero = _form(0.0)
    middle = [_form(m) for m in middles]
    lines += [
        f"const NONE: float[SYMBOLS] = {_list([0.0] * symbols)};",
        f"const NO_RATES: float[STATES] = {_list([0.0] * n)};",
        f"const ERRORS: float[STATES] = {_list(errors)};",
        f"const NOWHERE: Forms = {_array([zero] * n)};",
        f"const NO_FORMS: Forms[DEPTH] = {_array(['NOWHERE'] * whole['DEPTH'])};",
        f"const ANY_COMMAND: Controls = {_array(middle)};",
        f"const ANY: Wide = {_list(wide + half)};",
        f"const DISTURBED: Wide = {_list(wide + [0.0] * m)};",
    ]
    return "\n".join(lines) + "\n"


def near(ns: int, parts: int = 1) -> float:
    """The double next to a time in s, over parts: `flow` allows for that rounding."""
    return float(Fraction(ns, 10**9 * parts))


def above(x: Fraction) -> float:
    """The least double that is not below."""
    value = float(x)
    return value if Fraction(value) >= x else nextafter(value, inf)


def _form(value: float) -> str:
    v = number(value)
    return f"{{ c: {v}, r: 0.0, lo: {v}, hi: {v}, g: NONE }}"


def _list(values: Iterable[float]) -> str:
    return _array([number(float(v)) for v in values])


def _array(items: Sequence[str]) -> str:
    return f"[{', '.join(items)}]"

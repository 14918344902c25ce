"""How far SC moves what `moves` names, once `rest` holds.

Purpose: rule 2 of "Decisions by tubes" (docs/proof.md) with V the sum of c_i |x_i| over states:
where z' <= sum x_i p_i and x_i' = x_i q_i, z moves by at most V as long as |p_i| + c_i q_i <= 0;
V is 0 where they are, and exactly so, as each is taken out as a factor and only p_i, q_i and what
else is in z' are enclosed.
Non-goals: other potentials: what is not of this form is not shown.
"""

from __future__ import annotations

from fractions import Fraction
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

from soter.verify.problem.problem import Interval
from soter.verify.tubes.expressions import in_order
from soter.verify.tubes.generated_functions import Caller
from soter.verify.tubes.print_forms import function
from soter.verify.tubes.tube_check import above, part

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.verify.tubes.expressions import Expressions, Node
    from soter.verify.tubes.tube_check import TubeCheck

    Ranges = Mapping[tuple[str, int], Interval]


RANGES = "const SYMBOLS: int = 1;\nconst NONE: float[SYMBOLS] = [0.0];"
"""Forms that share nothing."""


def undrifted(
    check: TubeCheck, caller: Caller, at: Mapping[int, Interval], box: Mapping[int, Interval]
) -> str:
    """The first state of `moves` of which it is not shown; "": all are.

    `at`: where states are once `rest` holds, Y or a topic's set; `box`: where it holds.
    """
    ends = [[at[s].low for s in check.states], [at[s].high for s in check.states]]
    answer = caller.value("answers_at_rest", ends)
    if answer is None:
        return "what SC answers at rest is not bounded"
    ranges: dict[tuple[str, int], Interval] = {("x", s): at[s] for s in check.states}
    ranges |= {("u", k): Interval(u[2], u[3]) for k, u in enumerate(answer)}
    ranges |= {("w", k): Interval(d.low, d.high) for k, d in enumerate(check.problem.disturbances)}
    followed = [z for z in check.problem.drifts if z in check.states]  # nothing asks for others
    for z in followed:
        drift = check.problem.drifts[z]
        rate, name = check.rates[z], check.problem.quantities.states[z].name
        topic = check.problem.states[z]
        if (drift.above == inf and topic.high < inf) or (drift.below == inf and topic.low > -inf):
            return f"SC may move {name} without end, and the set of its topic has one"
        ways = (("up", rate, drift.above), ("down", check.make.neg(rate), drift.below))
        for way, e, by in ways:
            if isfinite(by) and (why := _farther(check, z, e, by, ranges, box)):
                return f"how far SC moves {name} is not shown: {way}, {why}"
    return ""


def _pushed(check: TubeCheck, state: int) -> str:
    """By what a state and those that its rate reads are moved, in words."""
    found, new = set[int](), {state}
    while new - found:
        found |= new
        of = in_order([check.rates[s] for s in new])
        new = {e.of[1] for e in of if e.op == "input" and e.of[0] == "x"}
    movers = {e.of for e in in_order([check.rates[s] for s in found]) if e.op == "input"}
    winds = check.problem.quantities.disturbances
    ranges = check.problem.disturbances
    said = [
        f"{winds[k].name} in [{ranges[k].low:.4g}, {ranges[k].high:.4g}]"
        for kind, k in sorted(movers)
        if kind == "w" and ranges[k].low != ranges[k].high
    ]
    said += (
        ["SC, by what it reads"] if check.read_by_law and any(k == "u" for k, _ in movers) else []
    )
    return f" (moved by {', '.join(said)})" if said else ""


def _farther(
    check: TubeCheck, z: int, e: Node, by: float, ranges: Ranges, box: Mapping[int, Interval]
) -> str:
    """Why what grows at e may grow by more than `by`, by V of the states of `box`; "": not so."""
    make, most = check.make, Fraction(0)
    (e,) = _decided(check, [_at_worst(make, e, ranges)], ranges)
    for state, where in box.items():
        x = make.input("x", state)
        p, rest = make.split(e, x)
        (own,) = _decided(check, [check.rates[state]], ranges)
        q = make.factor(own, x)
        if q is None or p is make.number(0.0):
            continue
        of_p, of_q = enclosed([p, q], ranges)
        if of_q.high < 0.0 and all(map(isfinite, (of_p.low, of_p.high, of_q.high))):
            size = max(abs(Fraction(where.low)), abs(Fraction(where.high)))
            worst = max(Fraction(of_p.high), -Fraction(of_p.low))
            most += size * worst / -Fraction(of_q.high)
            e = rest
    (more,) = enclosed([e], ranges)
    if not more.high <= 0.0:
        fast = f"at up to {more.high:.4g} a second" if more.high < inf else "at no bounded rate"
        return f"it may go on {fast}, and `moves` allows {by:.4g} in all{_pushed(check, z)}"
    if most > Fraction(by):
        return f"by up to {above(most):.4g}, and `moves` allows {by:.4g}"
    return ""


def _at_worst(make: Expressions, e: Node, ranges: Ranges) -> Node:
    """Disturbances that only add to e, at the end at which they add most."""
    for w in [x for x in in_order([e]) if x.op == "input" and x.of[0] == "w"]:
        slope = make.along(e, {w: make.number(1.0)}, {})
        if slope.op == "number":
            ends = ranges["w", w.of[1]]
            most = ends.high if slope.of[0] > 0.0 else ends.low
            e = make.replaced(e, {w: make.number(most)})
    return e


def _decided(check: TubeCheck, roots: Sequence[Node], ranges: Ranges) -> list[Node]:
    """The same expressions, without a `min` or `max` whose answer is certain in these ranges.

    An input that has one value is that number.
    """
    make = check.make
    known = {make.input(*at): make.number(r.low) for at, r in ranges.items() if r.low == r.high}
    for e in in_order(roots):
        if e.op not in ("min", "max"):
            continue
        a, b = (make.replaced(x, known) for x in e.of)
        of_a, of_b = enclosed([a, b], ranges)
        smaller = a if of_a.high <= of_b.low else b if of_b.high <= of_a.low else None
        if smaller is not None:
            larger = b if smaller is a else a
            known[e] = smaller if e.op == "min" else larger
    return [make.replaced(e, known) for e in roots]


def enclosed(nodes: Sequence[Node], ranges: Ranges) -> list[Interval]:
    """Where these expressions lie; without ends where nothing is known."""
    return Enclosures([nodes]).of(0, ranges)


class Enclosures:
    """Lists of expressions, written out once and enclosed over several ranges."""

    def __init__(self, lists: Sequence[Sequence[Node]]) -> None:
        self._count = [len(nodes) for nodes in lists]
        self._used = [[e for e in in_order(nodes) if e.op == "input"] for nodes in lists]
        text = [RANGES, part("forms.soter")]
        for k, (nodes, used) in enumerate(zip(lists, self._used, strict=True)):
            over = {e.of: f"a[{i}]" for i, e in enumerate(used)}
            many = f"Form[{max(1, len(used))}]"
            text.append(function(f"asked_{k}", f"a: {many}", nodes, over, f"Form[{len(nodes)}]"))
        self._caller = Caller("\n".join(text))

    def of(self, k: int, ranges: Ranges) -> list[Interval]:
        """Where those of one list lie; without ends where nothing is known."""
        value = self._caller.value
        inputs: list[Any] = [
            value("f_range", ranges[e.of].low, ranges[e.of].high) for e in self._used[k]
        ] or [value("f_number", 0.0)]
        found = value(f"asked_{k}", inputs)
        if found is None:
            return [Interval(-inf, inf)] * self._count[k]
        return [Interval(f[2], f[3]) for f in found]

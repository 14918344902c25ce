"""Claims about a module with `rest` that are shown before the flight.

Purpose: `show_rest_claims` asks the tube of `rest.soter` four things: that SC answers on all that
it may read, that it keeps a box around the states where `rest` holds (rule 1 of "Decisions by
tubes" in proof-flight.md), how far it moves the states that `moves` names (rule 2), and that the
start leads to rest. `why_drift_not_shown` shows rule 2 with one kind of potential: V = sum of c_i
|x_i| over states. Where z' <= sum x_i p_i and x_i' = x_i q_i, z moves by at most V as long as |p_i|
+ c_i q_i <= 0. Each x_i is taken out as a factor, so V is exactly 0 where all x_i are: only p_i,
q_i and what else is in z' are enclosed.
Non-goals: verdicts (`verify.py`), the check in flight (`tube_check.py`), other potentials.
"""

from __future__ import annotations

import contextlib
import json
import random
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from math import inf, isfinite
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import phase
from soter.language.model.tree_walk import MAX_OPERATIONS
from soter.language.model.types import show_ns
from soter.verify.problem.problem import Interval
from soter.verify.tubes.compiled_calls import CompiledCaller
from soter.verify.tubes.enclosures import enclosed_ranges
from soter.verify.tubes.expression_graph import deciding_nodes, in_order
from soter.verify.tubes.generated_functions import Caller, TooLongError
from soter.verify.tubes.kinks import Kink, kink_entry
from soter.verify.tubes.leading_back import (
    box_ends,
    box_in_words,
    choose_precision_that_gives_control,
    is_control_given,
    is_start_collected,
    way_back,
)
from soter.verify.tubes.problem import FARTHEST, cut_to_farthest, is_far, refusal, rounded_up
from soter.verify.tubes.sc_step import variables_entry
from soter.verify.tubes.tube_precision import PLAIN

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from soter.diagnostics.diagnostic import SoterError
    from soter.verify.tubes.expression_graph import Expressions, Node
    from soter.verify.tubes.tube_check import TubeCheck

    Ranges = Mapping[tuple[str, int], Interval]
    Progress = Callable[[float], None]


def why_drift_not_shown(
    check: TubeCheck, caller: Caller, at: Mapping[int, Interval], box: Mapping[int, Interval]
) -> str:
    """Why the bound of a state that `moves` names is not shown, in words; "" if all are shown.

    `at` has each state's range after `rest` has held (Y, or its topic's set); `box` is B of rule 1.
    """
    ends = [[at[s].low for s in check.states], [at[s].high for s in check.states]]
    answer = caller.result("answers_at_rest", ends)
    if answer is None:
        return "what SC answers at rest is not bounded"
    ranges = _input_ranges(check, at, [Interval(u[2], u[3]) for u in answer])
    followed = [z for z in check.problem.drifts if z in check.states]  # nothing reads the others
    for z in followed:
        drift = check.problem.drifts[z]
        rate, name = check.rates[z], check.problem.quantities.states[z].name
        topic = check.problem.states[z]
        if (drift.above == inf and topic.high < inf) or (drift.below == inf and topic.low > -inf):
            return f"SC may move {name} without end, and the set of its topic has one"
        ways = (("up", rate, drift.above), ("down", check.make.neg(rate), drift.below))
        for way, e, by in ways:
            if isfinite(by) and (why := _why_it_may_drift(check, z, e, by, ranges, box)):
                return f"{HOW_FAR} {name} is not shown: {way}, {why}"
    return ""


def _input_ranges(
    check: TubeCheck, at: Mapping[int, Interval], answer: Sequence[Interval]
) -> dict[tuple[str, int], Interval]:
    """The range of every input of the rates: states "x", commands of SC "u", disturbances "w"."""
    ranges = {("x", s): at[s] for s in check.states}
    ranges |= {("u", k): u for k, u in enumerate(answer)}
    return ranges | {("w", k): d for k, d in enumerate(check.problem.disturbances)}


def _moves_in_words(check: TubeCheck, state: int) -> str:
    """The end of a message that says what moves a state and the states that its rate reads."""
    found, new = set[int](), {state}
    while new - found:
        found |= new
        of = in_order([check.rates[s] for s in new])
        new = {e.of[1] for e in of if e.op == "input" and e.of[0] == "x"}
    movers = {e.of for e in in_order([check.rates[s] for s in found]) if e.op == "input"}
    winds = check.problem.quantities.disturbances
    ranges = check.problem.disturbances
    causes = [
        f"{winds[k].name} in [{ranges[k].low:.4g}, {ranges[k].high:.4g}]"
        for kind, k in sorted(movers)
        if kind == "w" and ranges[k].low != ranges[k].high
    ]
    if check.read_by_law and "u" in dict(movers):
        causes.append("SC, by what it reads")
    return f" (moved by {', '.join(causes)})" if causes else ""


def _why_it_may_drift(
    check: TubeCheck, z: int, e: Node, by: float, ranges: Ranges, box: Mapping[int, Interval]
) -> str:
    """Why a state z with rate `e` may grow by more than `by`; "" if not. V is taken over `box`."""
    make, most = check.make, Fraction(0)
    (e,) = _with_decided_extremes(check, [_rate_at_worst_disturbance(make, e, ranges)], ranges)
    for state, where in box.items():
        x = make.input("x", state)
        p, rest = make.split_off_factor(e, x)
        (state_rate,) = _with_decided_extremes(check, [check.rates[state]], ranges)
        q = make.factor(state_rate, x)
        if p is make.constant(0.0):
            continue
        if q is None:
            least = _one_sided_gain(make, state_rate, x, p, ranges)
            if least is not None:
                most += least
                e = rest
            continue
        of_p, of_q = enclosed_ranges([p, q], ranges)
        if of_q.high < 0.0 and all(map(isfinite, (of_p.low, of_p.high, of_q.high))):
            size = max(abs(Fraction(where.low)), abs(Fraction(where.high)))
            worst = max(Fraction(of_p.high), -Fraction(of_p.low))
            most += size * worst / -Fraction(of_q.high)
            e = rest
    (more,) = enclosed_ranges([e], ranges)
    if not more.high <= 0.0:
        fast = f"at up to {more.high:.4g} a second" if more.high < inf else "at no bounded rate"
        return f"it may go on {fast}, and `moves` allows {by:.4g} in all{_moves_in_words(check, z)}"
    if most > Fraction(by):
        return f"by up to {rounded_up(most):.4g}, and `moves` allows {by:.4g}"
    return ""


def _one_sided_gain(
    make: Expressions, state_rate: Node, x: Node, p: Node, ranges: Ranges
) -> Fraction | None:
    """The largest sum of x p over time, if it adds only on a side of 0 where x falls back.

    On this side V = c max(x, 0), or its mirror image: for x > 0 and x' <= -m < 0, x p is at most c
    m = (the largest x) (the largest p). None if no side of 0 is such.
    """
    (of_p,) = enclosed_ranges([p], ranges)
    for side in (1.0, -1.0):
        if side * (of_p.low if side > 0.0 else of_p.high) < 0.0:
            continue
        far = ranges[x.of].high if side > 0.0 else -ranges[x.of].low
        beside = {make.positive_condition(x if side > 0.0 else make.neg(x)): make.true}
        beside[make.positive_condition(make.neg(x) if side > 0.0 else x)] = make.false
        known = {**ranges, x.of: Interval(0.0, far) if side > 0.0 else Interval(-far, 0.0)}
        (rate,) = enclosed_ranges(
            [make.substituted(make.mul(state_rate, make.constant(side)), beside)], known
        )
        if far > 0.0 and rate.high < 0.0 and isfinite(of_p.high - of_p.low):
            size = max(abs(Fraction(of_p.low)), abs(Fraction(of_p.high)))
            return Fraction(far) ** 2 * size / -Fraction(rate.high)
    return None


def _rate_at_worst_disturbance(make: Expressions, e: Node, ranges: Ranges) -> Node:
    """The rate `e` with each purely additive disturbance at the end that makes `e` largest."""
    winds = {x for x in in_order([e]) if x.op == "input" and x.of[0] == "w"}
    for w in winds - deciding_nodes([e]):
        slope = make.slope_along(e, {w: make.constant(1.0)}, {})
        if slope.op == "number":
            ends = ranges["w", w.of[1]]
            most = ends.high if slope.of[0] > 0.0 else ends.low
            e = make.substituted(e, {w: make.constant(most)})
    return e


def _with_decided_extremes(check: TubeCheck, roots: Sequence[Node], ranges: Ranges) -> list[Node]:
    """The expressions without each `min` or `max` whose result is certain over `ranges`.

    An input whose range is a single number is replaced by this number.
    """
    make = check.make
    known = {make.input(*at): make.constant(r.low) for at, r in ranges.items() if r.low == r.high}
    for e in in_order(roots):
        if e.op not in ("min", "max"):
            continue
        a, b = (make.substituted(x, known) for x in e.of)
        of_a, of_b = enclosed_ranges([a, b], ranges)
        smaller = a if of_a.high <= of_b.low else b if of_b.high <= of_a.low else None
        if smaller is not None:
            larger = b if smaller is a else a
            known[e] = smaller if e.op == "min" else larger
    return [make.substituted(e, known) for e in roots]


HALVINGS, TRIED = 12, 500
HOW_FAR = "how far SC moves"
TOO_MANY = "is more than a step of the DM can do"
"""Stands in the message that SC takes too many operations until it rests."""
OLD = 8
"""If reads may be older than so many periods of SC, their age makes the check long."""


@dataclass
class RestClaims:
    """The results of the claims; each text says why a claim is not shown, or is "".

    `box` is B of rule 1; `ways` is Y, the later range of each state that `moves` does not name.
    `precision` is that of the check that flies; `kink` is its kink, if
    any. `astray` is a state in which a run does not come back, so that no younger read would help.
    `other` is a box that SC is shown to lead back into if B is not shown; empty if none was found.
    `ac_has_control` says whether AC has control at an exact estimate of the middle of the start.
    """

    box: dict[int, Interval] = field(default_factory=dict)
    ways: dict[int, Interval] = field(default_factory=dict)
    other: dict[int, Interval] = field(default_factory=dict)
    answers: str = ""
    kept: str = ""
    astray: int | None = None
    moves: str = ""
    start: str = ""
    ac_has_control: bool = False
    precision: int = PLAIN
    kink: Kink | None = None

    def write(self, path: Path) -> None:
        """Writes the results to a JSON file, with the exact ends of all ranges."""
        path.write_text(json.dumps(asdict(self)), encoding="utf-8")

    @classmethod
    def read(cls, path: Path) -> RestClaims:
        """The results from a file that `write` wrote."""
        stored = json.loads(path.read_text(encoding="utf-8"))
        for name in ("box", "ways", "other"):
            stored[name] = {int(s): Interval(**r) for s, r in stored[name].items()}
        stored["kink"] = stored["kink"] and Kink(**stored["kink"])
        return cls(**stored)


def rest_entry(check: TubeCheck, claims: RestClaims) -> dict[str, object]:
    """The part of a certificate for `rest`: the constants of the check, and B and Y if shown."""
    problem, times = check.problem, check.times
    names, errors = [s.name for s in problem.quantities.states], check.error_by_state()
    rest: dict[str, object] = {
        "within_ns": problem.within_ns,
        "alpha_ns": times.earliest,
        "switches": times.switches,
        "reads": {
            problem.leaf_of_state(s): {"state": names[s], "within": errors[s].hex()}
            for s in check.states
        },
        "moves": {
            names[s]: [x.hex() if isfinite(x) else None for x in (d.below, d.above)]
            for s, d in problem.drifts.items()
            if s in check.states
        }
        | {
            names[s]: [None if abs(x) == FARTHEST else x.hex() for x in (r.low, r.high)]
            for s, r in claims.ways.items()
            if s not in {*claims.box, *check.turning}
        },
    } | ({"wraps": [names[s] for s in check.turning]} if check.turning else {})
    if not claims.kept:
        for key, ranges in (("box", claims.box), ("ways", claims.ways)):
            rest[key] = {names[s]: [ranges[s].low.hex(), ranges[s].high.hex()] for s in claims.box}
    rest |= variables_entry(check.variables)
    rest |= kink_entry(claims.kink, names)
    if (shield := problem.module.shield) is not None:
        ns = {"acted_ns": problem.times.replaced_window, "any_command_ns": times.any_command}
        rest["shield"] = {"cells": shield.cells, **ns}
    return rest


def show_rest_claims(check: TubeCheck) -> RestClaims:
    """Gives the results of all claims; a claim that needs a failed claim has the same text.

    Raises `SoterError` R007 if the check takes more operations than a step may.
    """
    try:
        return _claims_in_order(check)
    except TooLongError:
        raise too_long_error(check) from None


def _claims_in_order(check: TubeCheck) -> RestClaims:
    claims = RestClaims()
    if check.times.switches < 1:
        claims.kept = claims.start = "`within` of `rest` is shorter than a period of SC"
        return claims
    caller = Caller(check.offline_text({}))
    claims.answers = _why_sc_may_fault(check, caller)
    claims.kept = claims.answers or _why_not_kept(check, caller, claims)
    claims.precision = check.precision
    if not claims.kept:
        phase(f"{check.problem.name}: how far SC moves what `moves` names")
        at = {s: claims.ways.get(s, check.rooms[s]) for s in check.states}
        unread = Interval(0.0, 0.0)  # without a set: `_why_not_kept` saw that nothing reads it
        at = {s: r if isfinite(r.high - r.low) else unread for s, r in at.items()}
        claims.moves = why_drift_not_shown(check, caller, at, claims.box)
    phase(f"{check.problem.name}: whether SC leads to rest from the start")
    if claims.kept:
        claims.start = claims.kept
        return claims
    caller = CompiledCaller(check.offline_text(claims.ways))
    claims.start = _why_start_not_at_rest(check, caller)
    if claims.start and is_start_collected(check, claims.ways):
        caller = CompiledCaller(check.offline_text(claims.ways))
        claims.start = _why_start_not_at_rest(check, caller)
    claims.kink = check.kink
    claims.ac_has_control = is_control_given(check, claims.ways)
    if not (claims.start or claims.ac_has_control) and check.answers_vary:
        claims.ac_has_control = choose_precision_that_gives_control(check, claims.ways)
        claims.precision = check.precision
    return claims


def too_long_error(check: TubeCheck) -> SoterError:
    """The error R007 for a `rest` with too many operations; it advises a `within` that would fit.

    The cost per step is measured from two steps to three, as the first step costs differently. Then
    fewer steps are tried until they fit.
    """
    times = check.times
    needs, fits = "", 0
    with contextlib.suppress(TooLongError):
        two, three = (check.offline_operations(n) for n in (2, 3))
        needs = f" takes {two + (times.switches - 2) * (three - two):.2g} operations, which"
        fits = max((MAX_OPERATIONS - two) // (three - two) + 2, 0)
        while fits > 3 and not _fits_into_one_step(check, fits):
            fits -= 1 + fits // 100
    why = (
        f"to follow {times.switches} steps of SC{needs} {TOO_MANY}: {MAX_OPERATIONS:.2g} operations"
    )
    longest = show_ns(fits * times.period + times.jitter).replace(" ", "")
    fewer = "a longer period of SC, of which there are fewer steps then"
    within = f"`within {longest}` at most, {fits} steps of SC"
    if times.depth > OLD:
        fewer = (
            f"younger reads (`age`, `max_age`, `dropout`): SC answers {times.depth} periods late"
        )
    return refusal(check.problem, why, (within, fewer) if fits else (fewer, "fewer states"))


def _fits_into_one_step(check: TubeCheck, switches: int) -> bool:
    with contextlib.suppress(TooLongError):
        return check.offline_operations(switches) <= MAX_OPERATIONS
    return False


def _state_name(check: TubeCheck, state: int) -> str:
    return check.problem.quantities.states[state].name


def _first_without_set(check: TubeCheck, states: Sequence[int]) -> str:
    """The name of the first of `states` whose range has no bound; "" if all have bounds."""
    rooms = check.rooms
    return next(
        (_state_name(check, s) for s in states if not isfinite(rooms[s].high - rooms[s].low)), ""
    )


def _why_sc_may_fault(check: TubeCheck, caller: Caller) -> str:
    """Why SC may fault, or publish outside a topic's set, on some read, in words; "" if not."""
    sets = {s: cut_to_farthest(check.read_sets[s]) for s in check.read_by_law}
    if caller.returns_true("answers", box_ends(check, sets)):
        return ""
    fault = f": {caller.fault}" if caller.fault else ""
    return (
        f"on something in the sets of what it reads SC may fault, or publish what is outside{fault}"
    )


def _why_not_kept(check: TubeCheck, caller: Caller, claims: RestClaims) -> str:
    """Why SC is not shown to keep a box around rest (rule 1), or ""; fills in `claims`."""
    problem = check.problem
    free = _free_states(check)
    boxed = [s for s in check.states if s not in {*problem.drifts, *free, *check.turning}]
    named = [s for s in check.states if s in problem.drifts]
    read = check.read_by_law | check.read_by_rates | check.read_by_rest
    if name := _first_without_set(check, [s for s in named if s in read]):
        return f"{name} moves, is read, and nothing bounds it (a set of its topic would)"
    bounded = {*read, *boxed, *check.turning}
    sets = {s: cut_to_farthest(check.rooms[s]) for s in check.states if s in bounded}
    box = _box_around_rest(check, caller, sets, boxed)
    if box is None:
        return "`rest` holds nowhere in the sets of what it reads"
    if not _holds_somewhere(check, caller, box, "surely_rests"):
        return "no state was found in which `rest` certainly holds: nothing is said of none"
    claims.box = {s: box[s] for s in boxed}
    led = way_back(check, caller, box, boxed)
    claims.ways, claims.astray, claims.other = led.ways, led.astray, led.other
    if led.why or not (free or check.turning):
        return led.why
    claims.ways = led.ways | dict.fromkeys(free, Interval(-FARTHEST, FARTHEST))
    claims.ways |= {s: check.rooms[s] for s in check.turning}
    return _why_never_safe(check, claims, box, [*free, *check.turning])


def _free_states(check: TubeCheck) -> list[int]:
    """The states for which neither `rest` nor `moves` nor a set gives bounds.

    The rate of each depends on none of these states, so none becomes infinite in finite time.
    """
    asked = {*check.problem.drifts, *check.read_by_rest}
    ends = ((s, check.rooms[s]) for s in check.states if s not in asked)
    free = {s for s, r in ends if r.low == -inf and r.high == inf}
    rates = ((s, in_order([check.rates[s]])) for s in sorted(free))
    bounded = {*check.states} - free
    return [
        s
        for s, of in rates
        if {e.of[1] for e in of if e.op == "input" and e.of[0] == "x"} <= bounded
    ]


def _why_never_safe(
    check: TubeCheck, claims: RestClaims, box: Mapping[int, Interval], free: Sequence[int]
) -> str:
    """Why no state at rest is shown safe for all values of the states `free`; "" if one is."""
    names = ", ".join(_state_name(check, s) for s in free if s in check.read_by_safe)
    if not names or _holds_somewhere(
        check, Caller(check.offline_text(claims.ways)), box, "stays_safe"
    ):
        return ""
    return f"nowhere at rest does `safe` hold whatever {names} may be, and nothing bounds that"


def _box_around_rest(
    check: TubeCheck, caller: Caller, sets: dict[int, Interval], boxed: Sequence[int]
) -> dict[int, Interval] | None:
    """A box outside of which `rest` certainly fails; None if `rest` holds nowhere."""
    box = dict(sets)
    if caller.returns_true("never_rests", box_ends(check, box)):
        return None
    for s in boxed:
        box[s] = _side_narrowed_by_powers(check, caller, box, s)
        for upper in (False, True):
            box[s] = _side_narrowed_by_halving(check, caller, box, s, upper=upper)
    return None if caller.returns_true("never_rests", box_ends(check, box)) else box


def _holds_somewhere(
    check: TubeCheck, caller: Caller, box: Mapping[int, Interval], predicate: str
) -> bool:
    """Whether a condition certainly holds in at least one of the box's states that are tried."""
    draw, ends = random.Random(0), [(r.low, r.high) for r in box.values()]  # noqa: S311 - no secret
    usual = [(a / 2 + b / 2, min(max(0.0, a), b), a, b) for a, b in ends]
    states = [[draw.choice((*u, draw.uniform(u[2], u[3]))) for u in usual] for _ in range(TRIED)]
    every = (dict(zip(box, x, strict=True)) for x in ([u[0] for u in usual], *states))
    tried = ({s: Interval(v, v) for s, v in x.items()} for x in every)
    return any(caller.returns_true(predicate, box_ends(check, at)) for at in tried)


def _side_narrowed_by_powers(
    check: TubeCheck, caller: Caller, box: dict[int, Interval], s: int
) -> Interval:
    """The side `s` cut to the least power of ten beyond which `rest` fails, if it has no set."""
    low, high = box[s].low, box[s].high
    if not is_far(check.rooms[s]):
        return box[s]
    for end in (10.0**k for k in range(99, -10, -1)):
        beyond = (Interval(low, -end), Interval(end, high))
        if not all(
            caller.returns_true("never_rests", box_ends(check, {**box, s: r})) for r in beyond
        ):
            break
        low, high = -end, end
    return Interval(low, high)


def _side_narrowed_by_halving(
    check: TubeCheck, caller: Caller, box: dict[int, Interval], s: int, *, upper: bool
) -> Interval:
    """The side `s` with one end moved inward by bisection; `rest` fails in the part cut off."""
    low, high = box[s].low, box[s].high
    outer, inner = (high, low) if upper else (low, high)
    for _ in range(HALVINGS):
        middle = 0.5 * (outer + inner)
        off = Interval(middle, high) if upper else Interval(low, middle)
        if caller.returns_true("never_rests", box_ends(check, {**box, s: off})):
            outer = middle
        else:
            inner = middle
    return Interval(low, outer) if upper else Interval(outer, high)


def _why_start_not_at_rest(check: TubeCheck, caller: Caller) -> str:
    """Why SC is not shown to lead every start to rest (condition 6), in words; "" if it is."""
    initial = {s: check.problem.initial[s] for s in check.states}
    if any(map(is_far, initial.values())):
        return f"it is beyond {FARTHEST:g}"
    if caller.returns_true("starts", box_ends(check, initial)):
        return ""
    return f"from {box_in_words(check, initial)} SC is not certainly led to rest"

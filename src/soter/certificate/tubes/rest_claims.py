"""What a module with `rest` claims before anything flies, checked again by another tube.

Purpose: `show_rule_1` and `show_rule_2` show the two rules of rest ("Decisions by tubes",
proof-flight.md). Rule 1 is about the box B and the ways Y that a certificate
names, a range each for every followed state that `moves` does not name: `rest` holds only in B, and
SC then keeps the states in Y. Rule 2 is about what `moves` says. `slopes_in_input` encloses
derivatives of a term.
Non-goals: the start and single estimates (`tube_chains.py`); finding B and Y.

`slopes_in_input` is a ball, by the chain rule, atom by atom, over the range of each; at kinks it
encloses Clarke's derivative. By the mean value theorem (Lebourg's, of Lipschitz functions) a term
differs between two values of the input by a number in that ball times how far these are apart.

Rule 1: outside of B, in the sets of states, `rest` certainly does not hold, B is in Y, and from all
of B, whatever acted before, a chain of SC is in Y until all states in which some later output
begins to act are in B again. States that `moves` names are anything in their sets, whenever they
are read. So are states of other groups, where rates and answers of SC fall into groups that read
nothing of each other: of each group the rule holds by itself, as that of products does; one that no
command moves is the same at every instant. The sets are boxes of doubles, as C is meant here
(`rest_problem.py`).

Rule 2, of a state z and V = sum c_i |x_i|, x_i others: +-z' + V' is at most 0 for all states in Y,
all disturbances, and commands each of which SC answers to something that was read in Y, or in what
leads to Y within d. One x_i after the other is put to 0 in z'. What z' loses by that, D_i, is at
most the integral over its slope in x_i, by the rules of derivatives over ranges (Clarke's, where it
has kinks); in the end z' is not positive. D_i + c_i |x_i|' <= 0 on x_i >= 0 (x_i <= 0 likewise) on
a part of Y where these two ranges say it, and where it is so in x_i = 0 and does not grow from
there on. Where x_i stays 0 for a while, both are 0. Where no c_i is found x_i is not put to 0.
"""

from __future__ import annotations

import random
from math import inf
from typing import TYPE_CHECKING, NamedTuple

from flint import arb

from soter.certificate.grid.flow_chains import NOW
from soter.certificate.grid.flow_enclosures import is_within
from soter.certificate.reading.case_model import ends_of_other_states, new_command_terms
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.compile_terms import all_certain, compile_lines, form_of_box
from soter.certificate.terms.linear_enclosures import (
    HALF,
    ONE,
    UNIT,
    ZERO,
    exact,
    hull,
    lower,
    upper,
)
from soter.certificate.terms.straight_line import NotCertainError
from soter.certificate.terms.terms import Terms, atoms_under, input_atoms
from soter.certificate.tubes.rest_problem import (
    A_TURN,
    NANOSECOND,
    RestModel,
    cut_point,
)
from soter.certificate.tubes.tube_chains import (
    ConditionOnBoxes,
    StateSet,
    TubeChain,
    TubeFlow,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.certificate.terms.terms import Atom, Linear, Proposition
    from soter.certificate.tubes.rest_problem import Range, RestProblem
    from soter.certificate.tubes.tube_chains import Box

    Ranges = Mapping[int, Range]
    """State -> its range."""


HALVINGS, SPLITS, PIECES = 24, 8, ((1, 16), (2,), (4,))
"""How often a slab outside of B, and B itself, is halved; the numbers of steps of a hold that are
tried after 0, 1 and more cuts."""
TRIED = 500
"""How many states are tried until `rest` holds in one."""
PARTS = 16
"""Into so many parts Y is cut on each side of 0, for rule 2."""


class NoSlopeError(Exception):
    """Raised if a term may jump in the input, or has an atom whose slope is not known."""


def slopes_in_input(terms: Terms, x: Linear, at: int) -> arb:
    """A ball around all slopes of a term in the input atom `at`; NoSlopeError if it has none."""
    slopes: dict[int, arb] = {at: ONE}

    def slopes_of(x: Linear) -> arb:
        if not x.radius.is_zero():
            raise NoSlopeError
        return sum((c * slopes[a] for a, c in x.terms.items()), ZERO)

    for index in sorted(atoms_under(terms, [x])):
        atom = terms.atoms[index]
        if index == at:
            continue
        roots: list[Linear | Proposition] = [*atom.arguments]
        roots += [] if atom.condition is None else [atom.condition]
        if at not in input_atoms(terms, roots):
            slopes[index] = ZERO
            continue
        if not atom.extra.is_zero() or atom.kind not in _RULES:
            raise NoSlopeError
        slopes[index] = _RULES[atom.kind](atom, [slopes_of(y) for y in atom.arguments])
    return slopes_of(x)


def _range_as_ball(x: Linear) -> arb:
    return hull(x.low, x.high)


def _slope_rule(factor: Callable[[arb], arb]) -> Callable[[Atom, list[arb]], arb]:
    """The slope rule of a function of one number: `factor` gives the derivative over a range."""
    return lambda atom, slopes: factor(_range_as_ball(atom.arguments[0])) * slopes[0]


def _kink_rule(beneath: arb, between: arb) -> Callable[[Atom, list[arb]], arb]:
    """The slope rule of max(x, 0) or |x|: 1 if x > 0, `beneath` if x < 0, else `between`."""

    def rule(atom: Atom, slopes: list[arb]) -> arb:
        (x,) = atom.arguments
        return slopes[0] * (ONE if x.low >= 0 else beneath if x.high <= 0 else between)

    return rule


def _product_rule(atom: Atom, slopes: list[arb]) -> arb:
    a, b = map(_range_as_ball, atom.arguments)
    return a * slopes[1] + b * slopes[0]


def _extreme_rule(atom: Atom, slopes: list[arb]) -> arb:
    """The slope of a min or max: that of the argument it surely equals, else of both."""
    one, _, other = atom.arguments
    if one.high <= other.low or other.high <= one.low:
        is_first = (one.high <= other.low) == (atom.kind == "min")
        return slopes[0] if is_first else slopes[2]
    return slopes[0].union(slopes[2])


def _power_rule(atom: Atom, slopes: list[arb]) -> arb:
    """The slope of x^y: y x^(y - 1) by x, and x^y log x by y if y depends on the input."""
    x, y = map(_range_as_ball, atom.arguments)
    by_x: arb = y * x ** (y - 1) * slopes[0]
    return by_x if slopes[1].is_zero() else by_x + x**y * x.log() * slopes[1]


_RULES: dict[str, Callable[[Atom, list[arb]], arb]] = {
    "product": _product_rule,
    "pow": _power_rule,
    "asin": _slope_rule(lambda x: 1 / (1 - x * x).sqrt()),
    "acos": _slope_rule(lambda x: -1 / (1 - x * x).sqrt()),
    "min": _extreme_rule,
    "max": _extreme_rule,
    "max0": _kink_rule(ZERO, hull(ZERO, ONE)),
    "abs": _kink_rule(-ONE, UNIT),
    "square": _slope_rule(lambda x: 2 * x),
    "inverse": _slope_rule(lambda x: -((1 / x) ** 2)),
    "sqrt": _slope_rule(lambda x: HALF / x.sqrt()),
    "soft_sign": _slope_rule(lambda x: (1 / (1 + abs(x))) ** 2),
    "sin": _slope_rule(lambda x: x.cos()),
    "cos": _slope_rule(lambda x: -x.sin()),
    "exp": _slope_rule(lambda x: x.exp()),
    "log": _slope_rule(lambda x: 1 / x),
    "tanh": _slope_rule(lambda x: 1 - x.tanh() ** 2),
    "atan": _slope_rule(lambda x: 1 / (1 + x * x)),
    "tan": _slope_rule(lambda x: 1 + x.tan() ** 2),
}


# ---------------------------------------------------------------- rule 1


def show_rule_1(problem: RestProblem, box: Ranges, ways: Ranges) -> None:
    """Checks rule 1 for B (`box`) and Y (`ways`); raises NotRecheckedError if it is not shown.

    Raises RejectedError if B does not lie within Y, or Y does not lie within the sets.
    """
    returning, sets = problem.returning_states, problem.sets
    for s in returning:
        low, high = box[s]
        least, most = ways[s]
        if not sets[s][0] <= least <= low <= high <= most <= sets[s][1]:
            raise RejectedError("P2a: the box of `rest` does not lie within its ways and sets")
    _require_rest_only_in(problem, box)
    if not returning:
        return
    model = RestModel(problem.facts, (), problem.facts.extents)
    times = problem.times
    turning = problem.facts.turning
    turns, free = (dict.fromkeys(turning, ends) for ends in (A_TURN, (-inf, inf)))
    every = {**box, **turns}, {**ways, **free}, {**box, **free}
    for group in _independent_state_groups(model, [*returning, *turning]):
        if turning.issuperset(group):
            continue
        flow = TubeFlow(model, group)
        chain = TubeChain(model, group, flow, times.chain, problem.topics_of(group))
        start, way, end = (_box_of_states(of, group) for of in every)
        if not _box_returns(chain, start, way, end, times.switches, 0):
            raise NotRecheckedError("P2a: SC does not certainly lead back to where `rest` holds")


def _independent_state_groups(model: RestModel, members: Sequence[int]) -> list[tuple[int, ...]]:
    """Groups of states; no rate or command of one group reads a state of another group."""
    terms, states = model.new_terms()
    controls = new_command_terms(model.facts, terms)
    commands, (rates, _) = model.sc_commands(terms, states), model.rates(terms, states, controls)
    groups: list[set[int]] = []
    for s in members:
        felt = input_atoms(terms, [rates[s]])
        answers = [u for c, u in zip(controls, commands, strict=True) if c.atom in felt]
        read = felt | input_atoms(terms, answers)
        near = {s, *(k for k in members if states[k].atom in read)}
        joined = [g for g in groups if g & near]
        groups = [*(g for g in groups if not g & near), near.union(*joined)]
    return [tuple(sorted(g)) for g in groups]


def _box_returns(chain: TubeChain, start: Box, way: Box, end: Box, holds: int, cut: int) -> bool:
    """Whether all runs from `start` are in `way` until an output acts in `end`; may cut `start`."""
    every = PIECES[min(cut, len(PIECES) - 1)]
    if any(_leads_back(chain, start, way, end, holds, pieces) for pieces in every):
        return True
    if cut == SPLITS:
        return False
    sizes = [
        float((b - a) / (d - c if d.is_finite() else ONE)) if d > c else 0.0
        for (a, b), (c, d) in zip(start, end, strict=True)
    ]
    axis = sizes.index(max(sizes))
    low, high = start[axis]
    middle = ((low + high) * HALF).mid()
    halves = ((low, middle), (middle, high))
    return all(
        _box_returns(chain, [*start[:axis], h, *start[axis + 1 :]], way, end, holds, cut + 1)
        for h in halves
    )


def _leads_back(chain: TubeChain, start: Box, way: Box, end: Box, holds: int, pieces: int) -> bool:
    """Whether a chain from `start` is in `way` until all states of a later switch are in `end`."""
    body, late = StateSet.from_box(start), bool(chain.span)
    try:
        for n in range(holds + 1):
            if n and not late and is_within(body.box, end):
                return True
            body, boxes = chain.follow_hold(body, pieces)
            for k, box in enumerate(boxes):
                if not is_within(box, way):
                    return False
                if n and late and k == 0 and is_within(box, end):
                    return True
    except NotCertainError:
        return False
    return False


def _box_of_states(ranges: Ranges, states: tuple[int, ...]) -> Box:
    return [(exact(ranges[s][0]), exact(ranges[s][1])) for s in states]


def _require_rest_only_in(problem: RestProblem, box: Ranges) -> None:
    """Raises NotRecheckedError unless `rest` holds somewhere in a box, nowhere else in the sets."""
    model = RestModel(problem.facts, (), problem.facts.extents)
    rest = ConditionOnBoxes(
        model,
        problem.followed,
        lambda t, x: model.truth_of(t, x, problem.rest.condition, errors=False),
    )
    at = {s: (exact(a), exact(b)) for s, (a, b) in enumerate(problem.facts.extents)}
    for s in problem.returning_states:
        low, high = map(exact, box[s])
        for slab in ((at[s][0], low), (high, at[s][1])):
            if slab[0] < slab[1] and not _is_false_on_slab(rest, problem, {**at, s: slab}, s, 0):
                name = problem.facts.states[s].name
                raise NotRecheckedError(f"P2a: `rest` may hold outside of its box, by {name}")
        at[s] = low, high
    if not _holds_somewhere(rest, [at[k] for k in problem.followed]):
        raise NotRecheckedError("P2a: no state is known in which `rest` holds: of none all is true")


def _holds_somewhere(rest: ConditionOnBoxes, box: Box) -> bool:
    """Whether the condition certainly holds at any of some hundred points of the box."""
    draw, ends = random.Random(0), [(lower(a), upper(b)) for a, b in box]  # noqa: S311 - no secret
    usual = [(a / 2 + b / 2, min(max(0.0, a), b), a, b) for a, b in ends]
    points = [[draw.choice((*u, draw.uniform(u[2], u[3]))) for u in usual] for _ in range(TRIED)]
    middle = [u[0] for u in usual]
    return any(rest.is_certain([(exact(x), exact(x)) for x in p]) for p in (middle, *points))


def _is_false_on_slab(
    rest: ConditionOnBoxes, problem: RestProblem, at: dict[int, tuple[arb, arb]], s: int, cut: int
) -> bool:
    """Whether `rest` certainly fails wherever state `s` is in its range; may halve the range."""
    if rest.is_certainly_false([at[k] for k in problem.followed]):
        return True
    if cut == HALVINGS:
        return False
    low, high = at[s]
    middle = cut_point(low, high)
    halves = ((low, middle), (middle, high))
    return all(_is_false_on_slab(rest, problem, {**at, s: h}, s, cut + 1) for h in halves)


# ---------------------------------------------------------------- rule 2


class AtRest(NamedTuple):
    """The ranges of the states once `rest` holds, and of the commands that SC then gives."""

    states: dict[int, tuple[arb, arb]]
    commands: list[tuple[arb, arb]]


def show_rule_2(problem: RestProblem, box: Ranges, ways: Ranges) -> None:
    """Checks rule 2 for each state that `moves` names; NotRecheckedError if it is not shown."""
    if not problem.moving_states:
        return
    try:
        commands = _command_ranges(problem, ways)
    except NotCertainError:
        raise NotRecheckedError("P2a: what SC answers at rest is not bounded") from None
    ranges = dict(enumerate(problem.facts.extents)) | dict(ways)
    at_rest = AtRest({s: (exact(a), exact(b)) for s, (a, b) in ranges.items()}, commands)
    terms, *_ = _rates(problem, at_rest)
    if not all_certain(terms, terms.obligations):
        raise NotRecheckedError("P2a: a plant's equation is not defined everywhere at rest")
    for z in problem.moving_states:
        for sign, by in zip((-1, 1), problem.drifts[z], strict=True):
            if by < inf and not _is_growth_below(problem, z, sign * ONE, by, box, at_rest):
                name = problem.facts.states[z].name
                raise NotRecheckedError(f"P2a: how far SC moves {name} is not shown")


def _command_ranges(problem: RestProblem, ways: Ranges) -> list[tuple[arb, arb]]:
    """The range of each of SC's answers to reads in Y, or in states that lead to Y within d."""
    model = RestModel(problem.facts, (), problem.facts.extents)
    members, box = problem.returning_states, _box_of_states(ways, problem.returning_states)
    if problem.times.delay:
        flow = TubeFlow(model, members)
        past = flow.enclose(box, flow.ranges, -problem.times.delay * NANOSECOND, NOW).box
        box = [(a.min(c), b.max(d)) for (a, b), (c, d) in zip(box, past, strict=True)]
    terms, states = model.new_terms()
    commands = model.sc_commands(terms, states)
    atoms = [states[s].atom for s in members]
    others = ends_of_other_states(model, states, members)
    for (low, high), a in zip(box, atoms, strict=True):
        if not (low >= terms.atoms[a].low and high <= terms.atoms[a].high):
            raise NotCertainError
    lines = compile_lines(terms, atoms, 0, commands, terms.obligations, others)
    found = lines(form_of_box(box, symbols=False))
    if found is None:
        raise NotCertainError
    width = len(members) + 4
    ends = [(found[k * width - 2], found[k * width - 1]) for k in range(1, len(commands) + 1)]
    return [
        (a.max(exact(c.low)), b.min(exact(c.high)))
        for (a, b), c in zip(ends, problem.facts.controls, strict=True)
    ]


def _is_growth_below(
    problem: RestProblem, z: int, sign: arb, by: float, rests: Ranges, at_rest: AtRest
) -> bool:
    """Whether z grows by at most `by` if `sign` is 1, or falls by at most `by` if it is -1."""
    total, held = ZERO, at_rest
    for x in problem.returning_states:
        if _rate_bound(problem, z, sign, held) <= 0:
            break
        c = _outweighing_factor(problem, z, sign, x, held)
        if c < inf:
            total += exact(c) * exact(max(map(abs, rests[x])))
            held = AtRest({**held.states, x: (ZERO, ZERO)}, held.commands)
    return bool(_rate_bound(problem, z, sign, held) <= 0 and total <= exact(by))


def _rate_bound(problem: RestProblem, z: int, sign: arb, at_rest: AtRest) -> arb:
    terms, _, rates = _rates(problem, at_rest)
    return terms.combine(((sign, rates[z]),)).high


def _outweighing_factor(problem: RestProblem, z: int, sign: arb, x: int, at_rest: AtRest) -> float:
    """A c such that c |x| outweighs the effect of x on z'; 0 for no effect, inf if unknown."""
    found = [
        _factor_on_side(problem, (z, x), (sign, side), far, at_rest)
        for side, far in zip((-ONE, ONE), at_rest.states[x], strict=True)
        if side * far > 0
    ]
    return max(c for c, _ in found) if any(adds for _, adds in found) else 0.0


def _factor_on_side(
    problem: RestProblem, of: tuple[int, int], signs: tuple[arb, arb], far: arb, at_rest: AtRest
) -> tuple[float, bool]:
    """The factor on side `signs[1]` for x up to `far`, and whether x adds to z' on that side."""
    (z, x), (sign, side) = of, signs

    def rates_on_span(span: tuple[arb, arb]) -> tuple[Terms, list[Linear], list[Linear]]:
        return _rates(problem, AtRest({**at_rest.states, x: span}, at_rest.commands))

    adds, by_slope, by_range, added = ZERO, [], [], []
    for k in range(PARTS):
        ends = [far * i / PARTS for i in (k, k + 1)]
        terms, states, rates = rates_on_span((ends[0].min(ends[1]), ends[0].max(ends[1])))
        at = states[x].atom
        added.append(_upper_end(side * sign * _slopes_or_nan(terms, rates[z], at)))
        before, adds = adds, adds + exact(added[-1]) * abs(far) / PARTS
        by_slope.append(_covering_factor(exact(added[-1]), -_slopes_or_nan(terms, rates[x], at)))
        by_range.append(
            _covering_factor(before.max(adds), -terms.combine(((side, rates[x]),)).high)
        )
    terms, _, rates = rates_on_span((ZERO, ZERO))
    first = terms.combine(((side, rates[x]),)).high <= 0
    last = PARTS if first else 0
    c = min(max([*by_slope[:m], *by_range[m:]]) for m in range(last + 1))
    return c, max(added) > 0


def _slopes_or_nan(terms: Terms, x: Linear, at: int) -> arb:
    try:
        return slopes_in_input(terms, x, at)
    except NoSlopeError:
        return arb.nan()


def _upper_end(x: arb) -> float:
    return upper(x.upper()) if x.is_finite() else inf


def _covering_factor(adds: arb, falls: arb) -> float:
    """A c with `adds` <= c `falls`; 0 if nothing is added, inf if no such c exists."""
    if not (adds.is_finite() and falls.is_finite()):
        return inf
    if adds <= 0 and falls >= 0:
        return 0.0
    return _upper_end(adds / falls.lower()) if falls > 0 else inf


def _rates(problem: RestProblem, at_rest: AtRest) -> tuple[Terms, list[Linear], list[Linear]]:
    """The terms, the states and their rates over `at_rest`; a state surely 0 is a constant."""
    facts, terms = problem.facts, Terms()
    states = []
    for s, state in enumerate(facts.states):
        low, high = at_rest.states[s]
        known = bool(low == 0 and high == 0)
        states.append(
            terms.constant(0.0) if known else terms.add_input("state", state.name, low, high)
        )
    controls = [
        terms.add_input("box", u.name, *r)
        for u, r in zip(facts.controls, at_rest.commands, strict=True)
    ]
    model = RestModel(facts, (), facts.extents)
    rates, _ = model.rates(terms, states, controls)
    return terms, states, rates

"""What is claimed of a module with `rest` before anything flies, shown by another tube.

Purpose: condition 3 (`answers`) and the two rules of rest ("Decisions by tubes", docs/proof.md):
`keeps`, of the box B and the ways Y of a certificate, and `drifts`, of what `moves` says.
Non-goals: the start and single estimates (`flight_verdict.py`); finding B and Y.

Rule 1: outside of B `rest` certainly does not hold, B is in Y, and from all of B, whatever acted
before, a chain of SC is in Y until all states in which some later output begins to act are in B
again. States that `moves` names are anything in their sets, whenever they are read.

Rule 2, of a state z and V = c |x|, x another state: phi = +-z' + c |x|' is at most 0 for all states
in Y, all disturbances, and commands each of which SC answers to something that was read in Y, or in
what leads to Y within d. On x >= 0 (x <= 0 likewise) that is so on a part of Y where the range of
phi says it, and where it is so in x = 0 and phi does not grow from there on: its slope in x, by the
rules of derivatives over ranges (Clarke's, where it has kinks), is not positive.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import TYPE_CHECKING, NamedTuple

from soter.certificate.format.errors import NotRecheckedError, RejectedError
from soter.certificate.grid.flow_chains import NOW
from soter.certificate.reading.definedness import all_certain
from soter.certificate.reading.map_steps import atom_of, boxes_of
from soter.certificate.reading.module_facts import read_by_sc
from soter.certificate.reading.symbolic_values import filled
from soter.certificate.terms.arb_balls import HALF, ONE, exact
from soter.certificate.terms.compile_terms import compile_lines, form_of_box
from soter.certificate.terms.operations import NotCertainError
from soter.certificate.terms.terms import Terms
from soter.certificate.time.sc_on_default_inputs import harmless
from soter.certificate.tubes.rest_problem import NANOSECOND, WIDE, RestModel
from soter.certificate.tubes.slopes import NoSlopeError, slope
from soter.certificate.tubes.truths import Truths
from soter.certificate.tubes.tube_chains import Body, TubeChain, TubeFlow
from soter.language.model.types import FloatType, leaves

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flint import arb

    from soter.certificate.terms.terms import Linear
    from soter.certificate.tubes.rest_problem import Range, RestProblem
    from soter.certificate.tubes.tube_chains import Box

    Ranges = Mapping[int, Range]
    """By state."""

HALVINGS, SPLITS, PIECES = 24, 3, (1, 2, 4, 4)
"""How often a slab outside of B, and B itself, is halved; how many steps a hold then has."""
PARTS = 16
"""Of the ways on each side of 0, for rule 2."""


def answers(problem: RestProblem) -> None:
    """SC faults on nothing that its topics may hold, and answers within its sets; or RejectedError.

    What has no set may be anything. NotRecheckedError where it is no float.
    """
    facts, terms, known = problem.facts, Terms(), {}
    for symbol in read_by_sc(facts.sc):
        topic, parts = facts.system.topics[facts.sc.scope.topics[symbol]], []
        for (_, of), b in zip(leaves(topic.type), topic.bounds, strict=True):
            if not isinstance(of, FloatType):
                raise NotRecheckedError(f"SC reads what is no float of `{topic.name}`")
            ends = (-WIDE, WIDE) if b is None else (b.low, b.high)
            parts.append(terms.input("box", topic.name, *map(exact, ends)))
        known[symbol] = filled(topic.type, parts)
    if not harmless(facts, terms, known):
        raise RejectedError(
            "P2a: SC may fault on something that it may read, or answer outside of its sets"
        )


# ---------------------------------------------------------------- rule 1


def keeps(problem: RestProblem, box: Ranges, ways: Ranges) -> None:
    """Rule 1 of B and Y, by state; RejectedError where it is not shown.

    NotRecheckedError where a state has no set.
    """
    own, sets = problem.own, problem.sets
    for s in own:
        low, high = box[s]
        least, most = ways[s]
        if not all(map(isfinite, sets[s])):
            raise NotRecheckedError(f"nothing bounds `{problem.facts.states[s].name}`")
        if not sets[s][0] <= least <= low <= high <= most <= sets[s][1]:
            raise RejectedError("P2a: the box of `rest` does not lie within its ways and sets")
    _holds_only_in(problem, box)
    if not own:
        return
    model = RestModel(problem.facts, (), problem.facts.extents, far=False)
    times = problem.times
    chain = TubeChain(model, own, TubeFlow(model, own), times.holds)
    way, end = _ends(ways, own), _ends(box, own)
    if not _returns(chain, end, way, end, times.switches, 0):
        raise RejectedError("P2a: SC does not certainly lead back to where `rest` holds")


def _returns(chain: TubeChain, start: Box, way: Box, end: Box, holds: int, cut: int) -> bool:
    """Whether every rest run from `start` is in `way` until some output acts within `end`."""
    if _leads_back(chain, start, way, end, holds, PIECES[cut]):
        return True
    if cut == SPLITS:
        return False
    sizes = [
        float((b - a) / (d - c)) if d > c else 0.0
        for (a, b), (c, d) in zip(start, end, strict=True)
    ]
    axis = sizes.index(max(sizes))
    low, high = start[axis]
    middle = ((low + high) * HALF).mid()
    halves = ((low, middle), (middle, high))
    return all(
        _returns(chain, [*start[:axis], h, *start[axis + 1 :]], way, end, holds, cut + 1)
        for h in halves
    )


def _leads_back(chain: TubeChain, start: Box, way: Box, end: Box, holds: int, pieces: int) -> bool:
    body, late = Body.of(start), bool(chain.span)
    try:
        for n in range(holds + 1):
            if n and not late and inside(body.box, end):
                return True
            body, boxes = chain.hold(body, pieces)
            for k, box in enumerate(boxes):
                if not inside(box, way):
                    return False
                if n and late and k == 0 and inside(box, end):
                    return True
    except NotCertainError:
        return False
    return False


def inside(box: Box, other: Box) -> bool:
    """Whether a box lies in another one."""
    return all(a >= c and b <= d for (a, b), (c, d) in zip(box, other, strict=True))


def _ends(ranges: Ranges, states: tuple[int, ...]) -> Box:
    return [(exact(ranges[s][0]), exact(ranges[s][1])) for s in states]


def _holds_only_in(problem: RestProblem, box: Ranges) -> None:
    """`rest` holds nowhere in the sets of states outside of a box; RejectedError where it may."""
    model = RestModel(problem.facts, (), problem.facts.extents, far=False)
    rest = Truths(
        model,
        problem.followed,
        lambda t, x: model.predicate(t, x, problem.rest.condition, errors=False),
    )
    at = {s: (exact(a), exact(b)) for s, (a, b) in enumerate(problem.facts.extents)}
    for s in problem.own:
        low, high = map(exact, box[s])
        for slab in ((at[s][0], low), (high, at[s][1])):
            if slab[0] < slab[1] and not _nowhere(rest, problem, {**at, s: slab}, s, 0):
                name = problem.facts.states[s].name
                raise RejectedError(f"P2a: `rest` may hold outside of its box, by {name}")
        at[s] = low, high


def _nowhere(
    rest: Truths, problem: RestProblem, at: dict[int, tuple[arb, arb]], s: int, cut: int
) -> bool:
    if rest.nowhere([at[k] for k in problem.followed]):
        return True
    if cut == HALVINGS:
        return False
    low, high = at[s]
    middle = ((low + high) * HALF).mid()
    halves = ((low, middle), (middle, high))
    return all(_nowhere(rest, problem, {**at, s: h}, s, cut + 1) for h in halves)


# ---------------------------------------------------------------- rule 2


class AtRest(NamedTuple):
    """Where all states are once it rests, and what SC then answers."""

    states: dict[int, tuple[arb, arb]]
    commands: list[tuple[arb, arb]]


def drifts(problem: RestProblem, box: Ranges, ways: Ranges) -> None:
    """What `moves` says of each followed state; RejectedError where it is not shown."""
    if not problem.moving:
        return
    try:
        commands = _answered(problem, ways)
    except NotCertainError:
        raise RejectedError("P2a: what SC answers at rest is not bounded") from None
    ranges = dict(enumerate(problem.facts.extents)) | dict(ways)
    there = AtRest({s: (exact(a), exact(b)) for s, (a, b) in ranges.items()}, commands)
    terms, *_ = _phi(problem, problem.moving[0], problem.moving[0], (ONE, ONE), there)
    if not all_certain(terms, terms.obligations):
        raise RejectedError("P2a: a plant's equation is not defined everywhere at rest")
    for z in problem.moving:
        for sign, by in zip((-1, 1), problem.drifts[z], strict=True):
            if by < inf and not any(
                _bounded(problem, z, sign * ONE, by, x, box[x], there) for x in problem.own
            ):
                name = problem.facts.states[z].name
                raise RejectedError(f"P2a: how far SC moves {name} is not shown")


def _answered(problem: RestProblem, ways: Ranges) -> list[tuple[arb, arb]]:
    """What SC answers to whatever it reads in Y, and in what leads to Y within d."""
    model = RestModel(problem.facts, (), problem.facts.extents, far=False)
    own, box = problem.own, _ends(ways, problem.own)
    if problem.times.delay:
        flow = TubeFlow(model, own)
        past = flow.around(box, flow.ranges, -problem.times.delay * NANOSECOND, NOW).box
        box = [(a.min(c), b.max(d)) for (a, b), (c, d) in zip(box, past, strict=True)]
    terms, states = model.new_terms()
    commands = model.commands(terms, states)
    atoms = [atom_of(states[s]) for s in own]
    others = boxes_of(model, states, own)
    for (low, high), a in zip(box, atoms, strict=True):
        if not (low >= terms.atoms[a].low and high <= terms.atoms[a].high):
            raise NotCertainError
    lines = compile_lines(terms, atoms, 0, commands, terms.obligations, others)
    found = lines(form_of_box(box, symbols=False))
    if found is None:
        raise NotCertainError
    width = len(own) + 4
    ends = [(found[k * width - 2], found[k * width - 1]) for k in range(1, len(commands) + 1)]
    return [
        (a.max(exact(c.low)), b.min(exact(c.high)))
        for (a, b), c in zip(ends, problem.facts.controls, strict=True)
    ]


def _bounded(
    problem: RestProblem,
    z: int,
    sign: arb,
    by: float,
    x: int,
    rests: Range,
    there: AtRest,
) -> bool:
    """Whether z grows (`sign` 1), or falls (-1), by at most `by`, by V of x."""
    size = exact(max(abs(rests[0]), abs(rests[1])))
    if not size > 0:
        return False
    c = exact(by) / size
    for side, far in zip((-ONE, ONE), there.states[x], strict=True):
        if not side * far > 0:
            continue
        falls = True
        for k in range(-1, PARTS):
            ends = [far * max(k + i, 0) / PARTS for i in (0, 1)]
            span = (ends[0].min(ends[1]), ends[0].max(ends[1]))
            terms, phi, own = _phi(
                problem, z, x, (sign, side * c), AtRest({**there.states, x: span}, there.commands)
            )
            if k < 0:
                falls = bool(phi.high <= 0)
                continue
            try:
                falls = falls and bool(side * slope(terms, phi, atom_of(own)) <= 0)
            except NoSlopeError:
                falls = False
            if not (falls or phi.high <= 0):
                return False
    return True


def _phi(
    problem: RestProblem,
    z: int,
    x: int,
    factors: tuple[arb, arb],
    there: AtRest,
) -> tuple[Terms, Linear, Linear]:
    """The terms, factors of z' and x' in them, and x; where that is 0 it is a number."""
    facts, terms = problem.facts, Terms()
    states = []
    for s, state in enumerate(facts.states):
        low, high = there.states[s]
        known = s == x and bool(low == 0 and high == 0)
        states.append(terms.constant(0.0) if known else terms.input("state", state.name, low, high))
    controls = [
        terms.input("box", u.name, *r) for u, r in zip(facts.controls, there.commands, strict=True)
    ]
    model = RestModel(facts, (), facts.extents, far=False)
    rates, _ = model.rates(terms, states, controls)
    phi = terms.combine(((factors[0], rates[z]), (factors[1], rates[x])))
    return terms, phi, states[x]

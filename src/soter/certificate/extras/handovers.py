"""Whether `enters`, the predicate of a hand-over, holds only in R(H).

Purpose: a module with views is handed over where a node changes what the state of a view rests on.
`jumps_by_plant` says, for each topic that the map of a view reads, whether that is confirmed
(docs/proof-sets.md, "Hand-over"): that its node changes it only where `enters` holds, and that the
state lies in R(H) wherever that holds of an estimate (`why_not_entered`).
Non-goals: rejecting hand-overs: what is not confirmed is an assumption, and the report says why.
That a node changes a view in no other step (`induction/handover_jumps.py`); sharing code with
`verify/problem/`, which the prover goes by.

`enters` is judged on what a step publishes, which is the state after the jump up to the declared
errors. Nothing is known yet of that state: not that `safe` holds there, nor that it lies in a grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING

from soter.certificate.cell_predicates import (
    AdmitCheck,
    TruthOverBox,
    cells_wrongly_admitted,
    conjunction_of,
    influence_of_inputs,
)
from soter.certificate.extras.views import shown_part_of_enters
from soter.certificate.proof_methods import import_jump_check
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.folder import FREE
from soter.certificate.reading.module_facts import driven_topics, topics_read
from soter.certificate.reading.problem import state_published
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import (
    HALF,
    TINIEST,
    UNIT_ROUNDOFF,
    exact,
    lower,
    magnitude,
    upper,
)
from soter.certificate.terms.terms import and_of, conjuncts, input_atoms, negation
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import leaves

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flint import arb

    from soter.certificate.grid.grid_group import GridGroup
    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.report import Said
    from soter.certificate.terms.terms import Proposition, Terms
    from soter.language.model import typed

    Box = list[tuple[arb, arb]]
    Groups = Sequence[Sequence[GridGroup]]
    Jumps = Mapping[str, Sequence["Jump"]]
    """Name of an abstracting plant -> its jumps; nothing where a module has no `enters`."""


TRIES_BEYOND = 2_000
"""Boxes that a side of the grid is cut into at most, for each part of a predicate."""


@dataclass(frozen=True)
class Jump:
    """A topic that the map of a view reads, with the node that publishes it.

    `why`: why it is not confirmed that the state jumps into R(H) when the topic changes, or "".
    """

    topic: str
    node: str
    why: str


def jumps_by_plant(facts: Facts, groups: Groups, claims: set[str]) -> dict[str, list[Jump]]:
    """Maps each abstracting plant to its jumps; empty for a module without views or `enters`.

    `groups`: the groups of every case, with their confirmed `claims`.
    """
    if not facts.view or facts.whole is None or facts.whole.verify.enters is None:
        return {}
    jumps_by_link = {
        link.name: [_jump_of_topic(facts, link, topic) for topic in topic_reads(link.value)]
        for link in facts.symbol.verify.abstracts
    }
    if any(not jump.why for of in jumps_by_link.values() for jump in of):
        why = _why_not_in_r(facts, groups, claims)
        jumps_by_link = {
            name: [Jump(j.topic, j.node, j.why or why) for j in of]
            for name, of in jumps_by_link.items()
        }
    return jumps_by_link


def _jump_of_topic(facts: Facts, link: typed.AbstractionLink, topic: typed.TopicSymbol) -> Jump:
    """The jump of a topic, with the result of a z3 check of the node that publishes the topic."""
    if find_spec("z3") is None:
        return Jump(topic.name, "", "`z3-solver` is not installed")
    try:
        node, why = import_jump_check()(facts, link, topic)
    except Exception as error:  # noqa: BLE001 - whatever it is, nothing is confirmed
        return Jump(topic.name, "", _error_in_words(error))
    return Jump(topic.name, node, why)


def _why_not_in_r(facts: Facts, groups: Groups, claims: set[str]) -> str:
    """Why it is not confirmed that the state is in R(H) whenever `enters` holds; "" if it is."""
    if not claims & FREE:
        return "nothing is claimed with which R(H) is confirmed"
    try:
        assert facts.whole is not None
        expr = shown_part_of_enters(facts.whole, facts.symbol.verify)
        assert expr is not None
        scope = facts.module.scope.topics
        known = {i for of in topics_read(facts) for i in of}
        if not {scope.get(t, -1) for t in topic_reads(expr)} <= known:
            return "it reads what neither DM nor SC reads"
        for values, of_case in zip(facts.parameter_combinations(), groups, strict=True):
            if why := why_not_entered(CaseModel(facts, values, facts.extents), of_case, expr):
                return why
    except Exception as error:  # noqa: BLE001 - whatever it is, nothing is confirmed
        return _error_in_words(error)
    return ""


def _error_in_words(error: Exception) -> str:
    if isinstance(error, NotRecheckedError):
        return f"not rechecked: {error}"
    return f"the re-checker itself failed ({type(error).__name__}: {error})"


def jump_assumptions(facts: Facts, jumps: Jumps) -> Said:
    """Yields the assumptions on when the topics change that a view's state rests on."""
    for link in facts.symbol.verify.abstracts:
        tried = jumps.get(link.name, ())
        kept = {j.topic for j in tried if not j.why}
        shown = ", ".join(t.name for t in topic_reads(link.value) if t.name not in kept)
        why = "; ".join(f"{j.topic}: {j.why}" for j in tried if j.why)
        if shown:
            text = (
                f"where {shown} change, on which the state of {link.name} rests, that state moves "
                f"as {link.plant.name} does, or jumps while the estimate lies in S_0 of where it "
                "jumps to, whichever mode; DM and SC read what shows it from that instant on"
            )
            yield f"jumps {link.name}", text + f" (`enters` does not confirm it: {why})" * bool(why)


def confirmed_jumps(facts: Facts, jumps: Jumps) -> Said:
    """Yields the confirmed jumps, which are no longer assumptions."""
    assert facts.whole is not None
    assert facts.whole.verify.enters is not None
    text = facts.whole.verify.enters.span.text_on_one_line
    for name, entries in jumps.items():
        for jump in (j for j in entries if not j.why):
            why = (
                f"{jump.node} changes what the state of {name} rests on of {jump.topic} only in "
                "steps that show it to DM and SC, and of which, as they read and publish, "
                f"`{text}` holds; wherever that holds the state lies in R(H) of where it jumps to"
            )
            yield f"enters {name} {jump.topic}", why


# ---------------------------------------------------------------- where `enters` holds


def why_not_entered(model: CaseModel, groups: Sequence[GridGroup], expr: typed.TypedExpr) -> str:
    """Why, in one case, `expr` is not shown to hold only in R(H); "" if it is shown.

    `groups` contain each state once; it was shown that their R(H) leads only into K. `expr` reads
    only topics that the plants of the view drive. Raises NotRecheckedError for unknown code.
    """
    states = [s for g in groups for s in g.states]
    if sorted(states) != list(range(len(model.facts.states))):
        return "not every state is in a group"
    if any(g.tables.free is None for g in groups):
        return "there is no R(H)"
    reach = _state_ranges_by_reads(model.facts, expr)
    for k, ends in enumerate(reach):
        if ends is None:
            return f"nothing that it reads bounds {model.facts.states[k].name}"
        if ends[0] > ends[1]:
            return f"no value of {model.facts.states[k].name} is shown by all that it reads"
    where = _place_outside_grid(model, groups, expr, [r for r in reach if r is not None])
    if where:
        return f"it may hold where {where}, outside the grid"
    return next((why for g in groups if (why := place_entered_outside(g, model, expr))), "")


def place_entered_outside(group: GridGroup, model: CaseModel, expr: typed.TypedExpr) -> str:
    """A text about the place outside R(H) where `expr` may hold, or ""; `safe` may be false."""
    grid = group.tables.grid
    assert group.tables.free is not None
    check = AdmitCheck(model, group.tables, expr, admits=True, anywhere=True)
    failed = next(cells_wrongly_admitted(check, group.tables.free, grid.all_cells), None)
    if failed is None:
        return ""
    names = ", ".join(model.facts.states[s].name for s in group.states)
    return f"it may hold outside R(H), at {names} in {grid.block_in_words(failed)}"


# ---------------------------------------------------------------- outside the grid


def _state_ranges_by_reads(facts: Facts, expr: typed.TypedExpr) -> list[tuple[float, float] | None]:
    """The range of each state in which to judge `expr`; None if no topic that it reads bounds it.

    A published value lies in its declared set, and differs from the state by error and rounding.
    """
    ranges: list[tuple[float, float] | None] = [None] * len(facts.states)
    driven = driven_topics(facts)
    scope = facts.module.scope.topics
    read = [scope[t] for t in topic_reads(expr)]
    for index in read:
        c, value = driven[index]
        topic = facts.system.topics[index]
        for leaf, ((path, _), bound) in enumerate(
            zip(leaves(topic.type), topic.bounds, strict=True)
        ):
            state = state_published(facts, c, value, path)
            if state is None or bound is None:
                continue
            error = exact(0.0)
            for e in facts.errors:
                if (e.owner, e.leaf) == (index, leaf):
                    error += magnitude(exact(e.low)).max(magnitude(exact(e.high)))
            low, high = exact(bound.low), exact(bound.high)
            size = magnitude(low).max(magnitude(high)) + error
            error += size * (4 * UNIT_ROUNDOFF) + 4 * TINIEST
            ends = lower(low - error), upper(high + error)
            old = ranges[state] or ends
            ranges[state] = max(old[0], ends[0]), min(old[1], ends[1])
    return ranges


def _place_outside_grid(
    model: CaseModel,
    groups: Sequence[GridGroup],
    expr: typed.TypedExpr,
    reach: Sequence[tuple[float, float]],
) -> str:
    """A text about the place outside the grid where `expr` may hold; "" without a place."""
    parts = _conjunct_checks(CaseModel(model.facts, model.parameter, tuple(reach)), expr)
    for axes in (g.tables for g in groups):
        for state, edges in zip(axes.states, axes.grid.edges, strict=True):
            low, high = reach[state]
            first, last = edges[0], edges[-1]
            sides = [(f"below {first!r}", low, min(first, high))] if low <= first else []
            sides += [(f"above {last!r}", max(last, low), high)] if high >= last else []
            for side, a, b in sides:
                if not any(part.certainly_fails(state, a, b) for part in parts):
                    return f"{model.facts.states[state].name} is {side}"
    return ""


def _conjunct_checks(anywhere: CaseModel, expr: typed.TypedExpr) -> list[_ConjunctCheck]:
    """For each conjunct of `expr` the check that it fails, without a fault."""
    terms, states = anywhere.new_terms()
    truth = anywhere.truth_of(terms, states, expr, errors=True)
    sound = conjunction_of(terms.obligations)
    atoms = [x.atom for x in states]
    return [_ConjunctCheck(anywhere, terms, atoms, part, sound) for part in conjuncts(truth)]


class _ConjunctCheck:
    """A conjunct of a predicate, over states that may lie outside the grid."""

    def __init__(
        self,
        model: CaseModel,
        terms: Terms,
        atoms: Sequence[int],
        part: Proposition,
        sound: Proposition,
    ) -> None:
        fails = and_of(negation(part), sound)
        self._decision = TruthOverBox(model, range(len(atoms)), terms, atoms, fails)
        ranges = ((exact(a), exact(b)) for a, b in model.extents)
        self._box: Box = [*ranges, *self._decision.ranges]
        free = sorted(i for i in input_atoms(terms, [fails]) if terms.atoms[i].kind == "box")
        self._weights = [float(influence_of_inputs(terms, part, [i])) for i in (*atoms, *free)]

    def certainly_fails(self, state: int, low: float, high: float) -> bool:
        """Whether the conjunct certainly fails when a state is in a range; halves the box.

        It first halves the input that moves the compared numbers most.
        """
        if not self._weights[state]:
            return False
        box = list(self._box)
        box[state] = exact(low), exact(high)
        widths = [b - a for a, b in box]
        waiting, tries = [box], 0
        while waiting:
            box, tries = waiting.pop(), tries + 1
            truth_bits = self._decision.bits_on_box(box)
            if truth_bits == 2:
                continue
            if truth_bits != 3 or tries > TRIES_BEYOND:
                return False
            shares = [
                w * float((b - a) / full) if full > 0 else 0.0
                for w, (a, b), full in zip(self._weights, box, widths, strict=True)
            ]
            axis = shares.index(max(shares))
            middle = ((box[axis][0] + box[axis][1]) * HALF).mid()
            halves = (box[axis][0], middle), (middle, box[axis][1])
            waiting += [[*box[:axis], half, *box[axis + 1 :]] for half in halves]
        return True

"""Checked again: states that a claim need not look at, and rates that are defined everywhere.

Purpose: `leave_out` (the problem without the states that a certificate leaves out), `refuse_read`
(their right to be left out: nothing that is asked depends on them). `rates_are_defined`: every
obligation of the rates (a divisor is not 0, an index is there, an assertion holds) that no group
shows cell by cell is shown over the whole grid at once.
Non-goals: sets of the other states; the rates' values. A group that is not linear, and that runs
could leave, shows those obligations itself that concern a state of its own (`flow_enclosures.py`).

The argument: what is asked are terms of the other states, so that a run of all states shows a run
of these. It has to go on for as long as is asked: the rates of what is left out grow no faster than
it does, with factors that everything else bounds (Gronwall).
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from soter.certificate.format.errors import RejectedError
from soter.certificate.reading.case_model import LEFT_OUT, CaseModel, control_inputs
from soter.certificate.reading.module_facts import Facts, bounded_topics
from soter.certificate.reading.symbolic_operations import EVERYWHERE
from soter.certificate.terms.compile_terms import compile_truths, form_of_box
from soter.certificate.terms.terms import Linear, NotRecheckedError, Proposition, Terms, inputs_of

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence


CERTAIN = 2


def rates_are_defined(model: CaseModel, seen_to: Sequence[Sequence[int]]) -> None:
    """`NotRecheckedError` where a rate may be undefined; `seen_to`: groups that look themselves.

    An obligation about states of several groups is left to one that looks: there the others' states
    range over their grids.
    """
    if model.facts.kind == "map":
        return  # a map's obligations are demanded of every cell
    terms, states = model.new_terms()
    model.rates(terms, states, control_inputs(model.facts, terms))
    shown = [{_atom(states[i]) for i in members} for members in seen_to]
    left = []
    for truth in terms.obligations:
        inputs = inputs_of(terms, [truth])
        if any(inputs & own for own in shown):
            continue
        if shown and not inputs & {_atom(x) for x in states}:
            continue  # about commands and disturbances alone: every such group asks it
        left.append(truth)
    if not all_certain(terms, left):
        raise NotRecheckedError("a plant's equation that is not defined everywhere on the grid")


def all_certain(terms: Terms, truths: Sequence[Proposition]) -> bool:
    """Whether all of them certainly hold, whatever the inputs are in their ranges."""
    places = sorted(inputs_of(terms, truths))
    box = [(terms.atoms[i].low, terms.atoms[i].high) for i in places]
    decided = compile_truths(terms, places, truths, {})(form_of_box(box, symbols=False))
    return all(bits == CERTAIN for bits in decided)


def _atom(x: Linear) -> int:
    (index,) = x.terms
    return index


BOUNDED = EVERYWHERE | {"soft_sign"}
LARGEST_OF = frozenset({"max0", "abs", "sqrt", "choice", "spread", "min", "max"})


def leave_out(facts: Facts, names: Collection[str]) -> None:
    """The problem from now on: without the states of these names.

    RejectedError where the module declares an axis for one.
    """
    left = {i for i, s in enumerate(facts.states) if s.name in names}
    if not left:
        return
    if left & (facts.axes.keys() | facts.leaves.keys() | facts.unbounded) or facts.kind != "flow":
        raise RejectedError(f"there are no sets of {', '.join(sorted(names))}")
    kept = [i for i in range(len(facts.states)) if i not in left]
    place = {i: k for k, i in enumerate(kept)}
    facts.left_out = [facts.states[i] for i in sorted(left)]
    facts.states = [facts.states[i] for i in kept]
    facts.axes = {place[i]: x for i, x in facts.axes.items()}
    facts.leaves = {place[i]: x for i, x in facts.leaves.items()}
    facts.unbounded = {place[i] for i in facts.unbounded}
    facts.open_ends = {place[i] for i in facts.open_ends}


def refuse_read(model: CaseModel) -> None:
    """That nothing which is asked depends on a state that is left out, and that it does not end.

    RejectedError where one of these is not so, NotRecheckedError where its rate may be undefined.
    """
    facts = model.facts
    terms, states = model.new_terms()
    asked: list[Linear | Proposition] = list(model.commands(terms, states))
    asked.append(model.predicate(terms, states, facts.symbol.safe, errors=False))
    seen = [facts.ttf, facts.symbol.safer, facts.symbol.verify.enters]
    seen += [] if facts.above is None else [facts.above.safer]
    asked += [model.predicate(terms, states, e, errors=True) for e in seen if e is not None]
    asked += [model.in_set(terms, states, topic) for topic in bounded_topics(facts)]
    controls = control_inputs(facts, terms)
    asked += [*model.rates(terms, states, controls)[0], *terms.obligations]
    terms.obligations.clear()
    of_left_out = model.rates_left_out(terms, states, controls)
    left = {i for i, atom in enumerate(terms.atoms) if atom.name.startswith(LEFT_OUT)}
    names = ", ".join(s.name for s in facts.left_out)
    if inputs_of(terms, asked) & left:
        raise RejectedError(f"something that is asked reads what is left out: {names}")
    if not all_certain(terms, terms.obligations):
        raise NotRecheckedError(f"the rate of what is left out is not defined everywhere: {names}")
    if any(degree(terms, rate, left) > 1 for rate in of_left_out):
        raise RejectedError(f"what is left out may end before what is asked does: {names}")


def degree(terms: Terms, x: Linear, inputs: Collection[int]) -> float:
    """A power of these inputs beyond which a term does not grow; inf where none is known."""
    return max((_of_atom(terms, a, inputs) for a in x.terms), default=0)


def _of_atom(terms: Terms, index: int, inputs: Collection[int]) -> float:
    atom = terms.atoms[index]
    parts = [degree(terms, y, inputs) for y in atom.arguments]
    if index in inputs or not any(parts):
        return index in inputs
    if atom.kind in BOUNDED:
        return 0
    if atom.kind == "product":
        return sum(parts)
    return max(parts) if atom.kind in LARGEST_OF else inf

"""States that a certificate leaves out: that nothing which is asked depends on them.

Purpose: `leave_out` (the problem without them), `refuse_read` (their right to be left out).
Non-goals: sets of the others.

The argument: what is asked are terms of the other states, so that a run of all states shows a run
of these. It has to go on for as long as is asked: the rates of what is left out grow no faster than
it does, with factors that everything else bounds (Gronwall).
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from soter.certificate.format.errors import RejectedError
from soter.certificate.reading.case_model import LEFT_OUT, CaseModel, control_inputs
from soter.certificate.reading.definedness import all_certain
from soter.certificate.reading.module_facts import Facts, bounded_topics
from soter.certificate.reading.symbolic_operations import EVERYWHERE
from soter.certificate.terms.terms import (
    Linear,
    NotRecheckedError,
    Proposition,
    Terms,
    inputs_of,
)

if TYPE_CHECKING:
    from collections.abc import Collection

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

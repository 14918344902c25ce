"""Checked again: states that a claim need not look at, wholly or beyond the ends of their axes.

Purpose: `leave_out` takes the states that a certificate leaves out from the problem; `refuse_read`
checks that nothing which is asked depends on them. `nothing_reads` shows that no rate and no
command of SC reads a state whose axis is unbounded; `read_turning` enters which axes wrap around,
and `refuse_turns_read` checks that all that reads their states is the same a turn further.
Non-goals: sets of the other states, and on such axes (`cell_sets.py`); the rates' values.

The argument for a state that is left out: what is asked are terms of the other states, so that a
run of all states shows a run of these. It has to go on for as long as is asked: the rates of what
is left out grow no faster than it does, with factors that everything else bounds (Gronwall).

The argument for an axis without ends, or one that wraps. Everything that is asked is a term. Each
is read with the state anywhere up to 3 `THIRD`, so that nothing is decided by where it is. There it
may only stand in arguments of functions of a full turn, as a whole multiple of itself, to which
only what does not depend on it is added: then the argument moves by whole turns as the state does,
and what is rounded of it there is within `FAR_TURNS`, which is added to it where runs are enclosed
near the grid. So a run a turn further is a run, and its commands, rates and predicates are enclosed
by those of the one near the grid. Estimates are those that the DM brings back to the grid, which is
off by less.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING

from flint import arb

from soter.certificate.reading.case_model import FARTHEST, LEFT_OUT, CaseModel, control_inputs
from soter.certificate.reading.module_facts import Facts, bounded_topics
from soter.certificate.reading.symbolic_operations import EVERYWHERE, FAR_TURNS, OF_A_TURN
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.compile_terms import all_certain
from soter.certificate.terms.linear_enclosures import exact
from soter.certificate.terms.terms import (
    Linear,
    Proposition,
    Terms,
    atoms_under,
    inputs_of,
    parts_of,
)

if TYPE_CHECKING:
    from collections.abc import Collection


BOUNDED = EVERYWHERE | {"soft_sign"}
LARGEST_OF = frozenset({"max0", "abs", "sqrt", "choice", "spread", "min", "max"})


def leave_out(facts: Facts, names: Collection[str]) -> None:
    """Take the states of these names out of the problem.

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
    """RejectedError where something that is asked depends on a state that is left out.

    The same where its solution may end in finite time; NotRecheckedError for undefined rates.
    """
    facts = model.facts
    terms, states = model.new_terms()
    asked: list[Linear | Proposition] = list(model.commands(terms, states))
    asked.append(model.predicate(terms, states, facts.symbol.safe, errors=False))
    seen = [facts.ttf, facts.symbol.safer, facts.symbol.verify.enters]
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
    known: dict[int, float] = {}
    for index in sorted(atoms_under(terms, [x])):  # arguments first
        atom = terms.atoms[index]
        parts = [max((known[a] for a in y.terms), default=0) for y in atom.arguments]
        if index in inputs or not any(parts):
            known[index] = index in inputs
        elif atom.kind in BOUNDED:
            known[index] = 0
        elif atom.kind == "product":
            known[index] = sum(parts)
        else:
            known[index] = max(parts) if atom.kind in LARGEST_OF else inf
    return max((known[a] for a in x.terms), default=0)


def nothing_reads(model: CaseModel, groups: int) -> None:
    """`NotRecheckedError` where a rate or SC may read such a state, or the argument is not for it.

    The rates and SC's step are read with states that may be anything up to `FARTHEST`, so that no
    branch is left out because of where a grid ends.
    """
    facts = model.facts
    if facts.kind == "map" or facts.symbol.verify.enters is not None:
        raise NotRecheckedError("an axis without ends of a map, or of `enters`")
    if groups != 1:
        raise NotRecheckedError("an axis without ends beside other groups")
    terms, states = model.new_terms(FARTHEST)
    rates, _ = model.rates(terms, states, control_inputs(facts, terms))
    read = inputs_of(terms, [*rates, *model.commands(terms, states), *terms.obligations])
    for i in sorted(facts.unbounded):
        (atom,) = states[i].terms
        if atom in read:
            name = facts.states[i].name
            raise NotRecheckedError(f"`{name}`, whose axis has no ends, is read by SC or a plant")


THIRD = 5461.5
"""Terms hold on three times an extent: up to 16,384 is assumed of each such state."""
NEAR = exact(2.0**-44)
"""Ends of an axis are so near to a turn apart."""


def read_turning(facts: Facts, names: object) -> None:
    """Enter the states whose axis wraps around; RejectedError where one may not.

    The extents of all states are known.
    """
    if not isinstance(names, list) or not names or len({*map(str, names)}) != len(names):
        raise RejectedError("`wraps` is not as it should be")
    by_name = {s.name: i for i, s in enumerate(facts.states)}
    if not by_name.keys() >= {*names}:
        raise RejectedError("`wraps` names a state that there is not")
    symbol = facts.symbol
    beside = (symbol.shield, symbol.verify.enters)
    if facts.kind != "flow" or facts.view or beside != (None, None):
        raise RejectedError("an axis wraps around where that is not settled")
    facts.turning = {*map(by_name.__getitem__, names)}
    for i in facts.turning:
        low, high = map(exact, facts.extents[i])
        long = abs(high - low - 2 * arb.pi()) < NEAR and -low < 10 and high < 10
        if not long or i in facts.unbounded | facts.open_ends:
            raise RejectedError(f"the axis of {facts.states[i].name} is no full turn")


def refuse_turns_read(model: CaseModel) -> None:
    """RejectedError where something that is asked is not the same a turn further."""
    facts, far = model.facts, (-THIRD, THIRD)
    extents = tuple(far if i in facts.turning else e for i, e in enumerate(model.extents))
    model = replace(model, extents=extents)
    terms, states = model.new_terms()
    asked: list[Linear | Proposition] = list(model.commands(terms, states))
    true = [facts.symbol.safe, *([facts.symbol.rest.condition] if facts.symbol.rest else [])]
    asked += [model.predicate(terms, states, e, errors=False) for e in true]
    seen = [e for e in (facts.ttf, facts.symbol.safer) if e is not None]
    asked += [model.predicate(terms, states, e, errors=True) for e in seen]
    asked += [model.in_set(terms, states, topic) for topic in bounded_topics(facts)]
    asked += model.rates(terms, states, control_inputs(facts, terms))[0]
    asked += terms.obligations
    if not all(_is_turn_invariant(terms, x) for x in asked):
        names = ", ".join(facts.states[i].name for i in sorted(facts.turning))
        raise RejectedError(f"something reads how many turns there are in {names}")


def _is_turn_invariant(terms: Terms, asked: Linear | Proposition) -> bool:
    """Whether a term is the same where angles are turns further."""
    for index in atoms_under(terms, [asked]):
        atom = terms.atoms[index]
        if atom.condition is not None and not _compares_no_angle(terms, atom.condition):
            return False
        angles = [x for x in atom.arguments if terms.may_be_turned(x)]
        if angles and not (atom.kind in OF_A_TURN and all(_is_angle(terms, x) for x in angles)):
            return False
    return _compares_no_angle(terms, asked)


def _compares_no_angle(terms: Terms, x: Linear | Proposition) -> bool:
    """Whether no angle stands in it by itself."""
    if isinstance(x, Linear):
        return not terms.may_be_turned(x)
    compared = [p.argument for p in parts_of(x) if p.argument is not None]
    return not any(map(terms.may_be_turned, compared))


def _is_angle(terms: Terms, x: Linear) -> bool:
    """Whether angles stand in it as whole multiples, and it is rounded by little."""
    whole = all(x.terms[i].is_integer() for i in terms.turning & x.terms.keys())
    return whole and bool(x.radius <= 2 * FAR_TURNS)  # with that of the function

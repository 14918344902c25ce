"""The re-checker's maps: a period of SC, and free phases, as so many steps of the plants.

Purpose: `map_step`, `map_free`: compiled steps for `sc_chains.py`.
Non-goals: flows, delays (a map has none).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.reading.case_model import control_inputs
from soter.certificate.terms.arb_balls import exact
from soter.certificate.terms.compile_terms import compile_step
from soter.certificate.terms.terms import NotRecheckedError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flint import arb

    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.compile_terms import Step
    from soter.certificate.terms.terms import Linear

STEPS_MAX, PHASE_MAX = 1_000, 100_000
"""Steps of a map in a period of SC, and in a phase of any command."""


def boxes_of(
    model: CaseModel, states: Sequence[Linear], members: Sequence[int]
) -> dict[int, tuple[arb, arb]]:
    """States of other groups range over their grids."""
    range_by_atom = {}
    for i, x in enumerate(states):
        if i not in members:
            (atom,) = x.terms
            low, high = model.extents[i]
            range_by_atom[atom] = (exact(low), exact(high))
    return range_by_atom


def atom_of(x: Linear) -> int:
    """The atom that an input is."""
    (atom,) = x.terms
    return atom


def map_step(model: CaseModel, members: Sequence[int]) -> Step:
    """One period of SC: so many steps of the map under one command.

    NotRecheckedError where they are too many.
    """
    terms, states = model.new_terms()
    commands = model.commands(terms, states)
    count = model.facts.times["delta_ns"] // model.facts.plants[0].period_ns
    if count > STEPS_MAX:
        raise NotRecheckedError(f"more than {STEPS_MAX:,} steps of the map in a period of SC")
    current, between = states, []
    for _ in range(count):
        current = model.next_states(terms, current, commands)
        between += [current[i] for i in members]
    return compile_step(
        terms,
        [atom_of(states[i]) for i in members],
        len(members),
        [current[i] for i in members],
        ranges=between,
        must=terms.obligations,
        boxes=boxes_of(model, states, members),
    )


def map_free(model: CaseModel, members: Sequence[int], time_ns: int) -> tuple[Step, ...]:
    """Steps of the map under any commands, as many as the time has.

    NotRecheckedError where they are too many.
    """
    period = model.facts.plants[0].period_ns
    if time_ns > PHASE_MAX * period:
        raise NotRecheckedError(f"more than {PHASE_MAX:,} steps of the map under any command")
    terms, states = model.new_terms()
    commands = control_inputs(model.facts, terms)
    after = model.next_states(terms, states, commands)
    step = compile_step(
        terms,
        [atom_of(states[i]) for i in members],
        len(members),
        [after[i] for i in members],
        ranges=[after[i] for i in members],
        must=terms.obligations,
        boxes=boxes_of(model, states, members),
    )
    return (step,) * -(-time_ns // period)

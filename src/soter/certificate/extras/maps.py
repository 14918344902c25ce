"""Plants that are maps, which step in place of holds.

Purpose: `require_instants_of_map` checks that all reads and actions are of instants in which the
map steps; `map_steps_in_period` is a period of SC, `map_steps_in_time` a phase under any commands.
Non-goals: what a map computes (`reading/case_model.py`), sets (`grid/group_claims.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.reading.case_model import ends_of_other_states, new_command_terms
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.compile_terms import compile_step

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.reading.derived_times import TimingSetting
    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.terms.compile_terms import Step


STEPS_MAX, PHASE_MAX = 1_000, 100_000
"""Steps of a map in a period of SC, and in a phase of any command."""


def require_instants_of_map(facts: Facts, setting: TimingSetting) -> None:
    """Raises NotRecheckedError unless all reads and actions happen when the map steps.

    Beside a map, ages and delays are not counted.
    """
    step, dm, sc = facts.plants[0].period_ns, setting.dm, setting.sc
    paths = [(r, p) for r in (*setting.by_dm, *setting.by_sc) for p in r.paths]
    late = [dm.max_delay, sc.max_delay, *(e.least | e.most for e in setting.effects)]
    between = [*(p.clocks[1:] for _, p in paths), *(e.clocks for e in setting.effects)]
    together = (dm.period, sc.period, dm.phase, sc.phase)
    beside = {
        "maps with different periods": {c.period_ns for c in facts.plants} != {step},
        "a module that does not step together with its map": any(ns % step for ns in together),
        "delays beside a map": any(late),
        "`dropout` beside a map": setting.silent,
        "nodes between a map and its module": any(between),
    }
    for reason in (reason for reason, is_there in beside.items() if is_there):
        raise NotRecheckedError(reason)
    for read, path in paths:
        sensor = path.sensor
        if sensor.phase or step % sensor.period:
            raise NotRecheckedError(f"`{sensor.name}` does not publish whenever the map steps")
        if read.max_age >= sensor.period:
            raise NotRecheckedError("beside a map `max_age` must be shorter than its period")


def map_steps_in_period(model: CaseModel, members: Sequence[int]) -> Step:
    """The compiled function for a period of SC: all steps of the map in it, with a single command.

    Raises NotRecheckedError if these steps are too many.
    """
    terms, states = model.new_terms()
    commands = model.sc_commands(terms, states)
    count = model.facts.times["delta_ns"] // model.facts.plants[0].period_ns
    if count > STEPS_MAX:
        raise NotRecheckedError(f"more than {STEPS_MAX:,} steps of the map in a period of SC")
    current, between = states, []
    for _ in range(count):
        current = model.next_states(terms, current, commands)
        between += [current[i] for i in members]
    return compile_step(
        terms,
        [states[i].atom for i in members],
        len(members),
        [current[i] for i in members],
        ranges=between,
        must=terms.obligations,
        boxes=ends_of_other_states(model, states, members),
    )


def map_steps_in_time(model: CaseModel, members: Sequence[int], time_ns: int) -> tuple[Step, ...]:
    """The compiled steps that the map makes in `time_ns`, under any commands.

    Raises NotRecheckedError if these steps are too many.
    """
    period = model.facts.plants[0].period_ns
    if time_ns > PHASE_MAX * period:
        raise NotRecheckedError(f"more than {PHASE_MAX:,} steps of the map under any command")
    terms, states = model.new_terms()
    commands = new_command_terms(model.facts, terms)
    after = model.next_states(terms, states, commands)
    step = compile_step(
        terms,
        [states[i].atom for i in members],
        len(members),
        [after[i] for i in members],
        ranges=[after[i] for i in members],
        must=terms.obligations,
        boxes=ends_of_other_states(model, states, members),
    )
    return (step,) * -(-time_ns // period)

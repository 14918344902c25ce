"""Elaborates a `test` block to a system with a plan for its exploration.

Purpose: turns a `TestSymbol` into a `System` with its `TestPlan`.
Non-goals: P1 of a part that the test replaced (a test may be about a slow controller), exploring.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.elaborate import derived_systems
from soter.language.elaborate.explorable import check_explorable
from soter.language.elaborate.flatten_system import flatten
from soter.language.elaborate.passes.flattening import Flattening
from soter.language.elaborate.passes.stated_values import give_steps_to_stand_ins
from soter.language.elaborate.passes.topics import topic_index_at
from soter.language.elaborate.timing_faults import overruns_of_takes, timing_faults
from soter.language.elaborate.wellformed import check_periods
from soter.language.model.system import TestPlan

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model import typed
    from soter.language.model.system import System
    from soter.language.model.types import Value


def elaborate_test(
    program: typed.TypedProgram,
    test: typed.TestSymbol,
    overrides: Mapping[str, Value],
    diagnostics: Diagnostics,
) -> System | None:
    """Gives the flat system of a test, with its plan in `System.test`; None after an error.

    `overrides` maps full parameter names to values.
    """
    before = diagnostics.error_count
    set_by_test = {(s.path, s.param) for s in test.sets}
    symbol = replace(
        test.system,
        replaces=(*test.system.replaces, *test.replaces),
        sets=(*test.sets, *(s for s in test.system.sets if (s.path, s.param) not in set_by_test)),
    )
    if test.system in program.damaged:
        program.damaged.add(symbol)
    flat = Flattening(program, symbol, overrides, diagnostics, test=test)
    horizon = _required_horizon_ns(flat, test)
    skew = flat.skew_ns(test.skew)
    quantum = flat.duration_ns(test.quantum, "`quantum`")
    before_parts = diagnostics.error_count
    system = flatten(flat)
    if system is None:
        return None
    give_steps_to_stand_ins(flat, test, system)
    sound = test not in flat.program.damaged and diagnostics.error_count == before_parts
    flat.partial = flat.partial or not sound
    drawn = {topic_index_at(flat, flat.parts[0], i.topic) for i in test.inputs}
    topics = system.topics  # those that nothing reads after replacements are not drawn
    system = derived_systems.with_draws(system, lambda t: t in drawn or bool(topics[t].driver))
    _check_unreplaced_periods(flat, system)
    faults = (*timing_faults(flat, test, system), *overruns_of_takes(flat, system))
    plan = TestPlan(test.name, skew, horizon or 0, quantum, faults, tuple(flat.timed), test.span)
    plan.ordered = test.order is not None
    system = derived_systems.with_test(system, plan)
    check_explorable(flat, test, system, sound=sound)
    return system if diagnostics.error_count == before else None


def _required_horizon_ns(flat: Flattening, test: typed.TestSymbol) -> int | None:
    if test.horizon is not None:
        return flat.run_length_ns(test.horizon, "`horizon`")
    if test not in flat.program.damaged:
        flat.diagnostics.error(
            "E007",
            f"test `{test.name}` has no horizon",
            test.span,
            notes=("an exploration covers every execution up to some time",),
            helps=("say how far: `horizon 1s;`",),
        )
    return None


def _check_unreplaced_periods(flat: Flattening, system: System) -> None:
    """Checks P1a, except for controllers that the test replaced."""
    replaced = {
        c.name
        for m in system.modules
        for c in (system.components[m.ac], system.components[m.sc])
        if c.node not in (m.symbol.ac, m.symbol.sc)
    }
    check_periods(system, flat.diagnostics, flat.unknown | replaced)

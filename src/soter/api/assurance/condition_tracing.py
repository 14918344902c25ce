"""From a requirement to the conditions of the generated C, and which run shows each (`--trace`).

Purpose: `trace_conditions` follows each property that a row of hazards traces to into Core, into
the functions of the C that is made of that, and to their conditions; and back, to conditions that
no row reaches. What runs show is counted in that C itself (`codegen/conditions.py`), in `RUNS`
flights, in the check of the decision modules and, with `--tests`, in the tests.
Non-goals: C of the run-time and of externs; whether what the C computed was right.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from soter.api.arguments import run_end_ns
from soter.api.assurance.hazard_traceability import LAW
from soter.codegen.conditions import (
    conditions_of,
    functions_called,
    functions_of,
    watching,
    why_unshown,
)
from soter.codegen.unit import UnitBuilder
from soter.core.steps import lower
from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import SoterError
from soter.native.extern_bindings import bind
from soter.report.safety_case import ConditionTrace, TracedCondition
from soter.simulate.externs.callables import close_externs, load_callables
from soter.simulate.interrupt import StopRequest
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.codegen.conditions import Vector
    from soter.language.model.system import System
    from soter.report.safety_case import SafetyCase

    Shown = dict[tuple[str, str], set[Vector]]


RUNS = 20
UNCOUNTED = "no check of a DM that computes its predicates: what goal G6 tries is not counted"
PLACE = re.compile(r"(.*?)(?:, (\S+:\d+))?", re.DOTALL)
"""What the comment above a function says: what it is of, and where the program says that."""


def trace_conditions(
    case: SafetyCase, declared: System, flat: System, tested: list[tuple[str, Shown]]
) -> None:
    """Adds the traces of conditions in the C to a case that has all other traces.

    `declared` is the system before its predicates were computed, `flat` the one after. The check of
    decision modules is skipped if predicates had to be computed, as it takes too long. `tested`
    lists earlier runs with the conditions that each showed.

    A condition is covered by the first run that shows, with all before it, that it decides alone.
    """
    builder = UnitBuilder(flat, lower(flat), None)
    unit = builder.build_unit()
    functions = functions_of(unit.tree)
    direct = {
        (item.id, name): functions_called(functions, _root_functions(builder, flat, name))
        for item in case.traceability.items
        for name in item.traces_to
        if name in item.properties
    }
    computed = any(m.symbol.ttf is None or m.symbol.safer is None for m in declared.modules)
    decided = [(UNCOUNTED, dict[Any, Any]())]
    shown: list[tuple[str, Shown]] = [*_shown_by_flights(flat)]
    shown += [*(decided if computed else _shown_by_dm_check(case, flat)), *tested]
    evidence = list(_cumulative_coverage(shown))
    found = []
    for x in conditions_of(unit.tree, unit.source):
        missing = [why_unshown(seen.get(x.key[:2], set()), x.key[2]) for _, seen in evidence]
        place_match = PLACE.fullmatch(x.of)
        assert place_match is not None
        core, source = place_match.groups("")
        behind = tuple(row for row, names in direct.items() if x.function in names)
        by = next((run for (run, _), m in zip(evidence, missing, strict=True) if not m), "")
        why = "" if by else missing[-1] if missing else "nothing was run"
        place = (core, source, x.function, x.line)
        found.append(TracedCondition(behind, *place, x.decision, x.text, by, why))
    reaching = {row for x in found for row in x.reached_by}
    empty = tuple(row for row in direct if row not in reaching)
    how = tuple(dict.fromkeys(run for run, _ in shown))
    case.conditions = ConditionTrace(f"{unit.prefix}.c", how, tuple(found), empty)


def _root_functions(builder: UnitBuilder, flat: System, name: str) -> list[str]:
    """The C functions that a property is about; for a test, those of all nodes and modules."""
    for p in flat.properties:
        if p.component is None and " ".join(f"{p.kind} {p.text}".split()) == name:
            return [f"{builder.prefix}_property_{p.index}"]
    about, _, property_name = name.rpartition(".")
    modules = [m for m in flat.modules if about in ("", m.name)]
    if about and property_name == LAW:
        return [f"{builder.names[i]}_failsafe" for m in modules for i in (m.ac, m.sc)]
    nodes = [m.sc for m in modules] if about else [x.index for x in flat.components if not x.plant]
    steps = [f"{builder.names[i]}{end}" for i in nodes for end in ("_step", "_effect", "_exchange")]
    return [*steps, *(f"{builder.module_names[m.index]}_decide" for m in modules)]


def _shown_by_flights(flat: System) -> Iterator[tuple[str, Shown]]:
    """Yields the conditions that flights with seeds 1 to `RUNS` show, or why none is possible."""
    phase("flying to see conditions")
    with watching() as seen:
        try:
            bindings = bind(flat, {})
            bound = load_callables(bindings, "native", StopRequest())
            try:
                program = NativeProgram(flat, core=bindings.core)
                for seed in range(1, RUNS + 1):
                    program.run(run_end_ns(flat, None), seed, bound)
                    yield f"run of {flat.name}, seed {seed}", seen()
            finally:
                close_externs(bound)
        except SoterError as error:
            yield f"no run of {flat.name}: {error}", {}


def _shown_by_dm_check(case: SafetyCase, flat: System) -> Iterator[tuple[str, Shown]]:
    """Yields the conditions that the DM check shows; notes in the case which DMs differ."""
    from soter.verify.deploy.dm_check import check_decisions  # noqa: PLC0415 - compiles

    with watching() as seen:
        try:
            checks = check_decisions(flat)
        except (SoterError, NotImplementedError) as error:
            yield f"no check of the decision modules: {error}", {}
            return
        case.refuted += [f"{x.module}: {x.summary}" for x in checks if x.failures]
        yield "check of the decision modules", seen()


def _cumulative_coverage(shown: list[tuple[str, Shown]]) -> Iterator[tuple[str, Shown]]:
    """Yields each pair again, but with all that it and the pairs before it show."""
    total: Shown = {}
    for run, seen in shown:
        total = {k: total.get(k, set()) | seen.get(k, set()) for k in total.keys() | seen.keys()}
        yield run, total

"""The figures of a run as plain data: what `soter run --json` prints and a script reads.

Purpose: the document's run fields, final values of topics and plants by full name, faults of
components; numbers as JSON knows them.
Non-goals: printing; what only one example cares about, which it adds itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core.layout import decode_from
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.model.python_values import to_json
from soter.simulate.decisions import changes
from soter.simulate.run_parameters import as_json

if TYPE_CHECKING:
    from soter.core.layout import StateLayout
    from soter.language.model.system import Component
    from soter.language.model.types import Type, Value
    from soter.simulate.result import Run, Violation

CHANGES_MAX = 1000
"""More mode changes than anybody reads: the document says how many there were."""


def run_figures(run: Run) -> dict[str, object]:
    """The fields of the document `run` (docs/json.md), without the envelope."""
    decided = changes(run)
    return {
        "system": run.system.name,
        "engine": run.engine,
        "seed": run.seed,
        "program_sha256": run.system.program.sha256,
        "params": as_json(run.system),
        "notes": run.notes,
        "duration_s": run.reached_s if run.interrupted else run.duration_s,
        "until_s": run.duration_s,
        "interrupted": run.interrupted,
        "wall_s": run.wall_s,
        "lag_s_max": run.lag_s_max,
        "real_time": run.timing,
        "instants": run.instants,
        "violations": run.violations,
        "violation_list": [_violation(v) for v in run.violation_list],
        "modules": {
            name: {
                "ac_share": m.ac_share,
                "switches_to_sc": m.switches_to_sc,
                "switches_to_ac": m.switches_to_ac,
                "gate_faults": m.gate_faults,
            }
            for name, m in run.modules.items()
        },
        "proofs": {
            name: {"properties": p.verdicts, "assumptions": list(p.assumptions)}
            for name, p in run.proofs.items()
        },
        "mode_changes": [
            {
                "time_s": d.time_ns / 1e9,
                "module": d.module,
                "mode": d.after,
                "reason": d.reason,
                "predicates": d.saw.predicates(),
                "margin_s": d.margin_s,
                "why": None if d.why is None else {"words": d.words, **d.why.as_json()},
            }
            for d in decided[:CHANGES_MAX]
        ],
        "mode_changes_total": len(decided),
        "faults": component_faults(run),
        "externs": dict(run.externs),
        "extern_failures": dict(run.extern_failures),
        "extern_silences": {
            name: {"steps": tally.steps, "silent": tally.silent}
            for name, tally in run.extern_tallies.items()
            if tally.silent
        },
        "final": final_values(run),
        "trace_sha256": run.trace_sha256,
    }


def _violation(v: Violation) -> dict[str, object]:
    span = v.span
    return {
        "what": v.what,
        "kind": v.kind,
        "time_s": v.time_s,
        "count": v.count,
        "file": span.source.name if span else None,
        "line": span.line if span else None,
        "column": span.column if span else None,
    }


def component_faults(run: Run) -> dict[str, dict[str, object]]:
    """Step faults by component, for those that had any."""
    facts_by_component: dict[str, dict[str, object]] = {}
    for x in run.system.components:
        row = run.final["components"][x.index]
        if row["faults"]:
            first = run.first_faults.get(x.index)
            facts_by_component[x.name] = {
                "count": int(row["faults"]),
                "last": FaultKind(int(row["last_fault"])).name.lower(),
                "first_s": None if first is None else first.time_ns / 1e9,
                "latched": bool(row["latched"]),
            }
    return facts_by_component


def final_values(run: Run) -> dict[str, object]:
    """The last value of every topic, and the true state of every plant as `<plant>.truth`."""
    raw = run.final.tobytes()
    value_by_name: dict[str, object] = {}
    for topic in run.system.topics:
        value_by_name[topic.name] = _decoded(raw, run.layout.topic_offset(topic.index), topic.type)
    for x in run.system.components:
        if x.plant is not None:
            value_by_name[f"{x.name}.truth"] = to_json(
                x.plant.truth, truth_value(run.layout, x, raw)
            )
    return value_by_name


def truth_value(layout: StateLayout, plant: Component, raw: bytes | memoryview) -> Value:
    """A plant's true state in the image of a state, as a value of its `truth` type."""
    assert plant.plant is not None
    places = [layout.member(plant.index, i) for i in range(len(plant.plant.states))]
    return tuple([decode_from(raw, offset, t) for offset, t in places])


def scalars(run: Run) -> dict[str, float]:
    """The numbers among the final values, by dotted path (`c.truth.x`)."""
    number_by_path: dict[str, float] = {}

    def walk(path: str, value: object) -> None:
        if isinstance(value, dict):
            for name, part in value.items():
                walk(f"{path}.{name}", part)
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            number_by_path[path] = value

    for name, value in final_values(run).items():
        walk(name, value)
    return number_by_path


def _decoded(raw: bytes, offset: int, t: Type) -> object:
    return to_json(t, decode_from(raw, offset, t))

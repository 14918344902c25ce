"""The figures of a run as plain data, for `soter run --json` and for scripts.

Purpose: `DOCUMENT` lists the document's fields of a run; `final_values` gives the last values of
topics and plants by full name, `component_faults` the faults; numbers are as JSON has them.
Non-goals: printing; figures that only one example needs, which it adds itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.core.layout import decode_from
from soter.diagnostics.command_records import JsonObject, one_of
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.model.types import FLOAT
from soter.language.model.values import to_json
from soter.report.wording import parameters_json
from soter.simulate.decisions import DecisionStepRecord, PredicateValues
from soter.simulate.explain_decision import DecisionReason, GateFault, Operand, PredicatePart
from soter.simulate.stale_reads import Stale

if TYPE_CHECKING:
    from soter.core.layout import StateLayout
    from soter.language.model.system import Component
    from soter.language.model.types import Type, Value
    from soter.simulate.externs.python_answers import Tally
    from soter.simulate.result import Run


CHANGES_MAX = 1000
"""The most mode changes in the document; their total number is a field of its own."""


@dataclass(frozen=True)
class ExplainedStep:
    """A DM step with the values that decided it."""

    words: list[str]
    why: DecisionReason


@dataclass(frozen=True)
class ComponentFaults:
    """The step faults of a component: how many, the last kind, and the first time in s."""

    count: int
    last: str
    first_s: float | None
    latched: bool


def _params(run: Run) -> dict[str, object]:
    return parameters_json(run.system)


def _duration_s(run: Run) -> float:
    return run.reached_s if run.interrupted else run.duration_s


def _mode_changes(run: Run) -> list[DecisionStepRecord]:
    return run.decisions[:CHANGES_MAX]


def _mode_changes_total(run: Run) -> int:
    return len(run.changes)


def _silent_externs(run: Run) -> dict[str, Tally]:
    return {name: tally for name, tally in run.extern_tallies.items() if tally.silent}


def _time_s(d: DecisionStepRecord) -> float:
    return d.time_ns / 1e9


def _explained_step(d: DecisionStepRecord) -> ExplainedStep | None:
    return None if d.why is None else ExplainedStep(d.words, d.why)


def _operand_json(o: Operand) -> object:
    return to_json(FLOAT, o.value) if isinstance(o.value, float) else o.value


def component_faults(run: Run) -> dict[str, ComponentFaults]:
    """Maps each component that had step faults to these faults."""
    faults_by_component = {}
    for x in run.system.components:
        row = run.final["components"][x.index]
        if row["faults"]:
            first = run.first_faults.get(x.index)
            faults_by_component[x.name] = ComponentFaults(
                int(row["faults"]),
                FaultKind(int(row["last_fault"])).name.lower(),
                None if first is None else first.time_ns / 1e9,
                bool(row["latched"]),
            )
    return faults_by_component


def final_values(run: Run) -> dict[str, object]:
    """The last value of every topic, and the true state of every plant as `<plant>.truth`."""
    raw = run.final.tobytes()
    value_by_name: dict[str, object] = {}
    for topic in run.system.topics:
        value_by_name[topic.name] = _topic_value(
            raw, run.layout.topic_offset(topic.index), topic.type
        )
    for x in run.system.components:
        if x.plant is not None:
            value_by_name[f"{x.name}.truth"] = to_json(
                x.plant.truth, truth_value(run.layout, x, raw)
            )
    return value_by_name


def truth_value(layout: StateLayout, plant: Component, raw: bytes | memoryview) -> Value:
    """A plant's true state in the bytes of a state, as a value of its `truth` type."""
    assert plant.plant is not None
    places = [layout.member(plant.index, i) for i in range(len(plant.plant.states))]
    return tuple([decode_from(raw, offset, t) for offset, t in places])


def final_numbers(run: Run) -> dict[str, float]:
    """The numbers among the final values, by dotted path (`c.truth.x`)."""
    number_by_path: dict[str, float] = {}

    def add_numbers(path: str, value: object) -> None:
        if isinstance(value, dict):
            for name, part in value.items():
                add_numbers(f"{path}.{name}", part)
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            number_by_path[path] = value

    for name, value in final_values(run).items():
        add_numbers(name, value)
    return number_by_path


def _topic_value(raw: bytes, offset: int, t: Type) -> object:
    return to_json(t, decode_from(raw, offset, t))


# ---------------------------------------------------------------- the document

RESULT = "soter.simulate.result"
VALUE: dict[str, object] = {"type": ["number", "integer", "boolean", "string"]}
PART = JsonObject(
    PredicatePart,
    "text value fault? operands",
    named="part",
    operands=JsonObject(Operand, "text value", {"value": _operand_json}, value=VALUE),
)
MODE_CHANGE = JsonObject(
    DecisionStepRecord,
    "time_s module mode=after reason predicates=saw margin_s why",
    {"time_s": _time_s, "why": _explained_step},
    mode=one_of("SC", "AC"),
    predicates=JsonObject(PredicateValues, "ttf safer stale gate_fault"),
    why=JsonObject(
        ExplainedStep,
        "words known=why.known ttf=why.ttf safer=why.safer stale=why.stale "
        "gate_fault=why.gate_fault owed=why.owed",
        ttf=PART,
        safer=PART,
        stale=JsonObject(Stale, "topic age_s max_age_s beside"),
        gate_fault=JsonObject(GateFault, "node fault"),
    ),
)
DOCUMENT = JsonObject(
    f"{RESULT}.Run",
    "system=system.name engine seed program_sha256=system.program.sha256 params notes duration_s "
    "until_s=duration_s interrupted cut wall_s lag_s_max real_time=timing instants violations "
    "violation_list modules proofs mode_changes mode_changes_total faults externs extern_files "
    "extern_failures extern_silences final trace_sha256",
    {
        "params": _params,
        "duration_s": _duration_s,
        "mode_changes": _mode_changes,
        "mode_changes_total": _mode_changes_total,
        "faults": component_faults,
        "extern_silences": _silent_externs,
        "final": final_values,
    },
    beside={"file": str, "log?": str, "report?": str},
    engine=one_of("native", "interp", "recorded"),
    real_time={"$ref": "real_time.json"},
    violation_list=JsonObject(
        f"{RESULT}.Violation",
        "what kind time_s count file=span.source.name line=span.line column=span.column",
        kind=one_of("property", "fault"),
    ),
    modules=JsonObject(
        f"{RESULT}.ModuleSummary",
        "ac_share switches_to_sc switches_to_ac gate_faults looks outside first_outside_s "
        "nan_looks",
    ),
    proofs=JsonObject(
        "soter.language.model.proof_verdicts.Proof",
        "properties=verdicts assumptions",
        properties=one_of("proved", "assumed", "undecided", "refuted"),
    ),
    mode_changes=MODE_CHANGE,
    faults=JsonObject(ComponentFaults, "count last first_s latched"),
    extern_silences=JsonObject("soter.simulate.externs.python_answers.Tally", "steps silent"),
)
"""The fields of the document `run` (docs/json.md), without what the command adds."""

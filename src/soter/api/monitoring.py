"""Judges whether runs and logs fit the plants of their proofs.

Purpose: `judge_modules` is what `Program.monitor` does with a log or a run, `judge_log` what
`Program.judge_log` does with a log of another system, and `log_explained` what `--map` with
`--estimates` does.
Non-goals: the judgements themselves (`monitor/model_membership.py`, `monitor/log_replay.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from soter.api.arguments import chosen_modules
from soter.api.output_files import require_utf8
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.elaborate.passes.read_ages import is_measured
from soter.language.evaluate.arithmetic import StepFault
from soter.mapping.read_mapping import make_log_map, read_mapping, system_name
from soter.monitor.decidable_modules import replay_plan
from soter.monitor.doubtful_topics import doubt_notes
from soter.monitor.log_files.read_columns import read_columns
from soter.monitor.log_judgement import LogJudgement, unit_notes
from soter.monitor.log_replay import replay_log
from soter.monitor.model_membership import (
    Judgement,
    flying_topic_names,
    judge_run,
    needed_topics,
    note_alarm,
)
from soter.monitor.typed_samples import read_samples
from soter.report.mcap_reading import log_metadata
from soter.report.wording import changed_parameters
from soter.semantics.publication_gate import check_of_topic
from soter.simulate.run_log import RecordedRun, read_log, record_of_trace
from soter.verify.problem.extract import problem_of_sets

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Any

    from soter.language.model.system import Module, System
    from soter.mapping.topic_mapping import LogMap
    from soter.monitor.log_files.log_columns import Damage
    from soter.monitor.typed_samples import TopicSamples
    from soter.simulate.result import Run
    from soter.verify.problem.problem import Problem


def judge_modules(
    flat: System, log: str | Path | None, run: Run | None, module: str | None, *, estimates: bool
) -> list[Judgement]:
    """Judges one module or all, on a log of the system `flat` or on a run with its trace."""
    notes: tuple[str, ...] = ()
    if run is not None:
        flat, record = run.system, record_of_trace(run)
    else:
        assert log is not None
        record, notes = read_log(Path(log), flat), _other_flight_note(Path(log), flat)
    chosen = chosen_modules(flat, module)
    made = [
        judge_run(flat, m, problem_of_sets(flat, m), record, estimates=estimates) for m in chosen
    ]
    return [replace(j, notes=(*j.notes, *notes)) for j in made]


def _other_flight_note(log: Path, flat: System) -> tuple[str, ...]:
    """A note if the log is from another program or system or has other parameter values."""
    here_by_key = {f"param {name}": text for name, (text, _) in changed_parameters(flat).items()}
    here_by_key |= {"system": flat.name, "program_sha256": flat.program.sha256}
    in_log = {
        k: v for k, v in log_metadata(log).items() if k in here_by_key or k.startswith("param ")
    }
    pairs = [
        (k, in_log.get(k, "the default"), here_by_key.get(k, "the default"))
        for k in in_log | here_by_key
    ]
    texts = [
        f"{k} is {of_log:.12} in the log, {here:.12} here"
        for k, of_log, here in pairs
        if of_log != here
    ]
    return ("what is judged is not what flew: " + "; ".join(texts),) if in_log and texts else ()


def judge_log(
    flat_of: Callable[[str | None, Mapping[str, object] | None], System],
    log: str | Path | Sequence[str | Path],
    mapping: str | Path | Mapping[str, Any],
    *,
    module: str | None = None,
    system: str | None = None,
    params: Mapping[str, object] | None = None,
    where: Mapping[str, str] | None = None,
    partial: bool = False,
    progress: Callable[[float], None] | None = None,
) -> LogJudgement:
    """Judges when modules would have switched on the reads of a log, and how near they came.

    `flat_of`: makes a flat system by name and parameters. `log`: a file, or CSVs that form one log.
    `mapping`: a file or its content; `where`: column -> text of rows that count, besides the
    mapping's own; `partial`: judge a damaged log up to the damage, without a verdict. Raises
    SoterError D015, D016, U001, U003, or D017 if no module can be decided.
    """
    paths, flat, declared = _files_and_mapping(flat_of, log, mapping, system, params, where)
    chosen = [m.index for m in chosen_modules(flat, module)]
    plan = replay_plan(flat, [t.topic.index for t in declared.topics])
    if not set(plan.modules) & set(chosen):
        raise SoterError(
            tuple(missing_error(flat.modules[m].name, plan.missing[m]) for m in chosen)
        )
    columns = read_columns(paths, declared, partial=partial)
    samples = read_samples(paths[0], declared, columns)
    judgement = replay_log(flat, samples, plan, ", ".join(map(str, paths)), progress)
    judgement.modules = [judgement.modules[i] for i in chosen]
    for found in judgement.modules:
        found.beyond_s = max(c.beyond_ns for c in columns.values()) / 1e9
        found.damage = next((c.damage for c in columns.values() if c.damage), None)
    judgement.notes = tuple(dict.fromkeys(n for c in columns.values() for n in c.remarks))
    judgement.unchecked = any(c.unchecked for c in columns.values())
    return judgement


OWN_TOPIC = (
    "each is a topic of its own in the mapping, not a field of another: `[topics.NAME]`, its "
    '`channel` and `fields = { value = "COLUMN" }`: docs/mapping.md'
)


def _require_topics(flat: System, problems: list[tuple[Module, Problem]], mapped: set[str]) -> None:
    wrong = []
    for m, problem in problems:
        if missing := [n for n in needed_topics(flat, m, problem) if n not in mapped]:
            notes = tuple(f"missing: {name}" for name in missing)
            text = f"the log does not say whether the plants of `{m.name}` explain it"
            wrong.append(Diagnostic("D017", text, notes=notes, helps=(OWN_TOPIC,)))
    if wrong:
        raise SoterError(tuple(wrong))


def log_explained(
    flat_of: Callable[[str | None, Mapping[str, object] | None], System],
    log: str | Path | Sequence[str | Path],
    mapping: str | Path | Mapping[str, Any],
    **how: Any,  # noqa: ANN401 - as `mapped_record` has them
) -> list[Judgement]:
    """Judges whether some run of the proof's plants fits the measurements and commands of a log.

    Arguments and errors are as in `judge_log`. Raises D017 unless all driven topics and commands of
    a module are mapped, and R... unless its program determines a proof.
    """
    found = mapped_record(flat_of, log, mapping, **how)
    flat, record = found.flat, found.record
    made = [judge_run(flat, m, p, record, estimates=True, truths=False) for m, p in found.problems]
    for j, (m, p) in zip(made, found.problems, strict=True):
        for name, at_s in found.commands_outside(m, p):
            note_alarm(j, at_s, [f"{name}, outside of its set"])
    notes, (begin, end) = found.notes, found.log_ns
    return [replace(j, length_ns=end - begin, notes=notes, damage=found.damage) for j in made]


@dataclass(frozen=True)
class MappedRecord:
    """A log of another system as a record; `outside` lists, by topic, values outside their sets."""

    flat: System
    problems: list[tuple[Module, Problem]]
    record: RecordedRun
    outside: Mapping[str, list[tuple[float, str]]]
    log_ns: tuple[int, int]
    notes: tuple[str, ...]
    damage: Damage | None

    def commands_outside(self, module: Module, problem: Problem) -> list[tuple[str, float]]:
        """Commands (name, time in s) of a module outside their sets; no run has such commands."""
        names = flying_topic_names(self.flat, module, problem)
        owners = {names[c.owner] for c in problem.quantities.controls} & self.outside.keys()
        return [(name, at_s) for name in owners for at_s, _ in self.outside[name]]


def mapped_record(
    flat_of: Callable[[str | None, Mapping[str, object] | None], System],
    log: str | Path | Sequence[str | Path],
    mapping: str | Path | Mapping[str, Any],
    *,
    module: str | None = None,
    system: str | None = None,
    params: Mapping[str, object] | None = None,
    where: Mapping[str, str] | None = None,
    partial: bool = False,
) -> MappedRecord:
    """The record of a log for `log_explained`, with the same arguments and errors."""
    paths, flat, declared = _files_and_mapping(flat_of, log, mapping, system, params, where)
    mapped = {t.topic.name for t in declared.topics}
    problems = [(m, problem_of_sets(flat, m)) for m in chosen_modules(flat, module)]
    _require_topics(flat, problems, mapped)
    columns = read_columns(paths, declared, partial=partial)
    samples = read_samples(paths[0], declared, columns)
    record, outside = _record_of_samples(flat, samples)
    notes = [*(text for s in samples for text in s.lost), *doubt_notes(flat, samples)]
    for name, found in outside.items():
        first = "the first: {:.3f} s: {}; the model has no such, unless `clip = true`".format(
            *found[0]
        )
        notes.append(f"outside of its set: {len(found):,} samples of {name}, {first}")
    notes += dict.fromkeys(f"of the file: {n}" for c in columns.values() for n in c.remarks)
    notes += unit_notes([x for s in samples for x in s.assumed_units])
    damage = next((c.damage for c in columns.values() if c.damage), None)
    begin, end = samples[0].log_ns
    return MappedRecord(flat, problems, record, outside, (begin, end), tuple(notes), damage)


def _record_of_samples(
    system: System, samples: list[TopicSamples]
) -> tuple[RecordedRun, dict[str, list[tuple[float, str]]]]:
    """The record of all samples once every topic has a value, and the values outside their sets.

    Nothing is interpolated. Times are when values were measured, from the first row of the log on.
    True states are absent; angles are unwrapped; a measurement outside its set is left out.
    """
    topics, at_ns = {t.name: t.default for t in system.topics}, samples[0].log_ns[:1]
    events = [(t, k, i) for k, s in enumerate(samples) for i, t in enumerate(s.stamps_ns or at_ns)]
    events.sort()
    waiting, since = {s.topic.name for s in samples}, set[str]()
    record, outside = RecordedRun([], [], [], []), dict[str, list[tuple[float, str]]]()
    checks = [check_of_topic(s.topic) for s in samples]
    for at, (time_ns, k, i) in enumerate(events):
        topic, value, taken = samples[k].topic, samples[k].values[i], True
        try:
            checks[k](value, topic.symbol.span)
        except StepFault as fault:
            outside.setdefault(topic.name, []).append((time_ns / 1e9, fault.detail))
            taken = not is_measured(system, topic.index)
        if taken:
            before = value if topic.name in waiting else topics[topic.name]
            topics[topic.name] = samples[k].unwrapped_value(before, value)
            since.add(topic.name)
            waiting.discard(topic.name)
        last = at + 1 == len(events) or events[at + 1][0] != time_ns
        if last and since and not waiting:
            record.times_ns.append(time_ns)
            record.topics.append(dict(topics))
            record.truths.append({})
            record.published.append(since)
            since = set()
    return record, outside


def _files_and_mapping(
    flat_of: Callable[[str | None, Mapping[str, object] | None], System],
    log: str | Path | Sequence[str | Path],
    mapping: str | Path | Mapping[str, Any],
    system: str | None,
    params: Mapping[str, object] | None,
    where: Mapping[str, str] | None,
) -> tuple[list[Path], System, LogMap]:
    """The files of a log, the system that a mapping is for, and the mapping."""
    paths = [Path(log)] if isinstance(log, (str, Path)) else [Path(one) for one in log]
    require_utf8(*paths, mapping)
    file = Path(mapping) if isinstance(mapping, (str, Path)) else None
    table = mapping if not isinstance(mapping, (str, Path)) else read_mapping(Path(mapping))
    flat = flat_of(system or system_name(table), params)
    return paths, flat, make_log_map(table, flat, where, file)


def missing_error(module: str, missing: Sequence[object]) -> Diagnostic:
    """The error D017 for a module with topics that a log lacks."""
    notes = tuple(f"missing: {m}" for m in missing)
    return Diagnostic("D017", f"the log does not decide module `{module}`", notes=notes)

"""Writes counterexamples, reads them from files, and replays them in the reference interpreter.

Purpose: a `Counterexample` is a trace of choices (docs/json.md): every value that the environment
or the adversary was free to choose, by stream. A refutation counts only if the interpreter, given
these choices and nothing else, leaves C, or comes back to a state it was in without ever having
satisfied `safer`. A choice outside its declared set, or a missing one, is no run of the system.
`save_counterexamples` writes `.soter/<program>-<module>.counterexample.json` for each refutation of
a report; `replay_file` runs such a file again.
Non-goals: finding such runs (`refute.py`); choices of order (`explore/`): all runs here are
in deployed order.
"""

from __future__ import annotations

import json
from collections import deque
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.system_texts import reason
from soter.language.evaluate.arithmetic import StepFault
from soter.language.front_end import check_file, system_to_prove
from soter.language.load.named_files import ReadError, parse_json, read_json_text
from soter.language.model.values import to_json
from soter.report.atomic_write import path_without_links
from soter.semantics.configuration import SC, DecisionVerdict
from soter.semantics.externs import UnboundExternError
from soter.semantics.interpreter import Interpreter
from soter.semantics.recorded_draws import ChoiceError, RecordedDraws, Recorder
from soter.semantics.rules import next_instant
from soter.verify.attacked_system import (
    DRAWN,
    OWN,
    attacked_system,
    may_read_time,
    true_topics_known_ns,
)
from soter.verify.problem.extract import extract
from soter.version import why_format_is_unreadable

if TYPE_CHECKING:
    from soter.language.model.system import System
    from soter.language.model.types import Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.draws import Draws
    from soter.semantics.recorded_draws import Choices
    from soter.verify.claims.results import ModuleResult, VerifyReport

    _Instant = tuple[Configuration, tuple[DecisionVerdict, ...], dict[str, Value]]


SCHEMA = 1
LEAVES, CYCLE = "leaves_safe", "never_safer"
"""The kinds of violations: the true state leaves C; or the DM never gives control back."""
STEPS_KEPT = 50


@dataclass(frozen=True, kw_only=True)
class Counterexample:
    """A run of the closed system, stored as the choices that make it, with times in ns."""

    module: str
    shows: str
    """The kind of the violation: LEAVES or CYCLE."""
    controller: str
    """DRAWN: the AC's outputs are choices, too; OWN: the program's AC ran."""
    seed: int
    """The seed with which the choices were found, with the pattern in its top byte."""
    time_ns: int
    """For LEAVES the instant outside C; for CYCLE the end of one turn."""
    cycle_ns: int | None
    """For CYCLE the length of one turn."""
    choices: Choices
    steps: tuple[dict[str, Any], ...] = ()
    """The last instants for people: time_s, modes, topics, choices and true states."""
    facts: dict[str, Any] = field(default_factory=dict)
    """The program that it belongs to: program, sha256, system, params."""

    def __str__(self) -> str:
        """Several lines for people that sum up the run."""
        whose = "with the program's own AC" if self.controller == OWN else "with some AC"
        at = _seconds(self.time_ns)
        if self.shows == LEAVES:
            head = f"{whose}, the true state leaves `safe` of {self.module} at {at}"
        else:
            assert self.cycle_ns is not None
            head = (
                f"{whose}, {self.module} stays in SC for ever: at {at} everything is as it was "
                f"{_seconds(self.cycle_ns)} before, and `safer` did not hold"
            )
        lines = [head, *[f"chosen: {line}" for line in _choice_lines(self.choices)]]
        if self.steps:
            last = self.steps[-1]
            states = ", ".join(
                f"{plant}.{name} = {value}"
                for plant, values in last["truth"].items()
                for name, value in values.items()
            )
            modes = ", ".join(f"{m} in {mode}" for m, mode in last["modes"].items())
            lines.append(f"then: {states}; {modes}")
        return "\n".join(lines)


def _seconds(ns: int) -> str:
    return f"{ns / 1e9:.9g} s"


def _choice_lines(choices: Choices) -> list[str]:
    """A line for each stream of choices: its value, or how often it changes."""
    lines = []
    for stream, values in choices.items():
        first = values[0][1]
        if len(values) == 1:
            lines.append(f"{stream} = {first}")
        else:
            more = len(values) - 1
            lines.append(f"{stream} = {first} first, {more} change{'s' if more > 1 else ''}")
    return lines


@dataclass(frozen=True)
class Replay:
    """A replayed run of the attacked system `system`, up to the violation at `time_ns`."""

    time_ns: int
    steps: tuple[dict[str, Any], ...]
    system: System


def replay_choices(c: Counterexample, system: System) -> Replay | None:
    """Runs a counterexample in the interpreter; None if the run does not show the violation.

    `system`: the verification system of the module, before it is attacked.
    """
    index = next((m.index for m in system.modules if m.name == c.module), None)
    if index is None:
        return None
    variant = attacked_system(system, index, c.controller)
    draws = RecordedDraws(c.choices)
    try:
        if c.shows == LEAVES:
            return run_that_leaves(variant, draws, c.time_ns)
        if any(len(chosen) != 1 for chosen in c.choices.values()) or not c.cycle_ns:
            return None
        return run_that_repeats(variant, index, draws, c.time_ns, c.cycle_ns)
    except (ChoiceError, UnboundExternError):
        return None


def run_that_leaves(variant: System, draws: Draws, until_ns: int) -> Replay | None:
    """The run until `safe` is first false on the true state; None if that is not by `until_ns`.

    A `safe` that faults is not false: such an instant does not count.
    """
    run = _AttackedRun(variant, draws)
    known_ns = true_topics_known_ns(variant)
    while run.next_ns <= until_ns:
        c = run.run_instant()
        if c.ct >= known_ns and run.is_unsafe():
            return Replay(c.ct, run.last_steps(), variant)
    return None


def run_that_repeats(
    variant: System, module: int, draws: Draws, until_ns: int, cycle_ns: int
) -> Replay | None:
    """The run if its state at `until_ns` equals that `cycle_ns` earlier, under SC; else None.

    Because choices are constant, the run then repeats this cycle for ever; in it no DM step found
    `safer` on a fresh reading.
    """
    if cycle_ns % variant.hyperperiod_ns or may_read_time(variant, module):
        return None
    run = _AttackedRun(variant, draws)
    began: object = None
    known_ns = true_topics_known_ns(variant)
    while run.next_ns <= until_ns:
        c = run.run_instant()
        if c.ct >= known_ns and run.is_unsafe():
            return None
        if c.ct == until_ns - cycle_ns:
            began = run.repeating_state(module)
            run.returned = False
    if (
        began is None
        or run.c.ct != until_ns
        or run.returned
        or began != run.repeating_state(module)
    ):
        return None
    return Replay(until_ns, run.last_steps(), variant)


class _AttackedRun:
    """Runs an attacked system, instant by instant."""

    def __init__(self, variant: System, draws: Draws) -> None:
        self.system = variant
        self._drawn = Recorder(draws)
        self.interpreter = Interpreter(variant, draws=self._drawn)
        self.c: Configuration = self.interpreter.initial()
        self.returned = False
        """Whether a DM step of this turn said AC, could have said it, or had a stale read."""
        self._last: deque[_Instant] = deque(maxlen=STEPS_KEPT)

    @property
    def next_ns(self) -> int:
        return next_instant(self.interpreter.machine, self.c)

    def run_instant(self) -> Configuration:
        events = _Events()
        self.c = self.interpreter.instant(self.c, record=events)  # type: ignore[arg-type]
        verdicts = tuple(events.verdicts)
        self.returned |= any(v.before != SC or v.safer or v.stale or v.gate_fault for v in verdicts)
        if verdicts:
            self._last.append((self.c, verdicts, self._choices_so_far()))
        return self.c

    def _choices_so_far(self) -> dict[str, Value]:
        """The last value of each stream of choices, which acts on the plants from here on."""
        return {stream: noted[-1][1] for stream, noted in self._drawn.choices.items()}

    def is_unsafe(self) -> bool:
        machine = self.interpreter.machine
        condition, wanted = machine.properties[0]
        try:
            return bool(condition(machine.environment(self.c))) != wanted
        except StepFault:
            return False

    def repeating_state(self, module: int) -> object:
        """The parts of the state that determine the future, without the time itself."""
        c = self.c
        ages = tuple(c.ct - c.stamps[t] for t in self.system.modules[module].inputs)
        return (
            (c.L, c.OE, c.FN, c.latched, c.had_control, c.gate_fault, c.clean_needed),
            (repr(c.Topics), repr(c.L), ages),
        )

    def last_steps(self) -> tuple[dict[str, Any], ...]:
        """Describes, for people, the last DM instants and the final instant."""
        documents = [self._step_document(*kept) for kept in self._last]
        if not self._last or self._last[-1][0] is not self.c:
            documents.append(self._step_document(self.c, (), self._choices_so_far()))
        return tuple(documents)

    def _step_document(
        self, c: Configuration, verdicts: tuple[DecisionVerdict, ...], chosen: dict[str, Value]
    ) -> dict[str, Any]:
        system = self.system
        plants = [x for x in system.components if x.plant is not None]
        return {
            "time_s": c.ct / 1e9,
            "modes": {m.name: "AC" if c.L[m.dm] else "SC" for m in system.modules},
            "decisions": {
                system.modules[v.module].name: {"ttf": v.ttf, "safer": v.safer, "stale": v.stale}
                for v in verdicts
            },
            "truth": {
                x.name: {
                    v.name: to_json(v.type, c.L[x.index][i])
                    for i, v in enumerate(x.plant.states if x.plant else ())
                }
                for x in plants
            },
            "topics": {t.name: to_json(t.type, c.Topics[t.index]) for t in system.topics},
            "chosen": chosen,
        }


class _Events:
    """Records the verdicts of DMs, and no other events."""

    def __init__(self) -> None:
        self.verdicts: list[DecisionVerdict] = []

    def note_event(self, event: object, _ct: int) -> None:
        if isinstance(event, DecisionVerdict):
            self.verdicts.append(event)

    def note_properties(self, _violated: object, _ct: int) -> None:
        """Ignores violations, because `is_unsafe` judges `safe` without counting faults."""


def write_counterexample(c: Counterexample, path: Path) -> Path:
    """Writes a counterexample as JSON, which docs/json.md describes."""
    document = {
        "schema": SCHEMA,
        "kind": "counterexample",
        **c.facts,
        **{k: v for k, v in asdict(c).items() if k != "facts"},
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(document, indent=1, allow_nan=False) + "\n"
    path_without_links(path.parent, path.name).write_text(text, encoding="utf-8")
    return path


TIME_MAX = 10**15
"""The longest counterexample in ns, some eleven days; a longer one is damaged."""


def read_counterexample(path: Path) -> Counterexample:
    """Reads a counterexample; raises `ValueError` if the file has no data of this schema."""
    document = parse_json(read_json_text(path))
    if not isinstance(document, dict) or document.get("kind") != "counterexample":
        raise ValueError(f"`{path}` is no counterexample")
    if other := why_format_is_unreadable(document.get("schema"), SCHEMA):
        raise ValueError(f"`{path}`: {other}: `soter verify` writes it anew")
    known = {"schema", "kind", "module", "shows", "controller", "seed", "time_ns", "cycle_ns"}
    facts = {k: v for k, v in document.items() if k not in known | {"choices", "steps"}}
    try:
        _checked_type(facts.get("params", {}), dict)
        cycle = document["cycle_ns"]
        return Counterexample(
            module=_checked_type(document["module"], str),
            shows=_known_word(document["shows"], (LEAVES, CYCLE)),
            controller=_known_word(document["controller"], (OWN, DRAWN)),
            seed=_checked_type(document["seed"], int),
            time_ns=_checked_time(document["time_ns"]),
            cycle_ns=None if cycle is None else _checked_time(cycle),
            choices={
                str(s): _chosen_values(chosen)
                for s, chosen in _checked_type(document["choices"], dict).items()
            },
            steps=tuple(_checked_type(document["steps"], list)),
            facts=facts,
        )
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"`{path}` is a damaged counterexample: {error}") from error


def _checked_type(value: Any, wanted: type) -> Any:  # noqa: ANN401 - any JSON
    if not isinstance(value, wanted) or isinstance(value, bool):
        raise TypeError(f"{str(value)[:40]!r} is no {wanted.__name__}")
    return value


def _known_word(value: object, known: tuple[str, ...]) -> str:
    if value not in known:
        raise TypeError(f"{str(value)[:40]!r} is none of {', '.join(known)}")
    return str(value)


def _checked_time(value: object) -> int:
    time: int = _checked_type(value, int)
    if not 0 <= time <= TIME_MAX:
        raise TypeError("a time is out of range")
    return time


def _chosen_values(entries: object) -> list[tuple[int, Any]]:
    """The choices of one stream as (index, value); later draws check the values."""
    choices = []
    for entry in _checked_type(entries, list):
        index, value = _checked_type(entry, list)
        if isinstance(value, (list, dict, str)) or value is None:
            raise TypeError("a choice is no value")
        choices.append((_checked_type(index, int), value))
    if not choices:
        raise TypeError("a stream without choices")
    return choices


FOLDER = Path(".soter")


class AnotherVersionError(ValueError):
    """Raised if a counterexample belongs to another version of the program's text."""


def save_counterexamples(report: VerifyReport) -> None:
    """Writes every counterexample and notes its file in the finding; raises `SoterError` D006."""
    for module in report.modules:
        for name, finding in module.findings.items():
            run = finding.counterexample
            if isinstance(run, Counterexample):
                kind = "" if run.shows == LEAVES else f"-{name}"
                stem = f"{Path(report.path).stem}-{module.name}{kind}"
                path = FOLDER / f"{stem}.counterexample.json"
                if _system_of(path) not in {None, report.system}:
                    path = FOLDER / f"{stem}-{report.system}.counterexample.json"
                _write_or_refuse(replace(run, facts=_facts_of_run(report, module)), path)
                finding.saved = path


def _system_of(path: Path) -> object:
    """The name of the system of the run in a file; None if the file cannot be read."""
    try:
        return read_counterexample(path).facts.get("system")
    except (ReadError, ValueError):
        return None


def _facts_of_run(report: VerifyReport, module: ModuleResult) -> dict[str, object]:
    params = module.problem.system.params
    return {
        "program": report.path,
        "program_sha256": report.program_sha256,
        "system": report.system,
        "instance": module.name,
        "params": dict(params),
    }


def _write_or_refuse(run: Counterexample, path: Path) -> None:
    try:
        write_counterexample(run, path)
    except OSError as error:
        message = f"cannot write `{path}`: {reason(error)}"
        raise SoterError((Diagnostic("D006", message),)) from error


def replay_file(path: Path) -> Replay | None:
    """Runs the counterexample of a file in the interpreter; None if it shows no violation.

    Raises `ValueError` if the file is no counterexample, `AnotherVersionError` if it belongs to
    another text of the program, `SoterError` if the program cannot be read.
    """
    run = read_counterexample(path)
    facts = run.facts
    named = _program_path(path, str(facts.get("program", "")))
    checked = check_file(named)
    if not checked.begins_as_program:
        raise AnotherVersionError(f"`{path}` belongs to another version of `{named}`")
    if not checked.ok or checked.program is None:
        raise SoterError(checked.diagnostics.items)
    if checked.program.sha256 != facts.get("program_sha256"):
        raise AnotherVersionError(
            f"`{path}` belongs to another version of `{checked.program.path}`"
        )
    for name in str(facts.get("system", "")).split(", "):
        flat = system_to_prove(checked, name or None, facts.get("params") or {})
        for module in flat.modules:
            if module.name == facts.get("instance"):
                return replay_choices(run, extract(flat, module).system)
    raise ValueError(f"its program has no module `{facts.get('instance')}`")


def _program_path(path: Path, named: str) -> str:
    """The path of a counterexample's program: the path in the file, or one near the file."""
    if not Path(named).is_file():
        for folder in (path.resolve().parent.parent, path.resolve().parent):
            if (folder / named).is_file():
                return str(folder / named)
    return named

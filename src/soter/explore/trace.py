"""A trace: one execution of a test as the steps and choices that make it, and its file.

Purpose: a `Trace` is plain data for the steps of docs/testing.md; it is written as JSON
(docs/json.md) and read back with every field checked, as a file may be damaged or malicious.
`ChoiceWords` puts what a pick of `choose` stands for into the words of the program, where these
determine it without being run.
Non-goals: whether the steps are allowed and what they lead to (`replay.py`); guesses about a pick
that may be one of several choices.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.system_texts import reason
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.load.named_files import parse_json, read_bytes
from soter.language.model import typed
from soter.language.model.tree_walk import nodes, plant_code
from soter.language.model.types import BoolType
from soter.language.model.values import to_json
from soter.report.atomic_write import path_without_links
from soter.version import why_format_is_unreadable

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from soter.language.model.system import Component, System


SCHEMA = 1
KIND = "soter trace"

STEP, LOST, BEGIN, EFFECT, START = "step", "lost", "begin", "effect", "start"
STEP_KINDS = (STEP, LOST, BEGIN, EFFECT, START)
"""In the order of the numbers in `soter_explore.h`: a step; a lost release; an overrunning step
that begins; its publications take effect; the start."""

PROPERTY, CONTRACT, FAULT, TIMED = "property", "contract", "fault", "timed"
VIOLATION_KINDS = (PROPERTY, CONTRACT, FAULT, TIMED)
"""In the order of the numbers in `soter_explore.h`: what `index` of a violation counts."""

TIME_MAX = 2**62
COUNT_MAX = 2**32
BYTES_MAX = 64 * 2**20
"""A larger file is not read: a trace of a million steps takes about this many bytes."""


@dataclass(frozen=True)
class Choice:
    """One question that a step left open: alternative `pick` of `of`; `value` is for people."""

    stream: str
    pick: int
    of: int
    value: object = None


@dataclass(frozen=True)
class Step:
    """One step; `actor` is a component's full name, `input.<topic>`, or "" for the start."""

    actor: str
    kind: str
    release_ns: int
    time_ns: int
    choices: tuple[Choice, ...] = ()


@dataclass(frozen=True)
class ViolationId:
    """A violated property or fault: `what` is of VIOLATION_KINDS, `index` of the flat system."""

    what: str
    index: int
    text: str


@dataclass(frozen=True)
class Trace:
    """An execution that violates a property, and the test to which it belongs.

    `program`: the path as the user gave it; in the file, a path relative to the file. `params`: the
    parameters that the user set, as JSON. `seed`: determines all random draws. Times are in ns.
    """

    program: str
    sha256: str
    system: str
    test: str
    params: Mapping[str, object]
    seed: int
    skew_ns: int
    horizon_ns: int
    broken: ViolationId
    steps: tuple[Step, ...]
    minimal: bool
    not_shortest: str = ""
    """Why it may not be the shortest one, in words; "" where it is, or that is not known."""
    assumptions: tuple[str, ...] = ()
    """The assumptions of the verdict, in words."""
    shrunk_from: int = 0
    """How many steps, with the start, the trace had before it was shrunk; 0: it was not."""
    path: Path | None = field(default=None, compare=False)
    """The file that it was read from."""


class DamagedTraceError(Exception):
    """An error for a document that is no trace; the text says what is wrong with the document."""


# ---------------------------------------------------------------- writing


def trace_document(trace: Trace, folder: Path | None = None) -> dict[str, object]:
    """The JSON document of a trace; if `folder` is set, the program's path is relative to it."""
    return {
        "schema": SCHEMA,
        "kind": KIND,
        "program": _relative_path(trace.program, folder),
        "sha256": trace.sha256,
        "system": trace.system,
        "test": trace.test,
        "params": dict(trace.params),
        "seed": trace.seed,
        "skew_ns": trace.skew_ns,
        "horizon_ns": trace.horizon_ns,
        "property": {
            "what": trace.broken.what,
            "index": trace.broken.index,
            "text": trace.broken.text,
        },
        "minimal": trace.minimal,
        "not_shortest": trace.not_shortest,
        "shrunk_from": trace.shrunk_from,
        "assumptions": list(trace.assumptions),
        "steps": [_step_document(s) for s in trace.steps],
    }


def _step_document(step: Step) -> dict[str, object]:
    choices = [
        {"stream": c.stream, "pick": c.pick, "of": c.of, "value": c.value} for c in step.choices
    ]
    return {
        "actor": step.actor,
        "kind": step.kind,
        "release_ns": step.release_ns,
        "time_ns": step.time_ns,
        "choices": choices,
    }


def _relative_path(program: str, folder: Path | None) -> str:
    if folder is None:
        return program
    try:
        return Path(os.path.relpath(program, folder)).as_posix()
    except ValueError:  # another drive
        return program


def write_trace(trace: Trace, path: Path) -> Path:
    """Writes a trace as JSON, one line for each step; raises SoterError D006 if it cannot."""
    document = trace_document(trace, path.parent)
    steps = document.pop("steps")
    assert isinstance(steps, list)
    head = json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False)
    lines = ",\n  ".join(json.dumps(s, allow_nan=False, ensure_ascii=False) for s in steps)
    text = f'{head[:-2]},\n "steps": [\n  {lines}\n ]\n}}\n'
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path_without_links(path.parent, path.name).write_text(text, encoding="utf-8")
    except OSError as error:
        message = f"cannot write `{path}`: {reason(error)}"
        raise SoterError((Diagnostic("D006", message),)) from error
    return path


# ---------------------------------------------------------------- reading


def read_document(path: Path) -> dict[str, Any]:
    """The JSON object in a file; raises SoterError D010 if the file holds no object."""
    try:
        document = parse_json(read_bytes(path, BYTES_MAX))
    except OSError as error:
        raise no_trace_error(path, reason(error)) from error
    except RecursionError:
        raise no_trace_error(path, "it is nested too deeply") from None
    except ValueError as error:
        raise no_trace_error(path, f"it is no JSON ({_first_line(error)})") from error
    if not isinstance(document, dict):
        raise no_trace_error(path, "it is no JSON object")
    return document


def trace_from_document(document: Mapping[str, Any], path: Path) -> Trace:
    """The trace in a document that was read from `path`; raises SoterError D010 if it is none."""
    try:
        return _read_trace(_JsonFields(document, ""), path)
    except DamagedTraceError as error:
        raise no_trace_error(path, str(error)) from error


def no_trace_error(path: Path, reason: str) -> SoterError:
    """The SoterError D010, which says that the file is no trace, and why."""
    hint = "`soter test` writes one for every violation, `.soter/<program>-<test>.trace.json`"
    problem = Diagnostic("D010", f"`{path}` is no trace: {reason}", helps=(hint,))
    return SoterError((problem,))


def _first_line(error: Exception) -> str:
    return str(error).split("\n", 1)[0][:100]


class _JsonFields:
    """Reads the fields of a JSON object, and checks the type of each field."""

    def __init__(self, data: object, where: str) -> None:
        if not isinstance(data, dict):
            raise DamagedTraceError(f"{where or 'the document'} is no object")
        self._fields = data
        self._where = where

    def _field(self, name: str, wanted: type, noun: str) -> Any:  # noqa: ANN401 - any JSON
        if name not in self._fields:
            raise DamagedTraceError(f"{self._quoted_path(name)} is missing")
        value = self._fields[name]
        if not isinstance(value, wanted) or (wanted is int and isinstance(value, bool)):
            raise DamagedTraceError(f"{self._quoted_path(name)} is no {noun}")
        return value

    def _quoted_path(self, name: str) -> str:
        return f"`{self._where}.{name}`" if self._where else f"`{name}`"

    def read_text(self, name: str) -> str:
        value: str = self._field(name, str, "text")
        return value

    def read_optional_text(self, name: str) -> str:
        """The text of a field; "" if the field is missing."""
        return self.read_text(name) if name in self._fields else ""

    def read_texts(self, name: str) -> tuple[str, ...]:
        """The texts in a list; () if the field is missing."""
        values = self._field(name, list, "list") if name in self._fields else []
        if not all(isinstance(text, str) for text in values):
            raise DamagedTraceError(f"{self._quoted_path(name)} is no list of texts")
        return tuple(values)

    def read_one_of(self, name: str, allowed: Iterable[str]) -> str:
        value = self.read_text(name)
        if value not in allowed:
            raise DamagedTraceError(f"{self._quoted_path(name)} is none of {', '.join(allowed)}")
        return value

    def read_number(self, name: str, low: int, high: int) -> int:
        value: int = self._field(name, int, "whole number")
        if not low <= value <= high:
            raise DamagedTraceError(f"{self._quoted_path(name)} is out of range")
        return value

    def read_optional_number(self, name: str, low: int, high: int) -> int | None:
        """The number of a field; None if the field is missing."""
        return self.read_number(name, low, high) if name in self._fields else None

    def read_bool(self, name: str) -> bool:
        value: bool = self._field(name, bool, "bool")
        return value

    def read_object(self, name: str) -> _JsonFields:
        return _JsonFields(self._field(name, dict, "object"), self._path(name))

    def read_mapping(self, name: str) -> dict[str, object]:
        value: dict[str, object] = self._field(name, dict, "object")
        return value

    def read_objects(self, name: str) -> list[_JsonFields]:
        items = self._field(name, list, "list")
        return [_JsonFields(item, f"{self._path(name)}[{i}]") for i, item in enumerate(items)]

    def raw_value(self, name: str) -> object:
        return self._fields.get(name)

    def _path(self, name: str) -> str:
        return f"{self._where}.{name}" if self._where else name


def _read_trace(document: _JsonFields, path: Path) -> Trace:
    if document.raw_value("kind") != KIND:
        raise DamagedTraceError(f'`kind` is not "{KIND}"')
    if other := why_format_is_unreadable(document.raw_value("schema"), SCHEMA):
        raise DamagedTraceError(other)
    broken = document.read_object("property")
    return Trace(
        program=document.read_text("program"),
        sha256=document.read_text("sha256"),
        system=document.read_text("system"),
        test=document.read_text("test"),
        params=document.read_mapping("params"),
        seed=document.read_number("seed", 0, 2**64 - 1),
        skew_ns=document.read_number("skew_ns", 0, TIME_MAX),
        horizon_ns=document.read_number("horizon_ns", 1, TIME_MAX),
        broken=ViolationId(
            broken.read_one_of("what", VIOLATION_KINDS),
            broken.read_number("index", 0, COUNT_MAX),
            broken.read_text("text"),
        ),
        steps=tuple([_read_step(s) for s in document.read_objects("steps")]),
        minimal=document.read_bool("minimal"),
        not_shortest=document.read_optional_text("not_shortest"),
        assumptions=document.read_texts("assumptions"),
        shrunk_from=document.read_optional_number("shrunk_from", 0, COUNT_MAX) or 0,
        path=path,
    )


def _read_step(document: _JsonFields) -> Step:
    return Step(
        actor=document.read_text("actor"),
        kind=document.read_one_of("kind", STEP_KINDS),
        release_ns=document.read_number("release_ns", -1, TIME_MAX),
        time_ns=document.read_number("time_ns", -1, TIME_MAX),
        choices=tuple([_read_choice(c) for c in document.read_objects("choices")]),
    )


def _read_choice(document: _JsonFields) -> Choice:
    of = document.read_number("of", 1, COUNT_MAX)
    pick = document.read_number("pick", 0, COUNT_MAX)
    if pick >= of:
        raise DamagedTraceError(f"a pick is {pick} of {of} alternatives: they count from 0")
    return Choice(document.read_text("stream"), pick, of, document.raw_value("value"))


def program_path(trace: Trace) -> str:
    """The path of a trace's program: relative to the file it was read from, or as it was given."""
    if trace.path is not None:
        beside = Path(os.path.normpath(trace.path.parent / trace.program))
        if beside.is_file() or not Path(trace.program).is_file():
            return str(beside)
    return trace.program


CHOOSE_STREAM_ENDING = ".choose"
_CLOSED = (
    typed.Literal,
    typed.ParamRead,
    typed.TypedUnary,
    typed.TypedBinary,
    typed.Vector,
    typed.Aggregate,
    typed.Narrow,
)


@dataclass(frozen=True)
class _ChoiceSite:
    """A `choose` in the code of a component."""

    expr: typed.TypedChoose
    component: Component

    def may_ask(self, count: int) -> bool:
        """Whether the `choose` can offer `count` alternatives; a fair one may offer fewer."""
        return count == self.expr.count or (self.expr.ages is not None and count < self.expr.count)

    def json_value(self, pick: int, count: int) -> object:
        """The value of an alternative as JSON; None if it depends on the run."""
        if count != self.expr.count:
            return None
        if not self.expr.options:
            number = self.expr.low + pick
            value = bool(number) if isinstance(self.expr.type, BoolType) else number
            return to_json(self.expr.type, value)
        option = self.expr.options[pick]
        if not all(isinstance(part, _CLOSED) for part in nodes([option])):
            return None
        constant = Evaluator.for_scope(self.component.scope).compiled(option)(Environment())
        return to_json(option.type, constant)


class ChoiceWords:
    """Gives the choices of a trace their values (`with_value`) and their `question_text`."""

    def __init__(self, system: System) -> None:
        self._sites = {
            c.name + CHOOSE_STREAM_ENDING: [
                _ChoiceSite(e, c) for e in nodes(_step_code(c)) if isinstance(e, typed.TypedChoose)
            ]
            for c in system.components
        }

    def with_value(self, choice: Choice) -> Choice:
        """The choice with its value added, if the program determines the value without a run."""
        site = self._asking_site(choice)
        if choice.value is not None or site is None:
            return choice
        return replace(choice, value=site.json_value(choice.pick, choice.of))

    def question_text(self, choice: Choice) -> str:
        """The source text of the `choose` that asked; if unclear, the name of the stream."""
        site = self._asking_site(choice)
        return choice.stream if site is None else site.expr.span.text_on_one_line

    def _asking_site(self, choice: Choice) -> _ChoiceSite | None:
        """The `choose` that asked; None if several fit and they differ in text or value."""
        fitting = [a for a in self._sites.get(choice.stream, ()) if a.may_ask(choice.of)]
        meanings = {
            (a.expr.span.text_on_one_line, str(a.json_value(choice.pick, choice.of)))
            for a in fitting
        }
        return fitting[0] if len(meanings) == 1 else None


def _step_code(component: Component) -> Iterable[object]:
    if component.plant is not None:
        return plant_code(component.plant)
    return () if component.node is None else component.node.step


def changed_program_error(trace: Trace, path: str) -> SoterError:
    """The SoterError D011, which says that the program has changed since the trace was found."""
    problem = Diagnostic(
        "D011",
        f"the trace belongs to another version of `{path}`",
        notes=(f"it was found in the program with the hash {trace.sha256[:12]}",),
        helps=("search again: `soter test`",),
    )
    return SoterError((problem,))


def missing_program_error(trace: Trace, path: str) -> SoterError:
    """The SoterError D001, which says that the program is not at the path in the trace."""
    problem = Diagnostic(
        "D001",
        f"the program of the trace is not there: `{path}`",
        notes=("a trace looks for its program relative to its own place",),
        helps=(f"move them together: the trace says `{trace.program}`",),
    )
    return SoterError((problem,))

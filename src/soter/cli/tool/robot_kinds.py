"""The robots of `soter new --robot KIND`: texts of a kind, with figures of one's own.

Purpose: `robot_kinds` lists them; `texts_of_kind` gives the files of a robot. Figures are the
constants at the head of its program that are a number or a time; its other files name them as
`{{MASS}}`.
Non-goals: what a robot is and how it is proved: all of that stands in its program.
"""

from __future__ import annotations

import re
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from soter.api.arguments import time_ns
from soter.diagnostics.diagnostic import Diagnostic, SoterError, mistake
from soter.diagnostics.render import safe
from soter.diagnostics.similar_names import nearest_or_all
from soter.language.model.types import write_ns

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


class LogSurvey(Protocol):
    """The part of `monitor.log_survey.LogSurvey` (of an add-on) that this file reads."""

    channels: dict[str, Channel]


class Channel(Protocol):
    """A channel of the log, with its fields by name."""

    fields: dict[str, Range]
    kept_fields: list[str]

    def proposed_max_age_ns(self) -> int:
        """The largest age, in ns, that the survey proposes for the samples of the channel."""


class Range(Protocol):
    """The lowest and the highest number of a field."""

    low: float
    high: float


FOLDER = Path(__file__).parents[1] / "templates" / "robots"
SHARED, PROGRAM, MAPPING = "shared", "NAME.soter", "NAME.toml"
RENAMED = (("test_NAME", "test_{{prefix}}"), ("NAME", "{{name}}"), ("gitignore", ".gitignore"))
FIGURE = re.compile(r"^const (\w+): (float|duration) = (-?\d[\w.+-]*);  // (.*)$", re.MULTILINE)
CHANNEL = re.compile(r'^(?:channel = "|type = "mavlink/)(.*)"$', re.MULTILINE)
AGE = "AGE"
"""The figure that every kind has: how old what its decision module reads may be."""


def robot_kinds() -> dict[str, str]:
    """By kind of robot: a line about it, which is the first sentence of its program."""
    programs = sorted(FOLDER.glob(f"*/{PROGRAM}"))
    heads = [p.read_text(encoding="utf-8").partition("{{name}}: ")[2] for p in programs]
    lines = [" ".join(head.partition(".")[0].replace("\n//", "").split()) for head in heads]
    return {p.parent.name: line for p, line in zip(programs, lines, strict=True)}


def texts_of_kind(
    kind: str, names: Mapping[str, str], settings: Sequence[str], survey: LogSurvey | None
) -> dict[str, str]:
    """The texts of a robot's files by name; SoterError U001 or U004 for wrong figures, or D016."""
    known = robot_kinds()
    if kind not in known:
        lines = (f"{name}: {line}" for name, line in known.items())
        message = f"there is no kind of robot `{safe(kind)[:40]}`"
        raise mistake("U001", message, nearest_or_all(kind, known), notes=("there are", *lines))
    paths = [p for folder in (SHARED, kind) for p in sorted((FOLDER / folder).iterdir())]
    texts = {
        p.name.removesuffix(".in"): p.read_text(encoding="utf-8") for p in paths if p.is_file()
    }
    figures = _figure_values(texts[PROGRAM], settings)
    if survey is not None:
        _fill_from_log(texts, figures, survey, settings)
    texts[PROGRAM] = FIGURE.sub(
        lambda m: f"const {m[1]}: {m[2]} = {figures[m[1]]};  // {m[4]}", texts[PROGRAM]
    )
    return {
        _filled_text(name, RENAMED, names): _filled_text(text, (), {**names, **figures})
        for name, text in texts.items()
    }


def _figure_values(program: str, settings: Sequence[str]) -> dict[str, str]:
    """The value of every figure, by name, in Soter's notation; SoterError U001 or U004."""
    known = {m[1]: m for m in FIGURE.finditer(program)}
    values, problems = {name: m[3] for name, m in known.items()}, list[Diagnostic]()
    for word in settings:
        name, _, text = word.partition("=")
        if name not in known:
            rows = (f"{n}: {m[4]}; {m[3]}" for n, m in known.items())
            message, help_ = f"there is no figure `{safe(name)[:40]}`", nearest_or_all(name, known)
            problems.append(Diagnostic("U004", message, notes=("there are", *rows), helps=(help_,)))
            continue
        try:
            values[name] = _checked_figure(name, text, known[name])
        except SoterError as error:
            problems += error.diagnostics
    if problems:
        raise SoterError(tuple(problems))
    return values


def _checked_figure(name: str, text: str, known: re.Match[str]) -> str:
    """The value that a user set for a figure, as text; SoterError U001 for an impossible value."""
    if known[2] == "duration":
        return write_ns(time_ns(name, text) or 0)
    try:
        number = float(text)
    except ValueError:
        number = float("nan")
    if isfinite(number) and (number >= 0 or known[3].startswith("-")):
        return repr(number)
    rule = f"a number{'' if known[3].startswith('-') else ' from 0 on'}: {known[4]}"
    raise mistake("U001", f"`{name}` cannot be `{safe(text)[:40]}`", rule)


def _fill_from_log(
    texts: dict[str, str], figures: dict[str, str], survey: LogSurvey, settings: Sequence[str]
) -> None:
    """Puts the age of a log's samples into the figures, and its ranges into the program's head."""
    channel = CHANNEL.findall(texts[MAPPING])[0]
    found = survey.channels.get(channel)
    age = found.proposed_max_age_ns() if found is not None else 0
    if found is None or not age:
        channels = ", ".join(f"`{safe(name)[:60]}`" for name in list(survey.channels)[:8])
        message = f"the log does not say how often `{channel}` comes, which this kind reads"
        raise mistake("D016", message, f"without --from, and {AGE} by --set", f"it has {channels}")
    if not any(word.startswith(f"{AGE}=") for word in settings):
        figures[AGE] = write_ns(age)
    ranges = (
        f"// {safe(p)}: {found.fields[p].low:.6g} to {found.fields[p].high:.6g}\n"
        for p in found.kept_fields[:8]
    )
    comment = f"// A log's `{channel}` gave {AGE}, and ranges to compare the figures with:\n"
    head, at, rest = texts[PROGRAM].partition("const ")
    texts[PROGRAM] = head + comment + "".join(ranges) + at + rest


def _filled_text(text: str, renamed: Sequence[tuple[str, str]], values: Mapping[str, str]) -> str:
    for old, new in (*renamed, *(("{{" + name + "}}", value) for name, value in values.items())):
        text = text.replace(old, new)
    return text

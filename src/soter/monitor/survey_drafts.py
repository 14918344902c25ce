"""Drafts the first files of a program from the survey of a log.

Purpose: `program_head` and `mapping_of_log` are the drafts of `soter new --from`.
Non-goals: reading a log (`log_survey.py`); what a topic is called in somebody's program, units.
"""

from __future__ import annotations

import json
import re
from statistics import median
from typing import TYPE_CHECKING

from soter.diagnostics.render import safe
from soter.language.model.types import write_ns
from soter.language.syntax.lexer import RESERVED
from soter.monitor.log_files.log_columns import seconds_text
from soter.monitor.log_survey import STAMP, Channel, LogSurvey, rounded_up

if TYPE_CHECKING:
    from collections.abc import Iterator


ANGLE = re.compile(r"(?i)(?<![a-z])(yaw|heading|hdg|course|bearing|azimuth|roll|pitch|theta|psi)")
NOT_A_NAME = re.compile(r"[^A-Za-z0-9]+")
COMMAND_NAME = re.compile(
    r"(?:^|[^a-z])(?:cmd|command|sp|set|setpoint|duty|pwm|throttle|u)(?:[^a-z]|$)", re.IGNORECASE
)


def program_head(survey: LogSurvey, log: str, name: str) -> str:
    """Drafts the head of a program: for each channel a type, a topic and comments."""
    lines = [
        "soter 1;",
        "",
        f"// What {_comment_text(log)} holds, to begin a program with: keep what your",
    ]
    lines += [f"// modules read. Figures are of this log, and `{name}.toml` is its mapping:"]
    lines += [f"// `soter monitor {name}.soter LOG --map {name}.toml`, once a module is written."]
    lines += ["// A topic is an `input` until a plant, whose proof is about it, drives it."]
    if _csv_with_command(survey) is not None:
        lines += [
            "// A command that a node publishes is a topic of its own, here and in the mapping:"
        ]
        lines += [f"// `{name}.toml` ends with an example. `--estimates` finds it nowhere else."]
    lines += [f"// {_comment_text(note)}" for note in survey.notes]
    for channel, topic, of_type, fields in _named_channels(survey):
        found = survey.channels[channel]
        lines += [
            "",
            f"// {_comment_text(channel)}: {_rate_text(found)}",
            *_remarks_on_channel(found),
        ]
        lines.append(f"type {of_type} = {{")
        for path, called in fields.items():
            n = found.fields[path]
            turns = '; an angle? `float unit "rad"`, or "deg", counts modulo a turn'
            span = (
                f"{_figure_text(n.low)} to {_figure_text(n.high)}{turns * bool(ANGLE.search(path))}"
            )
            lines.append(f"  {called}: {found.type_of_field(path)},  // {span}")
        age = found.proposed_max_age_ns()
        lines += [
            "};",
            f"input topic {topic}: {of_type}{f' max_age {write_ns(age)}' if age else ''};",
        ]
    return "\n".join(lines) + "\n"


def mapping_of_log(survey: LogSurvey, log: str) -> str:
    """Drafts a mapping of the log, as TOML."""
    lines = [f"# What is what in {_comment_text(log)}: docs/mapping.md."]
    if survey.time is not None:
        name, unit = survey.time
        lines += ["", "[time]  # guessed by its name and size", f"from = {_toml_text(name)}"]
        lines.append(f'unit = "{unit}"')
    topics = [*_named_channels(survey)]
    for channel, topic, _, fields in topics:
        lines += ["", f"[topics.{topic}]", f"channel = {_toml_text(channel)}"]
        if survey.channels[channel].is_stamped:
            lines.append(f'stamp = "{STAMP}"')
        lines += ["", f"[topics.{topic}.fields]"]
        lines += [f"{called} = {_toml_text(path)}" for path, called in fields.items()]
    if (example := _csv_with_command(survey)) is not None:
        lines += _command_comments(*example, {*RESERVED, *(topic for _, topic, _, _ in topics)})
    return "\n".join(lines) + "\n"


def _named_channels(survey: LogSurvey) -> Iterator[tuple[str, str, str, dict[str, str]]]:
    """Gives each channel with numbers, its topic, its type, and its field names by path."""
    taken: set[str] = set(RESERVED)
    for channel in sorted(survey.channels):
        kept = survey.channels[channel].kept_fields
        if not kept:
            continue
        topic = _free_name(channel.removesuffix(".csv"), taken)
        words = NOT_A_NAME.sub("_", topic).split("_")
        of_type = _free_name("".join(w[:1].upper() + w[1:] for w in words) + "Data", taken)
        names = set(RESERVED)
        yield channel, topic, of_type, {p: _free_name(p, names) for p in kept}


def _free_name(text: str, taken: set[str]) -> str:
    """A free name in Soter that resembles `text`; adds the name to `taken`."""
    name = NOT_A_NAME.sub("_", text).strip("_")
    name = name if name[:1].isalpha() else f"n{name}"
    number, tried = 1, name
    while tried in taken:
        number, tried = number + 1, f"{name}_{number + 1}"
    taken.add(tried)
    return tried


def _csv_with_command(survey: LogSurvey) -> tuple[str, str] | None:
    """A CSV with several numbers, and a column that seems a command, else the last; or None."""
    channels = survey.channels if survey.time is not None else {}
    channel = next((c for c, found in channels.items() if found.kept_fields[1:]), None)
    if channel is None:
        return None
    kept = channels[channel].kept_fields
    return channel, next((k for k in kept if COMMAND_NAME.search(k)), kept[-1])


def _command_comments(channel: str, path: str, taken: set[str]) -> list[str]:
    """The comments of a mapping that say how a column becomes a command."""
    topic = _free_name(path, taken)
    return [
        "",
        "# A command that a node publishes is a topic of its own. Were it the one below: take its",
        "# field out, here and in the program, say there, with the limits of what it moves,",
        f"# `topic {topic}: float in [LOW, HIGH] = 0.0;`, and here",
        f"# [topics.{topic}]",
        f"# channel = {_toml_text(channel)}",
        f"# fields = {{ value = {_toml_text(path)} }}",
    ]


def _remarks_on_channel(found: Channel) -> list[str]:
    """Comments on what is left out of a channel, and on what `soter monitor` will not read."""
    lines = []
    no_number = found.left_out | {p for p, n in found.fields.items() if not n.count}
    if no_number:
        lines.append(
            f"// Left out, as no single number: {_comment_text(', '.join(sorted(no_number)))}"
        )
    missing = {p: len(found.times_ns) - found.fields[p].count for p in found.kept_fields}
    counts = ", ".join(f"{p} ({n:,} times)" for p, n in missing.items() if n)
    if counts:
        lines += [
            f"// A sample has every number. Empty or no finite number: {_comment_text(counts)}.",
            "// What comes at times of its own wants a topic of its own, here and in the mapping.",
        ]
    if found.back:
        to = f"first to {seconds_text(found.first_back_ns)} s (such messages: {found.back:,})"
        lines += [
            f"// Time goes back, {to}: `soter monitor` refuses that (D016).",
            "// `where`, `since` and `until` of the mapping choose rows among which it does not.",
        ]
    return lines


def _rate_text(found: Channel) -> str:
    """Says in words how often messages come on a channel, and how old samples become."""
    gaps, count = found.sorted_gaps_ns(), f"{len(found.times_ns):,} messages"
    if len(found.taken_samples) < len(found.times_ns):
        count = f"{len(found.taken_samples):,} samples in {count}"
    if not gaps or gaps[-1] <= 0:
        return f"{count} at one time" if gaps else count if found.back else "one message"
    hertz = len(gaps) * 1e9 / sum(gaps)
    half, most = round(median(gaps)), gaps[-1]
    ages = found.sorted_ages_ns()
    gap = f"gaps {write_ns(rounded_up(half))} (half) to {write_ns(rounded_up(most))}"
    since = "since its stamp" if found.is_stamped else "since it was logged"
    return f"{count}, {hertz:.3g} Hz, {gap}, at most {write_ns(rounded_up(ages[-1]))} old {since}"


def _figure_text(x: float) -> str:
    return f"{x:.6g}" if isinstance(x, float) else str(x).lower()


def _comment_text(text: str) -> str:
    return safe(text).replace("\n", " ")[:300]


def _toml_text(text: str) -> str:
    """Quotes a text for TOML, without characters that a terminal would act upon."""
    quoted = json.dumps(text, ensure_ascii=False)
    return "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in quoted)

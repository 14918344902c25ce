"""The sequence view: every step is in the table and in the log, nothing controls a terminal."""

from __future__ import annotations

import dataclasses
import importlib
import json
from typing import TYPE_CHECKING, Any

import pytest

from soter.report.sequence_view import (
    HEADERS,
    Lane,
    ModeSwitch,
    ModuleModes,
    Pick,
    Published,
    SequenceStep,
    SequenceView,
    clipped_to_width,
    duration_text,
    explanation,
    table_rows,
    table_text,
)
from soter.report.trace_log import STEPS_TOPIC, write_log
from soter.report.wording import visible

if TYPE_CHECKING:
    from pathlib import Path

sample = importlib.import_module("sequence_sample")
VOID = {"meta", "br", "wbr", "link", "img", "hr"}
HOSTILE = "\x1b[1m<script>alert(1)</script>\"'&amp;</style>\x1b[31m\u202e`code`"
LETTER_PX = 11
"""The highest letter of a label over its line, brackets included."""
SIZES = ((1, 2), (2, 12), (5, 60), (20, 200))


def hostile() -> SequenceView:
    """Return a view of which every text is an attack."""
    h = HOSTILE
    return SequenceView(
        h,
        h,
        h,
        h,
        h,
        (Lane(h, "ac", h), Lane(f"{h}.dm", "dm", h)),
        (
            SequenceStep(0, 0, "", "start", published=(Published(h, h),), note=h),
            SequenceStep(
                1,
                5,
                h,
                release_ns=0,
                choices=(Pick(h, h, default=False),),
                published=(Published(h, h),),
                note=h,
                violates=True,
            ),
            SequenceStep(2, 5, f"{h}.dm", switch=ModeSwitch(h, "AC", "SC"), fault=h),
            SequenceStep(3, 5, f"elsewhere {h}", "lost"),
        ),
        (h,),
        (ModuleModes(h, ((0, "AC"), (2, "SC"))),),
        (h,),
        h,
        0,
        h,
        {h: h},
    )


def test_the_explanation_is_one_sentence_about_the_first_violation() -> None:
    view = sample.small()
    assert explanation(view) == (
        "The property fails in step 13, at 300 ms, after the step of `cart.body`: SC lost its "
        "release at 200 ms and has not braked; x = 10.4, the wall is at 10."
    )
    clean = dataclasses.replace(
        view, steps=tuple(dataclasses.replace(s, violates=False) for s in view.steps)
    )
    assert explanation(clean) == ""


def test_the_table_has_a_line_a_step_and_the_reason() -> None:
    view = sample.small()
    lines = table_text(view)
    assert len(lines) == 2 + len(view.steps) + 2
    assert lines[-1] == explanation(view)
    assert "✕ violated" in lines[2 + 13]
    assert "12 ms late" in lines[2 + 7]
    assert "\x1b" not in "".join(lines)
    assert "\x1b" in "".join(table_text(view, color=True))


def test_the_time_stands_where_it_changes() -> None:
    times = [row[1].text for row in table_rows(sample.small())]
    assert times[:7] == ["0", "", "", "", "", "100 ms", ""]
    assert all(len(row) == len(HEADERS) for row in table_rows(sample.small()))


def test_a_terminal_gets_no_control_characters_and_no_endless_lines() -> None:
    view = dataclasses.replace(
        hostile(),
        steps=(SequenceStep(0, 0, HOSTILE, published=(Published(HOSTILE, "x" * 500),)),),
    )
    joined = "\n".join(table_text(view))
    assert "\x1b" not in joined
    assert "\u202e" not in joined
    assert max(map(len, joined.splitlines())) < 220


@pytest.mark.parametrize(
    ("time_ns", "said"),
    [
        (0, "0"),
        (1, "1 ns"),
        (1_500, "1.5 µs"),
        (12_500_000, "12.5 ms"),
        (1_000_000_001, "1.000000001 s"),
        (-5_000_000, "-5 ms"),
        (60 * 10**9, "60 s"),
    ],
)
def test_times_are_written_exactly(time_ns: int, said: str) -> None:
    assert duration_text(time_ns) == said


def test_words_are_clipped_and_made_visible() -> None:
    assert clipped_to_width("abcdef", 6) == "abcdef"
    assert clipped_to_width("abcdefg", 6) == "abcde…"
    assert clipped_to_width("漢字漢字", 5) == "漢字…"
    assert visible("a\x1b\n\ud800é") == "a\\x1b\\n\\ud800é"


# ---------------------------------------------------------------- log


def _read(path: Path) -> tuple[list[tuple[str, int, Any]], dict[str, str]]:
    reader_of = pytest.importorskip("mcap.reader", reason="the extra `logs` is not installed")
    with path.open("rb") as stream:
        reader = reader_of.make_reader(stream)
        messages = [
            (channel.topic, message.log_time, json.loads(message.data))
            for _, channel, message in reader.iter_messages(log_time_order=False)
        ]
        (metadata,) = reader.iter_metadata()
    return messages, metadata.metadata


def test_the_log_holds_every_step_value_and_mode(tmp_path: Path) -> None:
    view = sample.small()
    messages, metadata = _read(write_log(view, tmp_path / "a.mcap"))
    steps = [m for topic, _, m in messages if topic == STEPS_TOPIC]
    assert [m["step"] for m in steps] == [step.number for step in view.steps]
    assert [m["violates"] for m in steps] == [step.violates for step in view.steps]
    pushes = [(t, m["value"]) for topic, t, m in messages if topic == "push"]
    # What was not enabled is not there.
    assert pushes == [(0, 0.0), (0, 3.0), (325_000_000, -3.0)]
    assert [m["value"] for topic, _, m in messages if topic == "lamp"] == ["On"]
    modes = [(t, m["mode"]) for topic, t, m in messages if topic == "soter/modes"]
    assert modes == [(0, "SC"), (0, "AC"), (112_000_000, "SC")]
    decisions = [
        (m["mode_before"], m["mode_after"]) for topic, _, m in messages if topic.endswith("sions")
    ]
    assert decisions == [("SC", "AC"), ("AC", "SC"), ("SC", "SC")]
    assert metadata["test"] == "LateSC"
    assert metadata["program_sha256"] == view.program_sha256


def test_the_same_view_gives_the_same_log(tmp_path: Path) -> None:
    pytest.importorskip("mcap.writer", reason="the extra `logs` is not installed")
    one, two = (write_log(hostile(), tmp_path / name) for name in ("a.mcap", "b.mcap"))
    assert one.read_bytes() == two.read_bytes()
    write_log(sample.large(), tmp_path / "c.mcap")


def test_of_very_many_steps_the_first_and_the_last_are_told() -> None:
    view = sample.large(5, 60)
    whole, cut = table_text(view), table_text(view, most=20)
    assert len(whole) - len(cut) == len(view.steps) - 20 - 1
    assert any(f"... {len(view.steps) - 20} steps left out" in line for line in cut)
    told = [int(line.split()[0]) for line in cut if line.split() and line.split()[0].isdigit()]
    numbers = [s.number for s in view.steps]
    assert told == numbers[:5] + numbers[-15:]
    assert table_text(view, most=len(view.steps)) == whole

"""The sequence view: every step is on the page, in the table and in the log; nothing is markup."""

from __future__ import annotations

import dataclasses
import importlib
import json
import re
import shutil
from html.parser import HTMLParser
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytest

import processes
from soter.diagnostics.diagnostic import SoterError
from soter.report.html import POLICY
from soter.report.sequence_drawing import plan
from soter.report.sequence_view import (
    HEADERS,
    Lane,
    ModeSwitch,
    ModuleModes,
    Pick,
    Published,
    SequenceStep,
    SequenceView,
    TopicFlow,
    clipped,
    duration_text,
    explanation,
    late_ns,
    reached,
    rows,
    table_text,
)
from soter.report.trace_report import STEPS_TOPIC, page, write_log, write_page
from soter.report.wording import visible

if TYPE_CHECKING:
    from pathlib import Path

sample = importlib.import_module("sequence_sample")
VOID = {"meta", "br", "wbr", "link", "img", "hr"}
HOSTILE = "\x1b[1m<script>alert(1)</script>\"'&amp;</style>\x1b[31m\u202e`code`"
LETTER_PX = 11
"""The highest letter of a label over its line, brackets included."""
SIZES = ((1, 2), (2, 12), (5, 60), (20, 200))


class Outline(HTMLParser):
    """Elements with their attributes; fails where they are not closed in order."""

    def __init__(self, document: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.feed(document)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def of_class(self, name: str) -> list[dict[str, str | None]]:
        """Return the attributes of every element of a class."""
        return [attrs for _, attrs in self.tags if name in (attrs.get("class") or "").split()]


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
        (TopicFlow(h, (h,), (f"{h}.dm",)),),
        (ModuleModes(h, ((0, "AC"), (2, "SC"))),),
        (h,),
        h,
        0,
        h,
        {h: h},
    )


VIEWS = {
    "small": sample.small,
    "hostile": hostile,
    "empty": lambda: SequenceView("", "", "", "", "nothing", (), ()),
    "modes without steps": lambda: SequenceView(
        "", "", "", "", "", (Lane("a", "ac", "M"),), (), modes=(ModuleModes("M", ()),)
    ),
}


@pytest.mark.parametrize("name", VIEWS)
def test_the_page_is_well_formed_and_needs_no_network(name: str) -> None:
    document = page(VIEWS[name]())
    outline = Outline(document)
    assert POLICY in [attrs.get("content") for _, attrs in outline.tags]
    for _, attrs in outline.tags:
        assert "src" not in attrs
        assert (attrs.get("href") or "#").startswith("#")
        assert not any(key.startswith("on") for key in attrs)


def test_no_text_becomes_markup() -> None:
    tame = page(sample.small())
    document = page(hostile())
    assert "alert(1)</script>" not in document
    assert document.count("<script") == tame.count("<script") == 1
    assert document.count("</style") == 1
    assert "\x1b" not in document
    assert "\u202e" not in document
    assert "&lt;script&gt;alert(1)" in document


@pytest.mark.parametrize("size", SIZES)
def test_every_step_is_drawn_once_and_told_once(size: tuple[int, int]) -> None:
    view = sample.large(*size)
    outline = Outline(page(view))
    numbers = [str(step.number) for step in view.steps]
    assert [a["data-step"] for a in outline.of_class("row")] == numbers
    assert [a["data-step"] for t, a in outline.tags if t == "g" and "data-step" in a] == numbers
    ids = [a["id"] for _, a in outline.tags if "id" in a]
    assert len(ids) == len(set(ids))
    # Links lead somewhere, without a script as well.
    assert {a["href"] for t, a in outline.tags if t == "a"} <= {f"#{name}" for name in ids}
    assert len(outline.of_class("lane")) == len(view.lanes)


@pytest.mark.parametrize("size", SIZES)
def test_rows_follow_each_other_and_lanes_keep_apart(size: tuple[int, int]) -> None:
    laid = plan(sample.large(*size))
    for before, after in pairwise(laid.rows):
        assert before.end <= after.top
        gap = before.step.time_ns != after.step.time_ns
        assert (after.top > before.end) is gap
    places = list(laid.centres.values())
    assert all(b - a == laid.lane_px for a, b in pairwise(places))
    assert laid.lane_px >= 116


@pytest.mark.parametrize(("number", "topic"), [(1, "motion"), (4, "push"), (14, "push")])
def test_an_arrow_ends_at_every_reader_and_nowhere_else(number: int, topic: str) -> None:
    view = sample.small()
    laid = plan(view)
    row = re.search(rf'<a class="row" id="row-{number}".*?</a>', page(view), re.DOTALL)
    assert row is not None
    (heads,) = re.findall(r'<path class="head \w+" d="([^"]*)"', row[0])
    tips = {float(x) for x in re.findall(r"M([\d.]+)", heads)}
    (readers,) = [flow.readers for flow in view.topics if flow.name == topic]
    assert tips == {laid.centres[name] for name in readers}


def test_a_box_stands_on_no_label_of_its_step() -> None:
    lanes = (Lane("net", "node"), Lane("b", "node"))
    values = tuple(Published(name, "1") for name in ("a", "b", "c"))
    chosen = SequenceStep(0, 0, "net", choices=(Pick("choose", "1"),), published=values)
    plain = SequenceStep(1, 0, "net", published=values)
    document = page(SequenceView("f", "S", "T", "p", "v", lanes, (chosen, plain)))
    drawn = re.findall(r'id="row-[01]".*?</a>', document, re.DOTALL)
    baselines = [
        [float(y) for y in re.findall(r'class="value[^"]*"[^>]* y="([\d.]+)"', row)]
        for row in drawn
    ]
    (box,) = re.findall(r'class="box [^>]* y="([\d.]+)" width="[\d.]+" height="(\d+)"', drawn[0])
    assert baselines[0][1] - float(box[0]) - float(box[1]) >= LETTER_PX
    assert baselines[0][2] - baselines[0][1] == baselines[1][1] - baselines[1][0]
    assert "box" not in drawn[1]


@pytest.mark.parametrize("number", [3, 8])
def test_what_was_not_enabled_reaches_nobody(number: int) -> None:
    view = sample.small()
    row = re.search(rf'id="row-{number}".*?</a>', page(view), re.DOTALL)
    assert row is not None
    assert "head" not in row[0]
    assert "stopped" in row[0]
    assert "gated" in row[0]
    assert reached(view.steps[number]) == ()


def test_lost_late_and_violating_steps_are_marked() -> None:
    view = sample.small()
    document = page(view)
    outline = Outline(document)
    assert len([a for t, a in outline.tags if t == "circle" and a.get("class") == "lost"]) == 1
    bars = [a for t, a in outline.tags if t == "path" and a.get("class") == "late"]
    assert len(bars) == sum(late_ns(step) > 0 for step in view.steps) == 2
    assert len(outline.of_class("ring")) == 1
    assert [a["id"] for a in outline.of_class("row") if "violates" in (a["class"] or "")] == [
        "row-13"
    ]
    assert len(outline.of_class("running")) == 1
    assert len(outline.of_class("checked")) == sum(step.observable for step in view.steps)


def test_bands_change_where_the_dm_switched() -> None:
    view = sample.small()
    laid = plan(view)
    lines = {row.step.number: row.line for row in laid.rows}
    held = [
        (a["class"], float(a["y"] or 0), float(a["height"] or 0))
        for a in Outline(page(view)).of_class("held")
    ]
    assert held == [
        ("mode sc held", 0.0, lines[2]),
        ("mode ac held", lines[2], lines[7] - lines[2]),
        ("mode sc held", lines[7], laid.height - lines[7]),
    ]


def test_the_legend_explains_only_what_occurs() -> None:
    full = page(sample.small())
    bare = page(dataclasses.replace(sample.small(), steps=sample.small().steps[:3], modes=()))
    for sign in ("a release that is lost", "the violation", "AC in control", "late step"):
        assert f"{sign}</span>" in full
        assert f"{sign}</span>" not in bare


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
    assert Outline(page(clean)).of_class("why-fails") == []
    assert Outline(page(clean)).of_class("ring") == []


def test_the_same_view_gives_the_same_page(tmp_path: Path) -> None:
    path = write_page(sample.small(), tmp_path / "deep" / "a.html")
    assert path.read_text(encoding="utf-8") == page(sample.small())
    with pytest.raises(SoterError, match="cannot write"):
        write_page(sample.small(), tmp_path)


def test_the_script_is_valid_javascript(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    match = re.search(r"<script>(.*?)</script>", page(sample.small()), re.DOTALL)
    assert match is not None
    (tmp_path / "a.js").write_text(match[1], encoding="utf-8")
    processes.run([node, "--check", str(tmp_path / "a.js")], check=True)


# ---------------------------------------------------------------- text


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
    times = [row[1].text for row in rows(sample.small())]
    assert times[:7] == ["0", "", "", "", "", "100 ms", ""]
    assert all(len(row) == len(HEADERS) for row in rows(sample.small()))


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
    assert clipped("abcdef", 6) == "abcdef"
    assert clipped("abcdefg", 6) == "abcde…"
    assert clipped("漢字漢字", 5) == "漢字…"
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

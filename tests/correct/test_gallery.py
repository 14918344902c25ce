"""examples/gallery: right versions are clean and wrong ones violated, and neither by accident."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from bench.testing import mutants as bench
from bench.testing.mutant_models import Mutant, Subject

import soter
from generators.explorer_agreement import compared, enumerated
from generators.file_listing import files_in
from soter.diagnostics.render import render_all
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.language.front_end import check_file

if TYPE_CHECKING:
    from soter.explore.results import TestResult

GALLERY = Path(__file__).resolve().parents[2] / "examples" / "gallery"
CLEAN = {
    "failure_detector": ("NeverInVain",),
    "token_ring": ("OneToken", "LostSteps", "GoesRound"),
    "two_phase_commit": ("AllOrNothing", "LateWires", "Decided"),
    "two_robots": ("Apart", "Skewed", "Alone", "Together", "OldBatteries"),
}
PAGE = (GALLERY.parents[1] / "docs" / "gallery.md").read_text(encoding="utf-8")
ROW = re.compile(
    r"^\| (\w+) \| (\w+) \| (\w+) \| (\d+) ms \| ([\d,]*) ?\| (\d*) ?\|$", re.MULTILINE
)
"""Of the page's table: file, test, verdict, horizon, configurations, steps of the trace."""


@dataclass(frozen=True)
class Wrong:
    """A test that is violated: what, after how many steps, at what time in ms.

    `seen`: lines that the trace is known by, as (time in ms, actor, what it does).
    """

    file: str
    test: str
    violated: str
    steps: int
    at_ms: int
    seen: tuple[tuple[int, str, str], ...]


WRONG = (
    Wrong(
        "failure_detector",
        "Hasty",
        "never suspected && alive",
        14,
        55,
        ((20, "Heart", "lost"), (55, "Detector", "step")),
    ),
    Wrong(
        "token_ring",
        "TwoTokens",
        "never at[1].works && at[2].works",
        21,
        30,
        ((15, "at[0].Wire", "Lost"), (30, "at[2].Station", "step")),
    ),
    Wrong(
        "two_phase_commit",
        "HalfATransfer",
        "never site[0].stands == State.Committed && site[1].stands == State.Aborted",
        18,
        60,
        ((50, "site[1].Wire", "Lost"), (60, "site[1].Participant", "step")),
    ),
    Wrong(
        "two_robots",
        "TooClose",
        "always r[0].body.truth.at < r[1].body.truth.at",
        44,
        40,
        ((40, "r[0].Avoid.dm", "step"), (40, "r[1].Avoid.dm", "step")),
    ),
)


@dataclass(frozen=True)
class Change:
    """One line of a right version, and what it was for. `within`: the node that it stands in."""

    file: str
    test: str
    kind: str
    old: str
    new: str
    violated: str
    within: str = ""

    def __str__(self) -> str:
        return f"{self.test}: {self.kind}"

    def mutant(self) -> Mutant:
        """The same in the words of the bench, the node as a whole where it stands in one."""
        old, new = self.old, self.new
        if self.within:
            text = (GALLERY / f"{self.file}.soter").read_text(encoding="utf-8")
            (whole,) = re.findall(rf"^node {self.within} .*?^}}\n", text, re.MULTILINE | re.DOTALL)
            assert whole.count(old) == 1
            old, new = whole, whole.replace(old, new)
        return Mutant(Subject(f"gallery/{self.file}.soter", self.test), self.kind, old, new)


ACCURATE = "never suspected && alive"
COMPLETE = "!alive leadsto suspected within DETECTED"
HALF = "never site[0].stands == State.Committed && site[1].stands == State.Aborted"
OTHER_HALF = "never site[1].stands == State.Committed && site[0].stands == State.Aborted"
MEET = "always r[0].body.truth.at < r[1].body.truth.at"
TOLD = (
    "topic told: Cell max_age 20ms;  // by radio: where I am\ninput topic other: Cell max_age 20ms;"
)
TAKEN = "      if n != got {\n        got = n;\n        has = true;\n      }\n"
CHANGES = (
    Change("failure_detector", "NeverInVain", "a tick too short", "= 60ms", "= 55ms", ACCURATE),
    Change("failure_detector", "NeverInVain", "too long", "= 60ms", "= 70ms", COMPLETE),
    Change("failure_detector", "NeverInVain", "promised too soon", "= 75ms", "= 70ms", COMPLETE),
    Change(
        "failure_detector",
        "NeverInVain",
        "nobody was heard yet",
        " && time > seconds(TIMEOUT)",
        "",
        ACCURATE,
    ),
    Change("token_ring", "OneToken", "taken twice", TAKEN, "      has = true;\n", "", "Station"),
    Change(
        "token_ring",
        "LostSteps",
        "passed on and kept",
        "      has = false;\n",
        "",
        "",
        "Station",
    ),
    Change(
        "token_ring",
        "GoesRound",
        "sent once, acknowledgement ignored",
        "      publish passed = sent;\n",
        "      publish passed = sent;\n      sends = false;\n",
        "",
        "Station",
    ),
    Change("token_ring", "GoesRound", "promised too soon", "within 80ms", "within 70ms", ""),
    Change("token_ring", "GoesRound", "sent too rarely", "RESEND: int = 2", "RESEND: int = 3", ""),
    Change("two_phase_commit", "AllOrNothing", "one vote will do", "Yes && two", "Yes || two", ""),
    Change(
        "two_phase_commit",
        "AllOrNothing",
        "silence is consent",
        "if one == Vote.Yes && two == Vote.Yes {",
        "if one != Vote.No && two != Vote.No && waited == PATIENCE {",
        "",
    ),
    Change(
        "two_phase_commit",
        "AllOrNothing",
        "gives up in doubt",
        "    if is == State.Working {",
        "    if is != State.Committed {",
        "",
        "Participant",
    ),
    Change(
        "two_phase_commit",
        "Decided",
        "a commit is not heard",
        "w == Word.Commit && is == State.Prepared",
        "w == Word.Commit && is == State.Committed",
        "word == Word.Commit leadsto site[0].stands == State.Committed && "
        "site[1].stands == State.Committed within 40ms",
        "Participant",
    ),
    Change("two_robots", "Apart", "no message is ever lost", "GAP: int = 5", "GAP: int = 4", MEET),
    Change("two_robots", "Skewed", "own way only", "GAP: int = 5", "GAP: int = 2", MEET),
    Change(
        "two_robots",
        "Alone",
        "looks one tick ahead",
        "LOOK: int = 2",
        "LOOK: int = 1",
        "always Away(body.truth.at, HOME) <= FAR",
    ),
)


def _of(name: str, test: str, folder: Path | None = None) -> TestResult:
    return soter.load(GALLERY / f"{name}.soter").explore(test, output=folder)[test]


@pytest.mark.parametrize("name", CLEAN)
def test_a_program_of_the_gallery_gets_no_diagnostics(name: str) -> None:
    checked = check_file(str(GALLERY / f"{name}.soter"))
    assert render_all(checked.diagnostics.items) == ""
    (wrong,) = [w.test for w in WRONG if w.file == name]
    assert set(checked.tests) == {*CLEAN[name], wrong}


def test_every_program_of_the_gallery_is_in_the_list() -> None:
    assert {p.stem for p in files_in(GALLERY, "*.soter")} == set(CLEAN)


@pytest.mark.parametrize("name", CLEAN)
def test_right_versions_are_exhausted_and_the_page_has_the_figures(
    name: str, tmp_path: Path
) -> None:
    results = soter.load(GALLERY / f"{name}.soter").explore(output=tmp_path).tests
    rows = [row[1:] for row in ROW.findall(PAGE) if row[0] == name]
    assert [row[0] for row in rows] == [t.name for t in results]
    for (_, verdict, horizon_ms, states, steps), t in zip(rows, results, strict=True):
        assert t.verdict == verdict == ("exhausted" if t.name in CLEAN[name] else "violated")
        assert any(f"the horizon, {horizon_ms} ms" in a for a in t.assumptions)
        assert states == (f"{t.states:,}" if t.name in CLEAN[name] else "")
        assert steps == ("" if t.replayed is None else str(len(t.replayed.trace.steps) - 1))


@pytest.mark.whole
@pytest.mark.parametrize("w", WRONG, ids=lambda w: w.test)
def test_a_wrong_version_is_violated_by_the_least_trace(w: Wrong, tmp_path: Path) -> None:
    test_result = _of(w.file, w.test, tmp_path)
    assert test_result.verdict == "violated"
    assert test_result.broken is not None
    assert test_result.broken.text == w.violated
    assert test_result.minimal
    assert test_result.trace is not None
    assert soter.replay(test_result.trace).reproduced
    assert test_result.replayed is not None
    steps = [s for s in test_result.replayed.trace.steps if s.actor]
    assert (len(steps), steps[-1].time_ns // 1_000_000) == (w.steps, w.at_ms)
    told = {
        (s.time_ns // 1_000_000, s.actor, what)
        for s in steps
        for what in (s.kind, *(str(c.value) for c in s.choices))
    }
    assert set(w.seen) <= told
    assert _shortest(test_result) == w.steps


@pytest.mark.parametrize("change", CHANGES, ids=str)
def test_a_right_version_with_one_line_changed_is_violated(change: Change, tmp_path: Path) -> None:
    m = change.mutant()
    test_result = bench.explored(m.subject, bench.changed(m, tmp_path), tmp_path)
    assert test_result.verdict == "violated"
    assert test_result.broken is not None
    assert change.violated in ("", test_result.broken.text)
    assert test_result.trace is not None
    assert soter.replay(test_result.trace).reproduced


@pytest.mark.parametrize(
    ("test", "old", "new"),
    [
        ("Together", "GAP: int = 5", "GAP: int = 2"),
        ("OldBatteries", "charge <= Away(cell, HOME) + RESERVE", "RESERVE < 0"),
        ("Alone", "RESERVE: int = 3", "RESERVE: int = 2"),
        ("Apart", TOLD, TOLD.replace("20ms", "30ms")),
    ],
)
def test_two_robots_with_one_line_changed_are_violated(
    test: str, old: str, new: str, tmp_path: Path
) -> None:
    """Traces of these are long: nobody looks for the shortest."""
    m = Mutant(Subject("gallery/two_robots.soter", test), "", old, new)
    test_result = soter.load(bench.changed(m, tmp_path)).explore(test, minimise=0)[test]
    assert test_result.verdict == "violated"


def _shortest(test_result: TestResult) -> int:
    """Breadth first without any reduction, every step run."""
    engine = Engine(test_result.system)
    try:
        return bench.moves(
            engine.explore(EngineSettings(strategy="bfs", reduction="none", plainly=True))
        )
    finally:
        engine.close()


LIVE = (("within 80ms", "within 10ms"), ("within 40ms", "within 10ms"), ("eventually", "//"))
SMALL = (
    ("failure_detector", "NeverInVain", "40ms", (("= 60ms", "= 30ms"), ("= 75ms", "= 20ms"))),
    ("failure_detector", "Hasty", "40ms", (("= 50ms", "= 20ms"), ("= 75ms", "= 30ms"))),
    ("token_ring", "GoesRound", "20ms", LIVE),
    ("token_ring", "TwoTokens", "20ms", ()),
    ("two_phase_commit", "AllOrNothing", "20ms", ()),
    ("two_phase_commit", "Decided", "30ms", LIVE),
    ("two_phase_commit", "HalfATransfer", "20ms", ()),
    ("two_robots", "Apart", "10ms", ()),
)


@pytest.mark.parametrize(
    ("name", "test", "horizon", "times"),
    [*SMALL[2:4], *(pytest.param(*s, marks=pytest.mark.long) for s in SMALL if "ring" not in s[0])],
)
def test_the_enumerator_agrees_on_the_beginning(
    name: str, test: str, horizon: str, times: tuple[tuple[str, str], ...]
) -> None:
    text = (GALLERY / f"{name}.soter").read_text(encoding="utf-8")
    (block,) = re.findall(rf"^test {test} {{.*?^}}", text, re.MULTILINE | re.DOTALL)
    rest = text.replace(block, "")
    block = re.sub(r"horizon \d+ms", f"horizon {horizon}", block.replace(f"test {test}", "test T"))
    for old, new in times:
        rest, block = rest.replace(old, new), block.replace(old, new)
    without = re.sub(r"^test (?!T\b).*?^}", "", rest, flags=re.MULTILINE | re.DOTALL)
    small = enumerated(0, without + block, 300_000)
    assert len(small.found.configurations) > 20
    assert compared(small).complaints == []

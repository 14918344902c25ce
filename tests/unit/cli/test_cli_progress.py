"""The progress line: on terminals, after two seconds, and gone at the end."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

import pytest

from soter.api import load
from soter.cli.terminal.console import Console, colorful
from soter.cli.terminal.progress import CLEAR, LineOfProgress, ProgressBar
from soter.cli.test import progress_text
from soter.diagnostics.current_phase import listening_to_phases, phase
from soter.explore.search_options import SearchProgress

if TYPE_CHECKING:
    from pathlib import Path


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr("soter.cli.terminal.progress.time.perf_counter", lambda: now[0])
    return now


def console(err: io.StringIO) -> Console:
    made = Console(json=False)
    with made:
        made.err = err
    return made


def test_nothing_where_nobody_looks() -> None:
    with ProgressBar(console(io.StringIO())) as show:
        assert show is None


def test_a_line_after_two_seconds(clock: list[float]) -> None:
    terminal = Terminal()
    with ProgressBar(console(terminal)) as show:
        assert show is not None
        clock[0] = 1.9
        show(0.3)
        assert terminal.getvalue() == ""
        clock[0] = 2.5
        show(0.5)
        shown = terminal.getvalue()
        assert " 50%" in shown
        assert "2 s left" in shown
        clock[0] = 2.55
        show(0.51)
        assert terminal.getvalue() == shown, "ten times a second is enough"
    assert terminal.getvalue() == shown + CLEAR


def test_the_bar_names_its_phase_and_never_runs_backwards(clock: list[float]) -> None:
    terminal = Terminal()
    with ProgressBar(console(terminal)) as show:
        assert show is not None
        clock[0] = 10.0
        phase("Cart: P2b")
        show(0.5)
        assert terminal.getvalue().endswith("Cart: P2b")
        shares = []
        for n, share in enumerate((0.2, 0.6, 0.1)):
            clock[0] = 11.0 + n
            show(share)
            shares.append(re.findall(r"([0-9]+)%", terminal.getvalue())[-1])
        assert shares == ["50", "60", "60"]
        clock[0] = 20.0
        phase("running S", anew=True)
        assert terminal.getvalue().endswith("   0%  running S")
    before = terminal.getvalue()
    phase("nobody looks")
    assert terminal.getvalue() == before


def test_a_long_line_is_cut_as_only_one_line_can_be_taken_back(
    clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    terminal = Terminal()
    with LineOfProgress(console(terminal)) as show, ProgressBar(console(terminal)) as bar:
        assert show is not None
        assert bar is not None
        clock[0] = 3.0
        show("x" * 200)
        phase("y" * 200)
        lines = terminal.getvalue().split(CLEAR)[1:]
    assert [len(line) for line in lines] == [59, 59]


def test_a_run_tells_what_it_does(here: Path) -> None:
    assert here.exists()
    messages: list[str] = []
    with listening_to_phases(lambda name, _: messages.append(name)):
        load("cart.soter").simulate(until=1.0)
    assert messages[-1] == "running Protected"


def test_colour_follows_the_conventions(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert colorful(Terminal())
    assert not colorful(io.StringIO())
    assert not colorful(None)
    monkeypatch.setenv("TERM", "dumb")
    assert not colorful(Terminal())
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert colorful(io.StringIO())
    monkeypatch.setenv("NO_COLOR", "1")
    assert not colorful(Terminal())


def test_a_text_says_how_far_a_search_is(clock: list[float]) -> None:
    looked = SearchProgress("Late", 1_204_000, 3_000_000, 55, 9_632_000, 2.5)
    terminal = Terminal()
    with LineOfProgress(console(terminal)) as show:
        assert show is not None
        show(progress_text(looked))
        assert terminal.getvalue() == ""
        clock[0] = 2.5
        show(progress_text(looked))
        text = "Late  1,204,000 states, 482 k/s, depth 55, 9.19 MB"
        assert terminal.getvalue() == CLEAR + text
    sampled = SearchProgress("Late", 0, 1000, 55, 0, 1.0, minimising=True)
    assert progress_text(sampled).startswith(
        "Late  violated: looking for the shortest trace  1,000 steps"
    )
    tracing = SearchProgress("Late", 7, 1000, 55, 0, 1.0, tracing=True)
    assert progress_text(tracing).startswith("Late  violated: looking for a trace  7 states")
    near = SearchProgress("Late", 7, 1000, 55, 0, 1.0, nearest=0.01234)
    assert progress_text(near).endswith("depth 55, 0 bytes, least robustness 0.0123")

"""The progress line: on terminals, after two seconds, and gone at the end."""

from __future__ import annotations

import io
import json
import re
import threading
from itertools import groupby
from typing import TYPE_CHECKING, Any

import pytest

from soter.api import load
from soter.cli.main import main
from soter.cli.terminal.console import CLEAR, Console, LineOfProgress, ProgressBar, shows_colors
from soter.cli.test import progress_text
from soter.diagnostics.current_phase import listening_to_phases, passing_phase, phase
from soter.explore.search_options import SearchProgress

if TYPE_CHECKING:
    from pathlib import Path


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr("soter.cli.terminal.console.time.perf_counter", lambda: now[0])
    return now


def console(err: io.StringIO) -> Console:
    made = Console(json=False)
    with made:
        made.err = err
    return made


class Ticks:
    """In place of the event that a log's thread waits for: so many times its time has passed."""

    def __init__(self, clock: list[float], count: int) -> None:
        self.clock, self.left = clock, count
        self.done = threading.Event()

    def wait(self, seconds: float) -> bool:
        if self.left == 0:
            self.done.set()
            return True
        self.left -= 1
        self.clock[0] += seconds
        return False

    def set(self) -> None:
        self.left = 0


@pytest.mark.parametrize(("share", "told"), [(0.25, "  25%  2 s left"), (0.0, "")])
def test_a_line_of_a_log_says_the_time_once(
    clock: list[float], monkeypatch: pytest.MonkeyPatch, share: float, told: str
) -> None:
    ticks = Ticks(clock, 1)
    ready = threading.Event()
    monkeypatch.setattr("soter.cli.terminal.console.Event", lambda: ticks)
    monkeypatch.setattr(ticks, "wait", lambda s, wait=ticks.wait: ready.wait() and wait(s))
    log = io.StringIO()
    with ProgressBar(console(log)) as show:
        assert show is not None
        clock[0] = 4.0
        show(share)
        ready.set()
        assert ticks.done.wait()
    assert log.getvalue() == f"soter: 14 s{told}\n"


@pytest.mark.parametrize("line", [LineOfProgress, ProgressBar])
def test_nothing_where_there_is_no_standard_error_and_in_the_first_seconds_of_a_log(
    line: type[LineOfProgress],
) -> None:
    made = console(io.StringIO())
    made.err = None
    with line(made) as show:
        assert show is None
    log = io.StringIO()
    with line(console(log)) as show:
        assert show is not None
        show("x" if line is LineOfProgress else 0.5)  # type: ignore[arg-type]
    assert log.getvalue() == ""


def test_a_log_has_a_line_every_ten_seconds_whether_or_not_anything_is_told(
    clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    ticks = Ticks(clock, 3)
    told = threading.Event()
    monkeypatch.setattr("soter.cli.terminal.console.Event", lambda: ticks)
    monkeypatch.setattr(ticks, "wait", lambda s, wait=ticks.wait: told.wait() and wait(s))
    log = io.StringIO()
    with ProgressBar(console(log)) as show:
        assert show is not None
        phase("Cart: P2b")
        clock[0] = 4.0
        show(0.25)
        told.set()
        assert ticks.done.wait()
    assert log.getvalue().splitlines() == [
        "soter: 14 s  25%  2 s left  Cart: P2b, 14 s",
        "soter: 24 s  25%  Cart: P2b, 24 s",
        "soter: 34 s  25%  Cart: P2b, 34 s",
    ]


def test_a_command_in_a_log_says_how_far_it_is_on_standard_error_alone(
    here: Path, clock: list[float], monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    assert here.exists()
    monkeypatch.setattr("soter.cli.terminal.console.Event", lambda: Ticks(clock, 1))
    assert main(["run", "cart.soter", "--until", "1s", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["ok"] is True
    assert re.fullmatch(r"(soter: [0-9]+ s.*\n)+", err)


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
        assert terminal.getvalue().endswith("Cart: P2b, 0 s")
        shares = []
        for n, share in enumerate((0.2, 0.6, 0.1)):
            clock[0] = 11.0 + n
            show(share)
            shares.append(re.findall(r"([0-9]+)%", terminal.getvalue())[-1])
        assert shares == ["50", "60", "60"]
        clock[0] = 20.0
        phase("running S", anew=True)
        assert terminal.getvalue().endswith(f"{CLEAR}running S, 0 s")
    before = terminal.getvalue()
    phase("nobody looks")
    assert terminal.getvalue() == before


def shown(terminal: Terminal) -> str:
    """The line that is on the terminal now."""
    return terminal.getvalue().rpartition(CLEAR)[2]


def test_what_is_left_is_never_more_than_was_said(clock: list[float]) -> None:
    terminal = Terminal()
    said = []
    with ProgressBar(console(terminal)) as show:
        assert show is not None
        for now, share in ((10, 0.5), (12, 0.5), (30, 0.6), (31, 0.9), (32, 0.9), (60, 0.91)):
            clock[0] = now
            show(share)
            said += re.findall(r"([0-9]+) s left", shown(terminal))
    assert said == ["10", "8", "3", "2"]


def test_what_is_left_is_said_in_the_units_of_what_is_announced(clock: list[float]) -> None:
    terminal = Terminal()
    with ProgressBar(console(terminal)) as show:
        assert show is not None
        clock[0] = 67.0
        show(0.1)
        assert "  10 min left" in shown(terminal)
        clock[0] = 600.0
        show(0.9)
        assert "  67 s left" in shown(terminal)


def test_a_proof_whose_stages_are_no_shares_of_its_time_reckons_nothing_from_them(
    here: Path, clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is announced ("about 24 min") is then the only estimate."""
    lines = []
    tell = ProgressBar._show_share

    def told(bar: ProgressBar, share: float) -> None:
        clock[0] += 1.0
        tell(bar, share)
        lines.append(bar._line_text())

    assert here.exists()
    monkeypatch.setattr(ProgressBar, "_show_share", told)
    assert main(["verify", "cart.soter"]) == 0
    assert any("%" in line for line in lines)
    assert not any("left" in line for line in lines)


def test_once_all_that_is_counted_is_done_nothing_stands_at_a_hundred(clock: list[float]) -> None:
    """As in a build, which compiles what it has made: what is done now, and since when."""
    terminal = Terminal()
    lines = []
    with ProgressBar(console(terminal)) as show:
        assert show is not None
        clock[0] = 10.0
        phase("Cart: computing ttf and safer", anew=True)
        show(0.5)
        clock[0] = 20.0
        show(1.0)
        with passing_phase("compiling"):
            for now in (21.0, 34.0):
                clock[0] = now
                show(1.0)
                lines.append(shown(terminal))
        clock[0] = 35.0
        show(1.0)
        lines.append(shown(terminal))
    assert lines == ["compiling, 1 s", "compiling, 14 s", "Cart: computing ttf and safer, 1 s"]


def test_a_build_says_what_it_does_and_not_only_that_it_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between two compilations sets are computed: they are named, each when it is computed."""
    monkeypatch.setattr("soter.verify.deploy.missing_predicates._cached_sets", lambda *_: None)
    (tmp_path / "law.soter").write_text(LAW, encoding="utf-8")
    phases: list[str] = []
    shares: list[float] = []
    with listening_to_phases(lambda name, _: phases.append(name)):
        load(tmp_path / "law.soter").build("c", tmp_path / "out", progress=shares.append)
    assert [name for name, _ in groupby(p for p in phases if p != "compiling")] == [
        "Guard: computing ttf and safer",
        "Guard: what its fail-safe law keeps",
        "Guard: computing ttf and safer",
        "Guard: what SC keeps",
        "Guard: where AC may have control",
    ]
    assert shares == [0.0]


LAW = """soter 1;
topic pos: float in [-50.0, 50.0] max_age 20ms;
topic vel: float in [-1.0, 1.0] = 0.0;
plant Cart period 10ms { reads vel; drives pos = x; state x: float; der x = vel; }
node Fast period 10ms { publishes vel; step { publish vel = 1.0; } }
node Stop period 10ms { publishes vel; step { publish vel = 0.0; } }
rta Guard {
  ac Fast;
  sc Stop;
  period 50ms;
  safe abs(pos) < 10.0;
  failsafe vel = 0.0;
  verify { grid pos in [-10.0, 10.0] / 40; recover never; }
}
system Track { c: Cart; module Guard; until 1s; }
"""


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
    assert shows_colors(Terminal())
    assert not shows_colors(io.StringIO())
    assert not shows_colors(None)
    monkeypatch.setenv("TERM", "dumb")
    assert not shows_colors(Terminal())
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert shows_colors(io.StringIO())
    monkeypatch.setenv("NO_COLOR", "1")
    assert not shows_colors(Terminal())


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

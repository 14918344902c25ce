"""Logs and reports of runs hold what the trace holds."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from mcap.reader import make_reader

from soter.diagnostics.diagnostic import SoterError
from soter.simulate.run import NativeProgram
from soter.simulate.run_log import RunLog, write_log
from soter.simulate.run_report import report_page, run_chart, write_report

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.language.model.system import System
    from soter.simulate.result import Run

    Cart = Callable[[str], System]

S = 10**9


@pytest.fixture
def run(cart: Cart) -> Run:
    return NativeProgram(cart("Protected")).run(3 * S, 1, keep_trace=True, hash_trace=True)


def messages(path: Path, topic: str) -> list[tuple[int, dict[str, Any]]]:
    with path.open("rb") as stream:
        return [
            (m.log_time, json.loads(m.data))
            for _, _, m in make_reader(stream).iter_messages(topics=[topic])
        ]


def test_a_topic_is_logged_whenever_it_is_published(run: Run, tmp_path: Path) -> None:
    path = write_log(run, tmp_path / "a.mcap", "1")
    assert run.trace is not None
    motion = messages(path, "motion")
    assert len(motion) == 601
    assert motion[-1][1]["x"] == run.trace["topics"]["motion"]["x"][-1]
    assert len(messages(path, "accel")) == 301
    assert messages(path, "goal") == [(0, {"value": 9.5})], "nobody sets it: its default"


def test_plants_modes_and_decisions_are_logged(run: Run, tmp_path: Path) -> None:
    path = write_log(run, tmp_path / "a.mcap", "1")
    assert run.trace is not None
    truth = messages(path, "c.truth")
    assert truth[-1] == (3 * S, {"x": run.trace["c"]["x"][-1], "v": run.trace["c"]["v"][-1]})
    modes = messages(path, "soter/modes")
    assert modes[0] == (0, {"module": "SafeCart", "mode": "SC"})
    assert [m["mode"] for _, m in modes] == ["SC", "AC", "SC", "AC", "SC"]
    decisions = messages(path, "soter/decisions")
    assert len(decisions) == 61
    taken = [d for _, d in decisions if d["mode_before"] != d["mode_after"]]
    assert taken[1]["reason"].startswith("ttf: ")
    assert [w.partition(" = ")[0] for w in taken[1]["why"]] == ["Room(motion, 0.12)"]
    assert [d["margin_s"] for d in taken[:2]] == [0.049, 0.0]
    assert taken[1]["predicates"] == {
        "ttf": True,
        "safer": False,
        "stale": False,
        "gate_fault": False,
    }


def test_every_type_of_topic_has_a_schema(flat: Callable[[str], System], tmp_path: Path) -> None:
    system = flat("""
    soter 1;
    type Kind = enum { A, B };
    type R = { k: Kind, b: bool, n: int, xs: float[<=3], v: Vec3 };
    topic r: R;
    topic flag: bool;
    node N period 10ms { publishes flag; step { publish flag = true; } }
    node M period 10ms { publishes r; var x: R; step { x.xs = [1.0, 2.0]; publish r = x; } }
    system S { node N; node M; until 20ms; }
    """)
    run = NativeProgram(system).run(20_000_000, 1, keep_trace=True)
    path = write_log(run, tmp_path / "a.mcap", "1")
    assert messages(path, "flag")[-1][1] == {"value": True}
    assert messages(path, "r")[-1][1] == {
        "k": "A",
        "b": False,
        "n": 0,
        "xs": [1.0, 2.0],
        "v": {"x": 0.0, "y": 0.0, "z": 0.0},
    }


def test_the_report_shows_signals_modes_and_grounds(run: Run, tmp_path: Path) -> None:
    chart = run_chart(run)
    names = [s.name for s in chart.series]
    assert names[0] == "c.x"  # a property reads it
    assert set(names[1:]) == {"c.v", "motion.x", "motion.v", "goal", "accel"}
    assert len(chart.decisions) == 4
    page = report_page(run, "cart", {})
    assert any("P2a" in line for line in page.assumptions)
    path = write_report(run, tmp_path / "a.html", "cart", {"seed": "1"})
    assert "SafeCart" in path.read_text()


def test_bools_and_ints_are_signals_too(flat: Callable[[str], System]) -> None:
    system = flat("""
    soter 1;
    topic on: bool;
    topic n: int in [0, 9];
    node N period 10ms { publishes on, n; step { publish on = time > 0.5; publish n = 3; } }
    system S { node N; until 1s; }
    """)
    chart = run_chart(NativeProgram(system).run(S, 1, keep_trace=True))
    n, on = chart.series  # what has limits comes first
    assert (on.name, set(on.values)) == ("on", {0.0, 1.0})
    assert [t.value for t in n.thresholds] == [0.0, 9.0]


def test_extras_that_are_not_installed(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("soter.report.mcap_reading.find_spec", lambda _: None)
    monkeypatch.setattr("soter.report.html.find_spec", lambda _: None)
    with pytest.raises(SoterError, match="D007") as caught:
        write_log(run, tmp_path / "a.mcap", "1")
    assert "pip install 'soter-rta[logs]'" in caught.value.diagnostics[0].helps[0]
    with pytest.raises(SoterError, match="D007") as caught:
        write_report(run, tmp_path / "a.html", "cart", {})
    assert "pip install 'soter-rta[report]'" in caught.value.diagnostics[0].helps[0]


def test_a_log_written_while_the_run_goes_on_is_the_same(
    cart: Cart, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("soter.simulate.run.CHUNK_BYTES", 1)  # 16 states a block
    log = RunLog(tmp_path / "b.mcap", "1")
    log.begin(run.system, run.layout, 1, "native", {})
    again = NativeProgram(cart("Protected")).run(3 * S, 1, hash_trace=True, also=log.see)
    assert not (tmp_path / "b.mcap").exists()
    log.end(again, "")
    assert again.trace is None
    whole = write_log(run, tmp_path / "a.mcap", "1")
    assert whole.read_bytes() == (tmp_path / "b.mcap").read_bytes()

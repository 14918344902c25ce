"""Campaigns: the runs of their seeds, the same whoever flies them, and nothing lost."""

from __future__ import annotations

import hashlib
import json
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import processes
from soter import SoterError, load
from soter.campaign import batch_flights as fleets
from soter.campaign.batch_flights import EVENT, TO_AC, TO_SC, VIOLATED, Fleet
from soter.campaign.store import campaign_digest
from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram, run_interpreted

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.campaign.result import Campaign
    from soter.language.model.system import System

ROOT = Path(__file__).resolve().parents[3]
CART = ROOT / "examples" / "wall" / "cart.soter"
SECOND = 10**9


def system(name: str, file: Path = CART) -> System:
    return system_of(check_file(str(file)), name)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    folder = tmp_path_factory.mktemp("campaign") / "c"
    return load(CART).campaign("Unprotected", flights=200, until="4s", output=folder, workers=1)


@pytest.mark.parametrize("name", ["Protected", "Unprotected"])
def test_a_flight_is_the_run_of_its_seed(name: str) -> None:
    flat = system(name)
    fleet, program = Fleet(flat, 10 * SECOND), NativeProgram(flat)
    for flight in fleet.fly(range(20), first_seed=5):
        run = program.run(10 * SECOND, flight.seed, hash_trace=True)
        assert flight.seed == 5 + flight.number
        assert flight.violations == run.violations
        assert list(flight.broken) == [v.what for v in run.violation_list for _ in range(v.count)]
        for k, m in enumerate(run.modules.values()):
            assert flight.ac_s[k] / flight.seconds == pytest.approx(m.ac_share, abs=1e-12)
            assert flight.disengagements[k] == m.switches_to_sc
            assert flight.gate_faults[k] == m.gate_faults
        firsts = [v.time_s for v in run.violation_list if v.time_s is not None]
        assert flight.first_s == (min(firsts) if firsts else None)


def test_a_digest_is_that_of_the_events_and_the_last_state_of_the_interpreter() -> None:
    flat = system("Protected")
    (flight,) = Fleet(flat, 3 * SECOND).fly([0], first_seed=7)
    run = run_interpreted(flat, 3 * SECOND, 7)
    events = [(c.time_ns, TO_AC if c.to == "AC" else TO_SC, c.module) for c in run.changes]
    said = np.array(events, dtype=EVENT).tobytes() + run.final.tobytes()
    assert flight.digest == hashlib.sha256(said).hexdigest()


@pytest.mark.parametrize("optimise", ["-O0", "-O2"])
def test_the_compiler_changes_nothing(optimise: str, flown: Campaign) -> None:
    flights = Fleet(system("Unprotected"), 4 * SECOND, optimise).fly(range(30), first_seed=1)
    assert flights == list(flown.flights[:30])


@pytest.mark.parametrize("workers", [2, 3, 7])
def test_the_number_of_workers_changes_nothing(
    workers: int, flown: Campaign, tmp_path: Path
) -> None:
    again = load(CART).campaign(
        "Unprotected", flights=200, until="4s", output=tmp_path / "c", workers=workers
    )
    assert again.result == flown.result
    assert (tmp_path / "c" / "flights.csv").read_bytes() == (
        flown.folder / "flights.csv"
    ).read_bytes()


def test_little_room_for_events_changes_nothing(
    flown: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleets, "ROOM", 1)
    flights = Fleet(system("Unprotected"), 4 * SECOND).fly(range(50), first_seed=1)
    assert flights == list(flown.flights[:50])


def test_cut_at_any_byte_it_goes_on_to_the_same(flown: Campaign, tmp_path: Path) -> None:
    whole = (flown.folder / "flights.csv").read_bytes()
    rng = np.random.default_rng(3)
    for k in range(12):
        folder = tmp_path / str(k)
        shutil.copytree(flown.folder, folder)
        (folder / "flights.csv").write_bytes(whole[: rng.integers(len(whole) + 1)])
        again = load(CART).campaign("Unprotected", flights=200, until="4s", output=folder)
        assert again.result.digest == flown.result.digest
        assert (folder / "flights.csv").read_bytes() == whole


def test_a_line_that_was_changed_is_flown_again(flown: Campaign, tmp_path: Path) -> None:
    shutil.copytree(flown.folder, tmp_path / "c")
    path = tmp_path / "c" / "flights.csv"
    lines = path.read_text().splitlines(keepends=True)
    lines[40] = "what is this\n"
    path.write_text("".join(lines))
    again = load(CART).campaign("Unprotected", flights=200, until="4s", output=tmp_path / "c")
    assert (again.flown, again.result) == (200 - 39, flown.result)


@pytest.mark.long
def test_killed_it_goes_on_and_loses_nothing(tmp_path: Path, flown: Campaign) -> None:
    command = [
        sys.executable,
        "-c",
        "import sys; from soter.cli.main import main; sys.exit(main())",
    ]
    command += ["campaign", str(CART), "--system", "Unprotected", "--flights", "200"]
    command += ["--until", "4s", "-o", str(tmp_path / "c")]
    for delay_s in (0.4, 0.7, 1.0):
        with processes.started(command, stdout=processes.PIPE, stderr=processes.PIPE) as process:
            time.sleep(delay_s)
            process.send_signal(signal.SIGKILL)
    assert processes.run(command, capture_output=True).returncode == 3
    again = load(CART).campaign("Unprotected", flights=200, until="4s", output=tmp_path / "c")
    assert (again.flown, again.result.digest) == (0, flown.result.digest)


def test_a_longer_one_goes_on_where_a_shorter_one_ended(tmp_path: Path, flown: Campaign) -> None:
    folder = tmp_path / "c"
    short = load(CART).campaign("Unprotected", flights=60, until="4s", output=folder)
    long = load(CART).campaign("Unprotected", flights=200, until="4s", output=folder)
    assert (short.flown, long.flown) == (60, 140)
    assert short.result.digest == campaign_digest(flown.flights[:60])
    assert long.result == flown.result
    assert load(CART).campaign("Unprotected", flights=60, until="4s", output=folder).flown == 0


def test_hours_make_flights(tmp_path: Path) -> None:
    campaign = load(CART).campaign("Protected", hours=0.01, until="10s", output=tmp_path / "c")
    assert len(campaign.flights) == 4
    assert campaign.result.hours == pytest.approx(40 / 3600)


@pytest.mark.parametrize(
    ("how", "code"),
    [
        ({"hours": float("nan")}, "U001"),
        ({"hours": -1.0}, "U001"),
        ({"hours": 1.0, "flights": 3}, "U001"),
        ({"flights": 0}, "U001"),
        ({"flights": 3, "workers": 0}, "U001"),
        ({"flights": 3, "workers": 1000}, "U001"),
        ({"hours": 1.0, "until": "0s"}, "U001"),
    ],
)
def test_wrong_figures_are_refused(how: dict[str, object], code: str, tmp_path: Path) -> None:
    with pytest.raises(SoterError) as caught:
        load(CART).campaign("Protected", output=tmp_path / "c", **how)
    assert [d.code for d in caught.value.diagnostics] == [code]
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize("other", [{"seed": 2}, {"until": "5s"}, {"system": "Protected"}])
def test_the_folder_of_another_campaign_is_left_alone(
    other: dict[str, Any], flown: Campaign
) -> None:
    before = (flown.folder / "flights.csv").read_bytes()
    how: dict[str, Any] = {"system": "Unprotected", "flights": 3, "until": "4s", **other}
    with pytest.raises(SoterError, match="another campaign") as caught:
        load(CART).campaign(output=flown.folder, **how)
    assert [d.code for d in caught.value.diagnostics] == ["D006"]
    assert (flown.folder / "flights.csv").read_bytes() == before


def test_a_folder_of_somebody_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(SoterError, match="something else"):
        load(CART).campaign("Protected", flights=1, until="1s", output=tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_a_disk_that_fills_keeps_what_was_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import os

    calls = iter([None, None, OSError(28, "No space left on device")])

    def sync(_: int) -> None:
        error = next(calls)
        if error is not None:
            raise error

    folder = tmp_path / "c"
    monkeypatch.setattr(os, "fsync", sync)
    with pytest.raises(SoterError, match=r"no space left.*; 64 flights are kept"):
        load(CART).campaign("Protected", flights=200, until="1s", output=folder, workers=1)
    monkeypatch.undo()
    again = load(CART).campaign("Protected", flights=200, until="1s", output=folder)
    assert len(again.flights) == 200


def test_episodes_join_what_lies_close_together() -> None:
    times = [1, 2, 3, 3 + 2, 10]
    rows = [(t * SECOND, TO_SC, 0) for t in times] + [(4 * SECOND, TO_SC, 1), (0, VIOLATED, 0)]
    events = np.array(sorted(rows), dtype=EVENT)
    assert fleets._episode_count(events, 0) == 2
    assert fleets._episode_count(events, 1) == 1
    assert fleets._episode_count(events, 2) == 0


def test_extern_nodes_are_refused(make: Callable[[str], Path], tmp_path: Path) -> None:
    path = make(
        "soter 1; topic a: float; extern node N period 10ms { publishes a; }\n"
        "system S { node N; until 1s; }\n"
    )
    with pytest.raises(SoterError, match="extern") as caught:
        load(path).campaign(flights=1, output=tmp_path / "c")
    assert [d.code for d in caught.value.diagnostics] == ["U003"]


def test_extern_plants_are_refused_as_plants(make: Callable[[str], Path], tmp_path: Path) -> None:
    path = make(
        "soter 1; topic a: float; topic u: float; extern plant P period 10ms {\n"
        "  reads u; drives a = x; state x: float; }\n"
        "node N period 10ms { subscribes a; publishes u; step { publish u = a; } }\n"
        "system S { p: P; node N; until 1s; }\n"
    )
    with pytest.raises(SoterError, match="plant `p` is extern") as caught:
        load(path).campaign(flights=1, output=tmp_path / "c")
    (told,) = caught.value.diagnostics
    assert told.code == "U003"
    assert "next s = move(s, command);" in told.helps[0]


@pytest.mark.parametrize("bound", ["onnx:rush.onnx", "sb3:rush.zip", "python:rush.py:step"])
def test_a_node_that_a_file_answers_is_refused_with_all_that_can_fly_instead(
    make: Callable[[str], Path], tmp_path: Path, bound: str
) -> None:
    """Before, nothing said that a policy can be written as a function, or C be linked."""
    path = make(
        "soter 1; topic a: float; topic u: float; plant P period 10ms {\n"
        "  reads u; drives a = x; state x: float; }\n"
        f'extern node N period 10ms from "{bound}" {{ subscribes a; publishes u; }}\n'
        "system S { p: P; node N; until 1s; }\n"
    )
    with pytest.raises(SoterError, match="node `N` is extern") as caught:
        load(path).campaign(flights=1, output=tmp_path / "c")
    assert not any("soter policy" in h for h in caught.value.diagnostics[0].helps)  # no such file
    (tmp_path / bound.split(":")[1]).write_bytes(b"")
    with pytest.raises(SoterError, match="node `N` is extern") as caught:
        load(path).campaign(flights=1, output=tmp_path / "c")
    (told,) = caught.value.diagnostics
    policy = not bound.startswith("python")
    assert any("soter policy FILE -o" in h for h in told.helps) == policy
    written = f"soter policy {tmp_path / 'rush'}"
    assert any(written in h and "--bind N=c:N.c:N_step" in h for h in told.helps) == policy
    assert any("`--bind NODE=c:file.c:function`" in h for h in told.helps)


@pytest.fixture
def make(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "program.soter"
        path.write_text(text)
        return path

    return write


def test_the_command_prints_json_and_says_3_where_something_was_violated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.cli.main import main

    arguments = ["campaign", str(CART), "--flights", "5", "--until", "4s", "-o"]
    assert main([*arguments, str(tmp_path / "p"), "--system", "Protected", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["violations"] == 0
    assert document["violations_per_hour"][0] == 0.0
    assert main([*arguments, str(tmp_path / "u"), "--system", "Unprotected"]) == 3
    assert "violations; with 95 % confidence" in capsys.readouterr().out

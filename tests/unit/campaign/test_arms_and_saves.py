"""What campaigns measure, whose fault it was, what AC would have done, and other rules."""

from __future__ import annotations

import csv
import hashlib
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter import SoterError, load
from soter.api.campaigning import own_folder
from soter.campaign.arms import NAMES, find_arms
from soter.campaign.batch_flights import EVENT, Fleet
from soter.campaign.release_lateness import Lateness, measure_lateness
from soter.campaign.result import count_faults, faults_outside
from soter.language.elaborate.derived_systems import with_forced_mode
from soter.language.front_end import check_file, system_of
from soter.semantics.faults import begin_times
from soter.simulate.run import NativeProgram, run_interpreted

if TYPE_CHECKING:
    from soter.language.model.system import System
    from soter.simulate.result import Run

ROOT = Path(__file__).resolve().parents[3]
CART = ROOT / "examples" / "wall" / "cart.soter"
SECOND = 10**9
SC_MODE, AC_MODE = 0, 1
MEASURES = """
  measure far = abs(c.truth.x) in [0.0, 4.0] / 8 every 100ms;
  measure inverse = 1.0 / (motion.x > 2.0 ? 0.0 : 1.0) in [0.5, 2.0] / 3 every 30ms;
"""


@pytest.fixture
def changed(tmp_path: Path) -> Path:
    path = tmp_path / "cart.soter"
    text = CART.read_text(encoding="utf-8")
    path.write_text(text.replace("until 30s;", f"until 30s;{MEASURES}", 1))
    return path


def flat_of(path: Path, name: str = "Protected") -> System:
    return system_of(check_file(str(path)), name)


def with_faults(folder: Path, faults: str, system: str = "Protected") -> Path:
    path = folder / "faulty.soter"
    text = CART.read_text(encoding="utf-8")
    head, tail = text.split(f"system {system}", 1)
    tail = tail.replace("until 30s;", f"until 30s;\n  faults {{ {faults} }}", 1)
    path.write_text(f"{head}system {system}{tail}")
    return path


# ---------------------------------------------------------------- measures


def test_measures_are_what_a_trace_says(changed: Path) -> None:
    flat = flat_of(changed)
    (flight,) = Fleet(flat, 12 * SECOND).fly([0], first_seed=3)
    run = run_interpreted(flat, 12 * SECOND, 3, keep_trace=True)
    states = run.require_trace()
    times = states["header"]["ct"].astype(np.int64)
    for look, every_ns in zip(flight.looks, (100_000_000, 30_000_000), strict=True):
        slots = times // every_ns
        first = np.flatnonzero(np.concatenate([[True], slots[1:] != slots[:-1]]))
        assert sum(look.bins) == look.count <= len(first)
        if every_ns == 100_000_000:
            x = np.abs(states["c"]["x"][first])
            assert (look.sum, look.least, look.most) == (sum(x.tolist()), x.min(), x.max())
            assert look.bins[1:-1] == tuple(np.histogram(x, 8, (0.0, 4.0))[0].tolist())
            assert look.bins[-1] == int((x > 4.0).sum())
    far, inverse = flight.looks
    assert far.count == 121
    assert 0 < inverse.count < 12 / 0.03, "looks that divide by zero are no numbers"
    assert inverse.least == inverse.most == 1.0


def test_a_histogram_counts_its_ends_inside(tmp_path: Path) -> None:
    path = tmp_path / "p.soter"
    path.write_text(
        "soter 1; plant P period 10ms { state n: int in [0, 1000] = 0; next n = (n + 1) % 6; }\n"
        "system S { p: P; until 59ms; measure n = float(p.truth.n) in [1.0, 4.0] / 3 every 10ms; }"
    )
    (flight,) = Fleet(flat_of(path, "S"), 59_000_000).fly([0], first_seed=1)
    (look,) = flight.looks
    assert look.bins == (1, 1, 1, 2, 1), "0 | 1 | 2 | 3 4 | 5"
    assert (look.count, look.sum, look.least, look.most) == (6, 15.0, 0.0, 5.0)


@pytest.mark.parametrize(
    ("measure", "code"),
    [
        ("measure m = true in [0.0, 1.0] / 2 every 1s;", "T001"),
        ("measure m = 1.0 in [1.0, 0.0] / 2 every 1s;", "V001"),
        ("measure m = 1.0 in [0.0, 1.0] / 0 every 1s;", "C002"),
        ("measure m = 1.0 in [0.0, 1.0] / 2 every 0s;", "C001"),
        ("measure m = 1.0 in [0.0, 1.0] / 2 every 1s; measure m = 2.0 in [0.0, 1.0] / 2 every 1s;",
         "N002"),
        ("measure m = nobody in [0.0, 1.0] / 2 every 1s;", "N001"),
    ],
)  # fmt: skip
def test_wrong_measures_are_refused(measure: str, code: str, tmp_path: Path) -> None:
    path = tmp_path / "p.soter"
    path.write_text(
        "soter 1; plant P period 10ms { state n: float = 0.0; next n = n; }\n"
        f"system S {{ p: P; until 1s; {measure} }}"
    )
    with pytest.raises(SoterError) as caught:
        flat_of(path, "S")
    assert code in [d.code for d in caught.value.diagnostics]


# ---------------------------------------------------------------- saves


def test_a_save_is_what_a_run_with_ac_left_in_control_says() -> None:
    """AC rushes to a goal beyond the wall: left alone it crashes; another one never would."""
    flat = flat_of(CART)
    fleet = Fleet(flat, 20 * SECOND, horizon_ns=5 * SECOND)
    flights = fleet.fly(range(12), first_seed=1)
    alone = NativeProgram(with_forced_mode(flat, 0, "ac"))
    assert sum(f.saves[0] for f in flights) > 0
    for f in flights:
        assert f.saves[0] + f.precautions[0] == f.episodes[0]
        if f.saves[0] and f.disengagements[0] == 1:
            crashed = alone.run(26 * SECOND, f.seed).violations
            assert crashed


def test_counting_saves_changes_no_flight() -> None:
    flat = flat_of(CART)
    plain = Fleet(flat, 10 * SECOND).fly(range(10), first_seed=1)
    saved = Fleet(flat, 10 * SECOND, horizon_ns=3 * SECOND).fly(range(10), first_seed=1)
    assert [f.digest for f in plain] == [f.digest for f in saved]
    assert plain[0].saves == ()


def test_where_ac_does_no_harm_all_are_precautions(tmp_path: Path) -> None:
    path = tmp_path / "tame.soter"
    text = CART.read_text(encoding="utf-8")
    path.write_text(
        text.replace("clamp(4.0 * (goal - motion.x) - 1.0 * motion.v, -A, A)",
                     "clamp(1.0 * (9.8 - motion.x) - 3.0 * motion.v, -A, A)")
    )  # fmt: skip
    flat = flat_of(path)
    flights = Fleet(flat, 20 * SECOND, horizon_ns=5 * SECOND).fly(range(4), first_seed=1)
    assert sum(f.saves[0] for f in flights) == 0 < sum(f.precautions[0] for f in flights)


# ---------------------------------------------------------------- whose fault


def test_a_violation_without_a_fault_outside_is_a_defect(tmp_path: Path) -> None:
    def flown(faults: str, name: str) -> tuple[int, int]:
        path = with_faults(tmp_path, faults)
        campaign = load(path).campaign("Protected", flights=40, until="20s", output=tmp_path / name)
        return campaign.result.flights_violated, campaign.result.violated_inside

    violated, defects = flown("late SafeCart.dm by 900ms at 1000 per 1h;", "outside")
    assert violated > 0 == defects
    violated, defects = flown("stuck SafeCart.Fast at 400 per 1h for 1s;", "inside")
    assert violated == defects == 0


def test_what_was_outside_is_told_up_to_the_violation(tmp_path: Path) -> None:
    flat = flat_of(with_faults(tmp_path, "silent c at 100 per 1h for 1s; order any;"))
    told = [faults_outside(flat, seed, 30 * SECOND) for seed in range(20)]
    assert all("order any" in t for t in told)
    some = ["silent c at 100 per 1h for 1s" in t for t in told]
    assert any(some)
    assert not all(some)


@pytest.mark.parametrize(
    "faults",
    [
        "silent c at 100 per 1h for 1s;",
        "nan SafeCart.Fast at 300 per 1h; skip SafeCart.Fast at 300 per 1h for 700ms;",
        "saturated SafeCart.Fast at 3000 per 1h for 3ms; bias c by 0.1 at 900 per 1h for 2s;",
        "overrun SafeCart.Fast by 3ms at 4000 per 1h; late SafeCart.dm by 90ms at 900 per 1h;",
    ],
)
def test_how_often_each_fault_was_there_is_what_each_run_says(faults: str, tmp_path: Path) -> None:
    flat, until = flat_of(with_faults(tmp_path, faults)), 29 * SECOND
    seeds = [*range(7), 2**64 - 1]
    told = count_faults(flat, seeds, until)
    wanted: dict[str, int] = {}
    for text, stream in {(f.text, f.stream) for f in flat.faults if f.on is None}:
        (f, *_) = [f for f in flat.faults if f.stream == stream]
        c = flat.components[f.component]
        times = sum(len(begin_times(f, c, seed, until)) for seed in seeds)
        wanted[text] = wanted.get(text, 0) + times
    assert told == wanted
    assert all(n > 0 for n in wanted.values())


def test_many_flights_are_counted_in_pieces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flat = flat_of(with_faults(tmp_path, "nan SafeCart.Fast at 300 per 1h;"))
    whole = count_faults(flat, range(50), SECOND)
    monkeypatch.setattr("soter.campaign.result.DRAWS", 300)
    assert count_faults(flat, range(50), SECOND) == whole


def test_a_campaign_tells_how_often_each_fault_was_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.cli.main import main

    said = "late modules by 400ms at 900 per 1h"
    path = with_faults(tmp_path, f"{said}; late all by [0ms, 1us]; order any;")
    folder = tmp_path / "c"
    arguments = ["campaign", str(path), "--system", "Protected", "--flights", "20"]
    main([*arguments, "--until", "10s", "--report", "--json", "-o", str(folder)])
    document = json.loads(capsys.readouterr().out)
    times = {f["fault"]: f["times"] for f in document["faults"]}
    flat = flat_of(path)
    late = next(f for f in flat.faults if f.text == said)
    c = flat.components[late.component]
    once = sum(len(begin_times(late, c, seed, 10 * SECOND)) for seed in range(1, 21))
    assert times == {said: once, "late all by [0ms, 1us]": None, "order any": None}
    assert 20 < once < 80, "50 are expected"
    assert f">{once}</td>" in (folder / "report.html").read_text(encoding="utf-8")
    main([*arguments, "--until", "10s", "-o", str(folder)])
    assert re.search(rf"{once} +{said} +outside", capsys.readouterr().out)


# ---------------------------------------------------------------- arms


def test_arms_are_other_systems_on_the_same_seeds() -> None:
    late = (0, 1_000_000, 40_000_000)
    made = {a.name: a.system for a in find_arms(flat_of(CART), NAMES, late)}
    assert list(made) == [
        "ours", "ac", "paper",
        *(f"{who}-{g}-{ms}ms" for g in ("modules", "all") for ms in (120, 360, 1200)
          for who in ("ours", "paper")),
    ]  # fmt: skip
    assert made["ac"].modules[0].forced == "ac"
    assert made["paper"].shuffled
    assert not made["ours-all-360ms"].shuffled
    for name in ("paper", "paper-all-1200ms", "ours-modules-360ms"):
        native = NativeProgram(made[name]).run(5 * SECOND, 4, hash_trace=True)
        again = run_interpreted(made[name], 5 * SECOND, 4, hash_trace=True)
        assert native.trace_sha256 == again.trace_sha256


def test_arms_hold_up_nodes_whose_steps_take_time(tmp_path: Path) -> None:
    path = tmp_path / "c.soter"
    head = "node Fast period 10ms {"
    text = CART.read_text(encoding="utf-8")
    assert head in text
    path.write_text(text.replace(head, f"{head} takes [5ms, 30ms];"))
    system = flat_of(path)
    (lasting,) = [c for c in system.components if c.takes_ns is not None]
    made = {a.name: a.system for a in find_arms(system, NAMES, (0, 1_000_000))}
    for name in ("ours-all-120ms", "paper"):
        assert lasting.index in {f.component for f in made[name].faults}
        native = NativeProgram(made[name]).run(5 * SECOND, 4, hash_trace=True)
        again = run_interpreted(made[name], 5 * SECOND, 4, hash_trace=True)
        assert native.trace_sha256 == again.trace_sha256


def test_a_campaign_with_arms_tells_each_and_goes_on(tmp_path: Path) -> None:
    how = {"flights": 30, "until": "6s", "output": tmp_path / "c", "arms": ("ac", "paper")}
    campaign = load(CART).campaign("Protected", lateness_s=0.2, **how)
    assert [a.name for a in campaign.arms] == ["ours", "ac", "paper"]
    assert campaign.arms[1].result.flights_violated > 0 == campaign.result.violations
    assert "releases every 10 ms" in campaign.lateness
    again = load(CART).campaign("Protected", lateness_s=0.2, **how)
    assert [a.flown for a in again.arms] == [0, 0, 0]
    assert [a.result.digest for a in again.arms] == [a.result.digest for a in campaign.arms]


def test_an_arm_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SoterError, match="no arm `best`"):
        load(CART).campaign(flights=1, arms=("best",), output=tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_lateness_is_measured_and_told() -> None:
    lateness = measure_lateness(seconds=0.1)
    assert isinstance(lateness, Lateness)
    assert lateness.releases == 10
    assert list(lateness.quantiles_ns) == sorted(lateness.quantiles_ns)
    assert "busy processes" in lateness.as_text()


# ---------------------------------------------------------------- what is written


def test_the_page_tells_what_was_flown_and_needs_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changed: Path
) -> None:
    from soter.cli.main import main

    folder = tmp_path / "c"
    arguments = ["campaign", str(changed), "--flights", "6", "--until", "9s", "--saves", "3s"]
    assert main([*arguments, "--report", "--json", "-o", str(folder)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["saves"] + document["precautions"] == document["episodes"]
    assert document["measures"]["far"]["mean"] > 0
    text = (folder / "report.html").read_text(encoding="utf-8")
    for part in ("0 violations", "Who was in control", "precautions", "<svg", "far", "rests on"):
        assert part in text
    assert "<script" not in text
    assert "http" not in text.replace("http-equiv", "")


def test_parquet_says_what_the_flights_say(tmp_path: Path, changed: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra `cluster` is absent")
    from soter.campaign.store import write_parquet

    campaign = load(changed).campaign(flights=7, until="2s", output=tmp_path / "c", saves="1s")
    table = parquet.read_table(write_parquet(campaign.folder)).to_pydict()
    assert table["digest"] == [f.digest for f in campaign.flights]
    assert table["far.sum"] == [f.looks[0].sum for f in campaign.flights]
    assert table["SafeCart.saves"] == [f.saves[0] for f in campaign.flights]


def test_a_flight_is_flown_again_by_its_number(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.cli.main import main

    campaign = load(CART).campaign(
        "Unprotected", flights=9, until="4s", output=tmp_path / "c", seed=5
    )
    flight = campaign.result.worst[-1]
    arguments = ["run", str(CART), "--system", "Unprotected", "--until", "4s", "--json"]
    assert main([*arguments, "--seed", "5", "--flight", str(flight.number)]) == 3
    document = json.loads(capsys.readouterr().out)
    assert document["violations"] == flight.violations


def digest_of_run(run: Run) -> str:
    """SHA-256 over events and last state, straight from a trace: another `soter_compare`."""
    states, events = run.require_trace(), []
    before = {
        "mode": [AC_MODE if m.forced == "ac" else SC_MODE for m in run.system.modules],
        "count": [0] * len(run.system.properties),
        "latched": [0] * len(run.system.components),
    }
    for state in states:
        time = int(state["header"]["ct"])
        for i, mode in enumerate(state["modules"]["mode"]):
            if mode != before["mode"][i]:
                events.append((time, 0 if mode == SC_MODE else 1, i))
        for i, count in enumerate(state["properties"]["count"]):
            if count != before["count"][i]:
                events.append((time, 2, i))
        for i, latched in enumerate(state["components"]["latched"]):
            if latched != before["latched"][i]:
                events.append((time, 3, i))
        before = {
            "mode": state["modules"]["mode"],
            "count": state["properties"]["count"],
            "latched": state["components"]["latched"],
        }
    event_array = np.array(events, dtype=EVENT)
    return hashlib.sha256(event_array.tobytes() + states[-1].tobytes()).hexdigest()


def rows_of(folder: Path) -> list[dict[str, str]]:
    text = (folder / "flights.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))


@pytest.fixture(scope="module")
def flown_by_arms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("arms") / "c"
    how = {"flights": 4, "until": "5s", "output": folder, "seed": 11, "lateness_s": 0.2}
    load(CART).campaign("Protected", arms=("ac", "paper", "swept"), **how)
    return folder


@pytest.mark.parametrize("arm", ["ours", "ac", "paper", "ours-modules-1200ms", "paper-all-360ms"])
def test_a_flight_of_an_arm_is_flown_again_bit_for_bit(arm: str, flown_by_arms: Path) -> None:
    place = flown_by_arms if arm == "ours" else flown_by_arms / f"arm-{arm}"
    rows = rows_of(place)
    assert len(rows) == 4
    program, of = load(CART), flown_by_arms if arm == "paper" else None
    for row in rows:
        for engine in ("native", "interp") if row["number"] == "2" else ("native",):
            seed = int(row["seed"])
            run = program.simulate("Protected", "5s", seed, engine, arm=arm, campaign=of)
            assert digest_of_run(run) == row["digest"]
    assert len({row["digest"] for row in rows}) == 4


@pytest.mark.whole
def test_a_run_of_an_arm_is_asked_for_by_the_number_of_its_flight(
    flown_by_arms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.cli.main import main

    arguments = ["run", str(CART), "--system", "Protected", "--until", "5s", "--seed", "11"]
    arguments += ["--flight", "3", "--json", "--report", "-o", str(tmp_path)]
    digests = []
    for arm, more in (("paper", ["--campaign", str(flown_by_arms)]), ("ac", [])):
        row = rows_of(flown_by_arms / f"arm-{arm}")[3]
        code = main([*arguments, "--arm", arm, *more])
        document = json.loads(capsys.readouterr().out)
        assert (code == 3) == (document["violations"] > 0)
        assert document["violations"] == int(row["violations"])
        assert arm in Path(document["report"]).name
        digests.append(document["trace_sha256"])
    assert digests[0] != digests[1]


@pytest.mark.parametrize(
    ("arm", "campaign", "code", "said"),
    [
        ("best", None, "U001", "there is no arm `best`"),
        ("paper", "nowhere", "D006", "no arm `paper` was flown there"),
        ("paper", None, "D006", "no arm `paper` was flown there"),
    ],
)
def test_an_arm_that_cannot_be_flown_again_is_an_error_in_words(
    arm: str, campaign: str | None, code: str, said: str
) -> None:
    with pytest.raises(SoterError, match=said) as caught:
        load(CART).simulate("Protected", "1s", arm=arm, campaign=campaign)
    assert [d.code for d in caught.value.diagnostics] == [code]


def test_a_lateness_of_another_program_is_refused(flown_by_arms: Path) -> None:
    with pytest.raises(SoterError, match="of another program or system"):
        load(CART).simulate("Unprotected", "1s", arm="paper", campaign=flown_by_arms)


def test_where_a_campaign_lies_is_known_without_being_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    program = load(CART)
    campaign = program.campaign("Protected", {}, flights=1, until="2s", seed=3)
    assert own_folder(program.flat("Protected"), program.path, "2s", 3) == campaign.folder


def test_flights_in_which_steps_overrun_are_runs_bit_for_bit(tmp_path: Path) -> None:
    faults = "overrun SafeCart.Fast by 35ms at 900 per 1h for 300ms; late SafeCart.Fast by 4ms;"
    path = with_faults(tmp_path, faults)
    flights = Fleet(flat_of(path), 6 * SECOND).fly(range(5), first_seed=2)
    program = load(path)
    for f in flights:
        assert digest_of_run(program.simulate("Protected", "6s", f.seed)) == f.digest
    plain = Fleet(flat_of(CART), 6 * SECOND).fly(range(5), first_seed=2)
    assert {f.digest for f in plain}.isdisjoint(f.digest for f in flights)

"""The mountain car of the paper's appendix: proved, conformed to, driven, drawn."""

from __future__ import annotations

import importlib
import json
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from soter.verify.problem.problem import assumption_texts

if TYPE_CHECKING:
    from soter.verify.claims.results import ModuleResult

ROOT = Path(__file__).resolve().parents[2]
CAR = ROOT / "examples" / "mountain_car"
PROGRAM = CAR / "cliff.soter"


@pytest.fixture(scope="module")
def program() -> soter.Program:
    return soter.load(PROGRAM)


@pytest.fixture(scope="module")
def proved(program: soter.Program) -> ModuleResult:
    return program.verify().modules[0]


@pytest.fixture
def beside(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Modules of examples/mountain_car and bench, by name."""
    monkeypatch.syspath_prepend(str(CAR))
    monkeypatch.syspath_prepend(str(ROOT / "bench" / "running"))
    return importlib.import_module


# ---------------------------------------------------------------- the proof


def test_the_module_is_proved_as_shipped(proved: ModuleResult) -> None:
    verdicts = {name: f.verdict for name, f in proved.findings.items()}
    assert verdicts.pop("P1c") == "assumed"  # a map has no times between its steps to declare
    assert verdicts.pop("failsafe") == "assumed"  # no law is declared
    assert set(verdicts.values()) == {"proved"}, verdicts
    assert proved.core_share > 0.88


def test_the_safe_controller_is_what_the_command_finds(tmp_path: Path) -> None:
    for path in CAR.iterdir():
        if path.suffix in {".soter", ".py", ".json"}:
            shutil.copy(path, tmp_path)
    shipped = PROGRAM.read_text()
    pattern = r"// Found by `soter verify --synthesize`\..*?\n}\n\n(?=rta )"
    stripped, count = re.subn(pattern, "", shipped, flags=re.DOTALL)
    assert count == 1
    stripped = stripped.replace("sc SafeCarSC;", "sc synthesized period 1s;")
    (tmp_path / "cliff.soter").write_text(stripped)
    written, table = soter.load(tmp_path / "cliff.soter").synthesize()
    assert written.read_text() == shipped
    assert table.read_bytes() == (CAR / "SafeCarSC.npy").read_bytes()
    assert np.load(table).shape == (45, 35), "docs/mountain_car.md"


@pytest.mark.long
def test_a_safe_controller_that_pushes_left_is_not_proved(tmp_path: Path) -> None:
    for path in CAR.iterdir():
        if path.is_file():
            shutil.copy(path, tmp_path)
    table = np.load(tmp_path / "SafeCarSC.npy")
    np.save(tmp_path / "SafeCarSC.npy", 1 - table)
    (result,) = soter.load(tmp_path / "cliff.soter").verify(refute=False).modules
    assert result.verdict != "proved"
    assert result.findings["P2a"].verdict != "proved" or result.core_share < 0.5


# ---------------------------------------------------------------- driving


@pytest.mark.parametrize("system", ["Protected", "RandomProtected", "AlwaysLeftProtected"])
def test_no_driver_gets_over_the_cliff_with_the_module(program: soter.Program, system: str) -> None:
    for seed in range(8):
        run = program.simulate(system, seed=seed, trace=False)
        assert run.violations == 0
        assert run.modules["SafeCar"].ac_share > 0.8


def test_bang_bang_alone_falls_and_with_the_module_reaches_the_flag(
    program: soter.Program,
) -> None:
    for seed in range(8):
        alone = program.simulate("AdvancedOnly", seed=seed, trace=False).final["topics"]["episode"]
        safe = program.simulate("Protected", seed=seed, trace=False).final["topics"]["episode"]
        assert (bool(alone["fell"]), bool(safe["finished"])) == (True, True)
        assert safe["takeovers"] >= 1


def test_the_bench_counts_what_a_run_says(program: soter.Program, beside: Any) -> None:
    bench = beside("mountain_car")
    driver = bench.Driver("Protected")
    for seed in (3, 4):
        episode = driver.drive(seed)
        final = program.simulate("Protected", seed=seed, trace=False).final["topics"]["episode"]
        assert (episode.steps, episode.ac_steps) == (final["steps"], final["ac_steps"])
        assert (episode.finished, episode.takeovers) == (True, final["takeovers"])


# ---------------------------------------------------------------- Gymnasium's own


def test_gymnasiums_car_is_the_map_within_the_declared_rounding(beside: Any) -> None:
    tally = beside("mountain_car").conform(10_000)
    assert (tally.steps, tally.exceeded) == (10_000, 0)
    assert 0.0 < tally.worst_x <= 1.0
    assert 0.0 < tally.worst_v <= 1.0


def test_with_a_quarter_of_the_rounding_it_would_not_be(
    beside: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = soter.Program.constant
    less = {"ULP_X": 0.25, "ULP_V": 0.1}
    monkeypatch.setattr(
        soter.Program, "constant", lambda self, name: real(self, name) * less.get(name, 1.0)
    )
    assert beside("mountain_car").conform(2_000).exceeded > 100


def test_around_gymnasiums_car_the_proof_says_what_it_assumes() -> None:
    (result,) = soter.load(CAR / "gymnasium.soter").verify(refute=False).modules
    assert result.verdict == "proved"
    assert any("car behaves like model" in text for text in assumption_texts(result.assumptions))


def test_the_module_drives_gymnasiums_car_the_same_on_both_engines() -> None:
    program = soter.load(CAR / "gymnasium.soter")
    native = program.simulate(seed=2, until="60s")
    assert native.violations == 0
    assert native.modules["SafeCar"].ac_share > 0.5
    interpreted = program.simulate(seed=2, until="60s", engine="interp")
    assert native.trace_sha256 == interpreted.trace_sha256
    assert program.simulate("AdvancedOnly", seed=2).violations == 1


# ---------------------------------------------------------------- learning


def test_training_behind_the_module_costs_no_fall(
    beside: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    train, cliff_env = beside("train"), beside("cliff_env")
    monkeypatch.setattr(train, "GENERATIONS", 1)
    _, alone = train.train(cliff_env.make(), 1)
    _, behind = train.train(train.protected(), 1)
    assert alone.falls > 0
    assert behind.falls == 0
    assert behind.episodes == alone.episodes > 0


def test_the_shipped_policy_says_how_it_was_trained(beside: Any) -> None:
    policy = beside("policy")
    facts = json.loads(policy.WEIGHTS.read_text())
    assert facts["falls_protected"] == 0
    assert len(facts["weights"]) == policy.SIZE == 33, "docs/mountain_car.md"
    assert -1.0 <= policy.Policy().force(-0.5, 0.0) <= 1.0


# ---------------------------------------------------------------- the figure


def test_the_figure_shows_sets_both_drives_and_every_switch(
    program: soter.Program, proved: ModuleResult, beside: Any
) -> None:
    figure = beside("figure")
    group = proved.cases[0].groups[0]
    sets = [group.core != 0, group.levels[0], group.levels[-1]]
    edges = [np.array(e) for e in group.edges]
    drawn = figure.draw(program, figure.depth_of(sets), edges, 1)
    traces = {t.name: t for t in drawn.data}
    run = figure.drive(program, "Protected", 1)
    switches = int((run["ac"][1:] != run["ac"][:-1]).sum())
    assert len(traces["switch"].x) == switches >= 2
    assert set(np.unique(drawn.data[0].z)) == {0, 1, 2, 3}
    assert traces["AC alone: over the cliff"].x[-1] <= -1.2
    assert np.isnan(traces["protected, SC in control"].x[run["ac"]]).any()

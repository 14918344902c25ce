"""What a fit to logs says is true of vehicles whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from generators.simulated_plants import SimulatedPlant
from soter.api import load
from soter.api.arguments import chosen_modules
from soter.monitor.identification import (
    FLOOR,
    Identification,
    OpenParameter,
    identified_parameters,
    open_parameters,
)
from soter.monitor.model_membership import judge_run
from soter.verify.problem.extract import problem_of_sets

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from soter.monitor.identification import Episode, Posed

STEPS = 15


class Fitted:
    """A vehicle's program, fitted to its episodes by true states."""

    def __init__(self, plant: SimulatedPlant, folder: Path, most: float = 100.0) -> None:
        (folder / "mass.soter").write_text(plant.program(most), encoding="utf-8")
        self.plant, self.program = plant, load(folder / "mass.soter")
        starts = {"DRAG": (0.5, 10.0), "GAIN": (1.0, 10.0)}
        starts |= {f"PUSH{i}": (0.1, most) for i in range(plant.axes)}
        self.declared = [OpenParameter(n, s, 0.0, m) for n, (s, m) in starts.items()]

    def pose(self, values: Mapping[str, float]) -> Posed:
        flat = self.program.declared(None, dict(values))
        return [(flat, m, problem_of_sets(flat, m)) for m in chosen_modules(flat, None)]

    def fit(self, episodes: int, steps: int = STEPS, **how: Any) -> Identification:
        found = [self.plant.episode(steps, **how) for _ in range(episodes)]
        parameters = open_parameters(self.pose, self.declared, named=True)
        return identified_parameters(self.pose, parameters, found, estimates=False, truths=True)

    def explains(self, values: Mapping[str, float], episode: Episode) -> bool:
        ((flat, module, problem),) = self.pose(values)
        return not judge_run(flat, module, problem, episode.record).alarms


def test_the_fit_finds_what_the_vehicle_is(tmp_path: Path) -> None:
    plant = SimulatedPlant(1, axes=2)
    found = Fitted(plant, tmp_path).fit(10, 40)
    assert found.alarm is None
    assert (found.kept, found.never_excited) == ((), ())
    assert found.steps == 10 * 40
    assert (found.held_out, found.rate) == (5, 1 / 6)
    assert found.values["DRAG"] == pytest.approx(plant.drag, rel=0.1)
    assert found.values["GAIN"] == pytest.approx(plant.gain, rel=0.05)
    pushes = np.array([found.values[f"PUSH{i}"] for i in range(2)])
    assert (pushes > 0.7 * plant.push).all()
    assert (pushes < 1.3 * plant.push).all()


@pytest.mark.long
def test_new_episodes_leave_as_rarely_as_is_said(tmp_path: Path) -> None:
    shares, alone, n = [], [], 3
    for seed in range(40):
        fitted = Fitted(SimulatedPlant(seed), tmp_path)
        found = fitted.fit(2 * n)
        assert found.factor is not None
        unscaled = found.values["PUSH0"] / max(1.0, found.factor) * found.factor
        new = [fitted.plant.episode(STEPS) for _ in range(10)]
        shares.append(np.mean([not fitted.explains(found.values, e) for e in new]))
        held = {**found.values, "PUSH0": unscaled}
        alone.append(np.mean([not fitted.explains(held, e) for e in new]))
    spread = 3 * float(np.std(alone)) / np.sqrt(len(alone))
    assert np.mean(shares) <= 1 / (n + 1) + spread
    assert np.mean(alone) == pytest.approx(1 / (n + 1), abs=spread)


@pytest.mark.long
def test_new_episodes_of_another_draw_leave_more_often(tmp_path: Path) -> None:
    left = []
    for seed in range(8):
        fitted = Fitted(SimulatedPlant(seed), tmp_path)
        found = fitted.fit(6)
        fitted.plant.harder = 2.0
        left += [not fitted.explains(found.values, fitted.plant.episode(STEPS)) for _ in range(10)]
    assert np.mean(left) > 2 * found.rate


def test_a_term_that_the_model_lacks_is_seen_by_what_the_bound_may_be(tmp_path: Path) -> None:
    plant = SimulatedPlant(2, bend=3.0)
    most = 1.5 * float(plant.push[0])
    found = Fitted(plant, tmp_path, most).fit(6, 30)
    assert found.alarm is not None
    assert (found.alarm.module, found.alarm.states) == ("Keeper", ("m.v0",))
    assert found.alarm.at_s > 0
    assert found.alarms > 0
    assert Fitted(replace(plant, bend=0.0), tmp_path, most).fit(6, 30).alarm is None


def test_what_no_log_excites_is_named_and_stays_as_declared(tmp_path: Path) -> None:
    found = Fitted(SimulatedPlant(3), tmp_path).fit(6, force=0.0)
    assert found.alarm is None
    assert found.never_excited == ("force",)
    assert found.kept == ("GAIN",)
    assert set(found.values) == {"DRAG", "PUSH0"}


def test_a_bound_that_no_log_needs_stays_as_declared(tmp_path: Path) -> None:
    plant = SimulatedPlant(4, axes=2)
    plant.push[1] = 0.0
    fitted = Fitted(plant, tmp_path)
    parameters = [p for p in open_parameters(fitted.pose, fitted.declared, named=True) if p.bound]
    exact = {"DRAG": plant.drag, "GAIN": plant.gain}
    episodes = [plant.episode(STEPS) for _ in range(6)]
    found = identified_parameters(
        lambda values: fitted.pose({**exact, **values}),
        parameters,
        episodes,
        estimates=False,
        truths=True,
    )
    assert found.kept == ("PUSH1",)
    assert set(found.values) == {"PUSH0"}
    assert found.factor is not None
    assert found.factor > FLOOR

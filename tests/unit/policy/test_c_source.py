"""A network as C of a node: what it publishes is what the policy's file answers."""

from __future__ import annotations

import math
import re
import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest
from policy_files import FILES  # type: ignore[import-not-found]

import soter
from soter.cli.main import main
from soter.policy.c_source import ACTIVATIONS
from soter.policy.network import ACTIVATIONS as READ

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
topic seen: {seen};
topic speed: float[2];
topic gear: int in [0, 2];
topic u: {u};
plant World period 10ms {{
  drives seen = {of_p};
  drives speed = [4.0 * p, -p];
  drives gear = p > 0.3 ? 2 : p > -0.3 ? 1 : 0;
  state p: float;
  disturbance draw: float in [-1.0, 1.0];
  next p = draw;
}}
extern node Pilot period 10ms from "{source}" {{ subscribes {reads}; publishes u; }}
system S {{ w: World; node Pilot; until 400ms; always gear >= 0; }}
"""
THREE = {"seen": "float[3]", "of_p": "[p, -2.0 * p, p * p]", "reads": "seen"}
GEARS = {"seen": "int[2]", "of_p": "[p > 0.3 ? 2 : p > -0.3 ? 1 : 0, p > 0.0 ? 1 : 0]"}
KINDS: dict[str, dict[str, str]] = {
    "sb3:qrdqn.zip": {**THREE, "u": "int in [0, 2]"},
    "sb3:tqc_sde.zip": {**THREE, "u": "float[2]"},
    "sb3:ppo_sde.zip": {**THREE, "u": "float[2]"},
    "sb3:crossq.zip": {**THREE, "u": "float[2]"},
    "sb3:a2c_of_frames.zip:a2c_vecnormalize.pkl": {**THREE, "u": "float"},
    "sb3:maskable.zip": {**GEARS, "reads": "seen", "u": "int[2]"},
    "sb3:recurrent.zip": {**THREE, "reads": "speed, gear", "u": "float[2]"},
}


def written(folder: Path, source: str, **kind: str) -> soter.Program:
    for path in FILES.glob("*.*"):
        shutil.copy(path, folder)
    (folder / "p.soter").write_text(PROGRAM.format(source=source, **kind), encoding="utf-8")
    return soter.load(folder / "p.soter")


@pytest.mark.parametrize("source", KINDS)
def test_it_publishes_what_the_file_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str
) -> None:
    monkeypatch.chdir(tmp_path)
    program = written(tmp_path, source, **KINDS[source])
    by_file = program.simulate()
    _, name, *statistics = source.split(":")
    options = ["--statistics", *statistics] if statistics else []
    assert main(["policy", name, *options, "--node", "p.soter:Pilot", "-o", "pilot.c"]) == 0
    program.bind("Pilot", "c:pilot.c:Pilot_step")
    for engine in ("native", "interp"):
        by_c = program.simulate(engine=engine)
        assert (by_c.violations, by_c.extern_failures) == (0, {})
        assert by_c.array("u") == pytest.approx(by_file.array("u"), abs=1e-6)
    assert np.ptp(by_file.array("u"), axis=0).max() > 0


def test_a_campaign_flies_it_each_flight_from_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is remembered lies in statics: flight k is the run of its seed all the same."""
    monkeypatch.chdir(tmp_path)
    program = written(tmp_path, "sb3:recurrent.zip", **KINDS["sb3:recurrent.zip"])
    assert main(["policy", "recurrent.zip", "--node", "p.soter:Pilot", "-o", "pilot.c"]) == 0
    program.bind("Pilot", "c:pilot.c:Pilot_step")
    one = program.campaign(flights=1, seed=3, output="one")
    three = program.campaign(flights=3, seed=1, output="three")
    assert three.flights[2].trajectory == one.flights[0].trajectory
    assert three.flights[0].trajectory != three.flights[1].trajectory


@pytest.mark.parametrize("name", ACTIVATIONS)
def test_activations_are_those_of_the_network(name: str) -> None:
    """Python's operators and functions of these names are C's."""
    at = np.linspace(-9.0, 9.0, 37, dtype=np.float32)
    known = {"fmax": max, "fmin": min, "fabs": abs, **vars(math)}
    text = re.sub(r"\(x > 0.0 \? (.*?) : (.*)\)", r"(\1 if x > 0.0 else \2)", ACTIVATIONS[name])
    text = re.sub(r"\(x > 0.0 \? (.*?) : (.*)\)", r"(\1 if x > 0.0 else \2)", text)
    told = [eval(text, {**known, "x": x}) for x in at.tolist()]  # noqa: S307 - our own text
    assert told == pytest.approx(READ[name](at).tolist(), abs=2e-6)


def test_every_activation_that_is_read_is_written() -> None:
    assert set(ACTIVATIONS) == set(READ)

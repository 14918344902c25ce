"""Files of externs that are not there are told before anything is computed, by every command."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

import soter
from soter.gym import make_vec

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Soter = Callable[..., Any]

TANK = """soter 1;
topic level: float;
topic pump: float in [-0.1, 0.1] = 0.0;
plant Tank period 50ms {{
  reads pump; drives level = h; state h: float = 1.0; der h = pump;
}}
extern node Learned period 100ms {source} {{ subscribes level; publishes pump; }}
node Hold period 100ms {{
  subscribes level; publishes pump; step {{ publish pump = clamp(1.0 - level, -0.1, 0.1); }}
}}
{more}
rta SafeTank {{
  ac Learned; sc Hold; period 100ms; safe level > 0.2 && level < 1.8;
  verify {{ grid level in [0.2, 1.8] / 64; }}
}}
system Plant default {{ t: Tank; module SafeTank; until 1s; always t.truth.h < 1.8; }}
system Idle {{ t: Tank; module SafeTank; force SafeTank sc; until 1s; }}
"""


def program(folder: Path, source: str, more: str = "") -> Path:
    path = folder / "tank.soter"
    path.write_text(TANK.format(source=source and f'from "{source}"', more=more))
    return path


@pytest.fixture(autouse=True)
def nothing_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever computes sets is too late."""

    def computed(*_: object) -> None:
        raise AssertionError("sets were computed for a program whose file is not there")

    monkeypatch.setattr("soter.verify.deploy.missing_predicates.complete", computed)


@pytest.mark.parametrize("system", ["Plant", "Idle"])
@pytest.mark.parametrize(
    ("source", "code"),
    [
        ("onnx:absent.onnx", "X003"),
        ("sb3:absent.zip", "X003"),
        ("python:absent.py:step", "X003"),
        ("c:absent.c:step", "X003"),
        ("sb3:tank.soter", "X014"),
        ("", "X001"),
    ],
)
def test_a_run_and_a_campaign_tell_it_first(
    soter: Soter, here: Path, source: str, code: str, system: str
) -> None:
    """Missing, broken, or bound to nothing; also where the module is forced."""
    program(here, source)
    done = soter("run", "tank.soter", "--system", system, "--json")
    assert done.codes == [code]
    assert done.document["diagnostics"][0]["line"] == 7
    done = soter("campaign", "tank.soter", "--flights", "2", "--json", "-o", "fly")
    assert done.codes == [code]


def test_a_package_tells_of_c_that_it_compiles(soter: Soter, here: Path) -> None:
    program(here, "c:absent.c:step")
    done = soter("build", "tank.soter", "--target", "c", "-o", "out", "--json")
    assert done.codes == ["W007", "X003"]


def test_a_proof_tells_of_what_only_runs_need(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It goes on, as it asks no AC: but whoever waits for it has been warned before."""

    def verified(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    program(here, "onnx:absent.onnx")
    monkeypatch.setattr("soter.api.Program.verify", verified)
    assert "warning[W007]" in soter("verify", "tank.soter").err


def test_an_environment_asks_no_file_of_the_controller_that_is_outside(tmp_path: Path) -> None:
    """The agent answers in its place; of another extern the file is asked for first."""
    path = program(tmp_path, "onnx:absent.onnx")
    with pytest.raises(AssertionError, match="sets were computed"):
        make_vec(path, 2)
    more = """
extern node Other period 100ms from "c:absent.c:step" { publishes lamp; }
topic lamp: float;
"""
    path = program(tmp_path, "onnx:absent.onnx", more)
    path.write_text(path.read_text().replace("module SafeTank;", "module SafeTank; node Other;"))
    with pytest.raises(soter.SoterError, match=r"absent\.c"):
        make_vec(path, 2)

"""`soter policy`: what a file says, and the function that it writes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.api import format_text
from soter.policy.sb3_file import read_sb3
from soter.policy.soter_source import error_bound

if TYPE_CHECKING:
    from collections.abc import Callable

    Soter = Callable[..., Any]

FILES = Path(__file__).resolve().parents[1] / "policy" / "files"
PPO = str(FILES / "ppo.zip")
PLAIN = ["--statistics", "none"]


def test_it_tells_what_the_file_says_and_does_not(soter: Soter) -> None:
    document = soter("policy", PPO, "--json").document
    assert document["assumed"] == [
        "observations are normalised by `ppo_vecnormalize.pkl`, found beside it"
    ]
    assert soter("policy", PPO, *PLAIN, "--json").document["assumed"] == []
    document = soter("policy", str(FILES / "sac.zip"), "--json").document
    assert document["assumed"] == [
        "observations are not normalised: no file of a VecNormalize is named or beside it"
    ]
    document = soter("policy", PPO, *PLAIN, "--json").document
    assert document["facts"]["observation"] == "Box of 2: [-1.2, 0.6], [-0.07, 0.07]"
    assert document["facts"]["answer"] == "clipped to the action space"
    assert (document["inputs"], document["outputs"]) == (2, 1)


def test_the_bound_is_that_of_the_box_and_never_told_smaller(soter: Soter) -> None:
    policy = read_sb3(FILES / "ppo.zip", Path("none"))
    assert policy.box is not None
    for size in ([], ["--within", "100"], ["--within", "3,0.5"]):
        document = soter("policy", PPO, *PLAIN, "--json", *size).document
        told = float(document["facts"]["float64"].split()[1])
        assert document["bound"] <= told < 1.02 * document["bound"]
    assert (
        soter("policy", PPO, *PLAIN, "--json").document["bound"]
        == error_bound(policy.network, *policy.box).max()
    )


def test_what_is_written_is_a_file_to_import_laid_out(here: Path, soter: Soter) -> None:
    assert soter("policy", PPO, *PLAIN, "-o", "net.soter").exit == 0
    text = (here / "net.soter").read_text(encoding="utf-8")
    assert format_text("net.soter", text) == text
    assert soter("check", "net.soter").exit == 0
    statistics = ["--statistics", str(FILES / "ppo_vecnormalize.pkl")]
    assert soter("policy", PPO, *statistics, "-o", "net.soter").exit == 0
    assert "MEAN" in (here / "net.soter").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "codes"),
    [
        (["absent.zip"], ["X003"]),
        (["cart.soter"], ["X014"]),
        ([PPO, "--statistics", PPO], ["X014"]),
        ([PPO, "--within", "1,2,3"], ["U003"]),
        ([PPO, "--within", "nan"], ["U003"]),
        (["net.onnx", "--statistics", PPO], ["U003"]),
    ],
)
def test_what_cannot_be_read_is_told(
    here: Path, soter: Soter, words: list[str], codes: list[str]
) -> None:
    assert here.is_dir()
    assert soter("policy", *words, "--json").codes == codes

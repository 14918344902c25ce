"""What `soter verify` writes about a refutation can be run again, and belongs to one program."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from generators.changed_modules import BASES
from soter.cli.main import main
from soter.diagnostics.diagnostic import SoterError
from soter.verify.counterexample import replay_file

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def refuted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[Path, Path]:
    """The program, and the counterexample's file as the command's JSON names it."""
    monkeypatch.chdir(tmp_path)
    program = tmp_path / "tank.soter"
    program.write_text(BASES["tank"].changed("ttf is constant false"))
    assert main(["verify", "tank.soter", "--json"]) == 3
    document = json.loads(capsys.readouterr().out)
    ttf = document["modules"]["SafeTank"]["properties"]["ttf"]
    assert ttf["verdict"] == "refuted"
    assert ttf["counterexample"] == ".soter/tank-SafeTank.counterexample.json"
    return program, tmp_path / ttf["counterexample"]


def test_the_run_of_another_system_stays_beside_it(
    refuted: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    program, file = refuted
    first = file.read_bytes()
    text = program.read_text()
    system = text[text.rindex("system ") :]
    name = system.split()[1]
    program.write_text(
        text
        + system.replace(f"system {name} default", "system Other").replace(
            f"system {name}", "system Other"
        )
    )
    assert main(["verify", "tank.soter", "--system", "Other", "--json"]) == 3
    document = json.loads(capsys.readouterr().out)
    ttf = document["modules"]["SafeTank"]["properties"]["ttf"]
    assert ttf["counterexample"] == ".soter/tank-SafeTank-Other.counterexample.json"
    assert file.read_bytes() == first


def test_a_saved_run_is_found_again_and_leaves_safe(refuted: tuple[Path, Path]) -> None:
    program, file = refuted
    again = replay_file(file)
    assert again is not None
    height = again.steps[-1]["truth"]["t"]["h"]
    assert not 0.0 < height < 4.0
    saved = file.read_text()
    file.write_text(json.dumps(json.loads(saved) | {"instance": "Other"}))
    with pytest.raises(ValueError, match="no module `Other`"):
        replay_file(file)
    file.write_text(saved)
    program.write_text(program.read_text() + "// changed\n")
    with pytest.raises(ValueError, match="another version"):
        replay_file(file)
    program.unlink()
    with pytest.raises(SoterError):
        replay_file(file)

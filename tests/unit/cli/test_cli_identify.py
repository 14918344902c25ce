"""`soter identify`: from logs to a file that a program reads, and what is refused on the way."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import pytest

from generators.simulated_plants import SimulatedPlant
from soter.api import load, recheck
from soter.cli.main import main
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A program, six logs and their mapping."""
    monkeypatch.chdir(tmp_path)
    plant = SimulatedPlant(5, noise=0.02)
    (tmp_path / "mass.soter").write_text(plant.program(), encoding="utf-8")
    (tmp_path / "mass.json").write_text(json.dumps(plant.mapping), encoding="utf-8")
    for i in range(6):
        plant.write(tmp_path / f"{i}.csv", 20)
    return tmp_path


LOGS = tuple(f"{i}.csv" for i in range(6))
HOW = ("--program", "mass.soter", "--map", "mass.json")


def told(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict[str, object]]:
    code = main(["identify", *words, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_a_program_reads_the_fit_and_its_proof_assumes_it(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, document = told(capsys, *LOGS, *HOW, "--report", "page.html")
    assert (code, document["held_out"], document["alarm"]) == (0, 3, None)
    assert "drawn alike leaves with at most 1/4 (25.00%)" in (folder / "page.html").read_text()
    values = document["values"]
    assert isinstance(values, dict)
    assert list(values) == ["DRAG", "GAIN", "PUSH0", "NOISE"]
    text = (folder / "mass.soter").read_text()
    fields = ", ".join(f"{n}: float" for n in values)
    fit = f'type Fit = {{ {fields} }};\nconst FIT: Fit = data "fit.json";\nparam DRAG'
    text = text.replace("param DRAG", fit, 1)
    for name, start in (("DRAG", "0.5"), ("GAIN", "1.0"), ("PUSH0", "0.1"), ("NOISE", "0.05")):
        text = text.replace(f"param {name}: float = {start}", f"param {name}: float = FIT.{name}")
    (folder / "mass.soter").write_text(text)
    again, _ = told(capsys, *LOGS, *HOW, "-o", "again.json")
    assert again == 0
    program = load("mass.soter")
    assert values["DRAG"] == program.constant("FIT").DRAG
    said = program.verify(refute=False, explain=False, cert="proof")
    (module,) = said.modules
    (text_of,) = [a.text for a in module.assumptions if a.key == "identified fit.json"]
    assert "3 held-out episodes; that a new one leaves them with at most 1/4" in text_of
    assert said.verdict == "proved"
    assert any("at most 1/4" in a for a in recheck("proof").assumptions)


def test_the_lines_that_are_printed_are_those_that_the_program_needs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "robot").mkdir()
    program = folder / "robot" / "mass.soter"
    text = (folder / "mass.soter").read_text()
    program.write_text(text)
    code = main(["identify", *LOGS, "--program", "robot/mass.soter", "--map", "mass.json"])
    said = capsys.readouterr().out
    lines = [line.strip() for line in said.partition(" reads it by\n")[2].splitlines() if line]
    assert code == 0
    assert 'const FIT: Fit = data "../fit.json";' in lines
    assert any(line.startswith("param PUSH0: float = FIT.PUSH0 in [0.0, ") for line in lines)
    fitted = tuple(line.partition(" = ")[0] for line in lines if line.startswith("param"))
    rest = [line for line in text.splitlines() if not line.startswith(fitted)]
    program.write_text("\n".join([rest[0], *lines, *rest[1:]]))
    assert load(program).constant("FIT").DRAG > 0


REFUSED = {
    "one episode": (("0.csv", *HOW), "U001"),
    "a log twice": ((*LOGS, "0.csv", *HOW), "U001"),
    "a bound that moves the plant": (
        (*LOGS, "--program", "both.soter", "--map", "mass.json"),
        "U001",
    ),
    "no such parameter": ((*LOGS, *HOW, "--open", "MASS"), "U004"),
    "set and nothing open": (
        (
            *LOGS,
            *HOW,
            *(w for n in ("DRAG", "GAIN", "PUSH0", "NOISE") for w in ("--set", f"{n}=1")),
        ),
        "U001",
    ),
    "a bound of 0": ((*LOGS, *HOW, "--set", "PUSH0=0", "--open", "PUSH0"), "U001"),
    "pieces longer than the logs": ((*LOGS, *HOW, "--episode", "60s"), "U001"),
    "a length of time without a unit": ((*LOGS, *HOW, "--episode", "10"), "U001"),
    "no such log": (("0.csv", "none.csv", *HOW), "D016"),
    "a log that is none": (("0.csv", "mass.soter", *HOW), "D016"),
    "a log of another kind without a mapping": ((*LOGS, "--program", "mass.soter"), "D006"),
    "a command that its set has not": (("0.csv", "far.csv", *HOW), "U001"),
    "a result that would replace another file": ((*LOGS, *HOW, "-o", "mass.json"), "D006"),
}


@all_rows("row", REFUSED.values(), ids=list(REFUSED))
def test_what_cannot_be_fitted_is_refused_with_a_code(
    folder: Path, capsys: pytest.CaptureFixture[str], row: tuple[tuple[str, ...], str]
) -> None:
    (folder / "far.csv").write_text("t,v0,u\n0.0,0.0,5.0\n0.1,0.0,5.0\n0.2,0.0,5.0\n")
    both = (folder / "mass.soter").read_text().replace("[-PUSH0, PUSH0]", "[-GAIN, GAIN]")
    (folder / "both.soter").write_text(both.replace("param PUSH0", "// "))
    words, wanted = row
    code, document = told(capsys, *words)
    diagnostics = document["diagnostics"]
    assert isinstance(diagnostics, list)
    assert code == (2 if wanted.startswith("U") else 1)
    assert wanted in [d["code"] for d in diagnostics], diagnostics
    assert not (folder / "fit.json").exists()


def test_without_scipy_bounds_are_fitted_and_models_are_not(
    folder: Path,  # noqa: ARG001 - where the logs are
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "scipy", None)
    code, document = told(capsys, *LOGS, *HOW)
    assert (code, "pip install" in json.dumps(document)) == (1, True)
    assert "D007" in json.dumps(document)
    bounds = ("--open", "PUSH0", "--open", "NOISE")
    assert told(capsys, *LOGS, *HOW, *bounds)[0] == 0


def test_a_fit_that_does_not_say_how_many_were_held_out_is_no_data(folder: Path) -> None:
    text = 'soter 1;\ntype F = { A: float };\nconst F0: F = data "fit.json";\n'
    (folder / "reads.soter").write_text(text)
    codes = {}
    for facts in ("{}", '{"held_out": 0}', '{"held_out": true}', '{"held_out": 2}', "3"):
        (folder / "fit.json").write_text(f'{{"$identified": {facts}, "A": 1.0}}')
        codes[facts] = [d.code for d in load("reads.soter").diagnostics if d.code == "D004"]
    assert [facts for facts, found in codes.items() if not found] == ['{"held_out": 2}']


def test_what_nothing_explains_ends_with_3_and_the_first_alarm(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (folder / "mass.soter").read_text().replace("in [0.0, 100.0]", "in [0.0, 0.1]")
    (folder / "mass.soter").write_text(text.replace("in [0.0, 1.0]", "in [0.0, 0.05]"))
    assert main(["identify", *LOGS, *HOW, "--open", "PUSH0", "--open", "NOISE"]) == 3
    said = capsys.readouterr().out
    assert "Nothing that the program permits explains" in said
    assert "csv m.v0 of Keeper at " in said
    assert "Look first at the rate of the state that is named" in said
    assert "not fitted" in said
    assert "drawn as the held-out ones" not in said
    assert not (folder / "fit.json").exists()

"""Levels that a program leaves open: one answer for proofs, flights and certificates."""

from __future__ import annotations

import json
import shutil
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st

import soter
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.verify.claims import choose_cells_and_levels as chooser
from soter.verify.claims.choose_cells_and_levels import OF_LEVELS
from soter.verify.deploy import missing_predicates
from soter.verify.problem.extract import extract
from unit.certificate import small_proofs
from unit.verify.diagnosis.tank_modules import TANK, changed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.verify.claims.results import ModuleResult

    Proof = Callable[[str], tuple[ModuleResult, Path]]

LEFT_OUT = (
    ("  ttf level < 0.25 || level > 1.75;\n", ""),
    ("  safer level > 0.4 && level < 1.6;\n", ""),
)
COARSE, FINE = changed(*LEFT_OUT, ("/ 320", "/ 16")), changed(*LEFT_OUT)
HOPPER = """soter 1;
topic apex: float max_age 200ms;
topic thrust: float in [0.0, 0.3] = 0.0;
plant Hopper period 400ms {
  reads thrust;
  drives apex = h;
  state h: float = 0.4;
  disturbance ground: float in [-0.03, 0.03];
  next h = 0.75 * h + thrust + ground;
  measured apex within 0.01;
}
node Policy period 400ms { publishes thrust; step { publish thrust = 0.25; } }
node Hold period 400ms {
  subscribes apex;
  publishes thrust;
  step { publish thrust = clamp(0.1 + 0.5 * (0.4 - apex), 0.0, 0.3); }
}
rta Envelope {
  ac Policy; sc Hold; period 400ms;
  safe apex > 0.15 && apex < 0.8;
  verify { grid apex in [0.15, 0.8] / 130; }
}
system Field { h: Hopper; module Envelope; until 60s; }
"""
OPEN = {"no way back with three": COARSE, "nothing is left of three": HOPPER}
WHY = {
    "no way back with three": "SC keeps no set inside `safer`, nor where SC rests on cells of half "
    "or a quarter of the size, the DM's table as declared",
    "nothing is left of three": "S_1 is empty: AC would never get control",
}
ROBOT = """soter 1;
import "p.soter" as p;
system Vehicle deploys p.Plant {
  external topic p.level every 50ms measured p.level within 0.01;
  external topic p.pump;
  module p.SafeTank;
}
"""


def written(text: str, count: int) -> str:
    """The same program with a number of levels."""
    return text.replace("; }\n}\nsystem", f"; levels {count}; }}\n}}\nsystem")


def verified(folder: Path, text: str) -> ModuleResult:
    """With a certificate beside the program."""
    folder.mkdir(exist_ok=True)
    (folder / "p.soter").write_text(text)
    report = soter.load(folder / "p.soter").verify(cert=folder / "cert", refute=False)
    return report.modules[0]


def manifest_of(folder: Path) -> Any:
    return json.loads((folder / "cert" / "manifest.json").read_text())


def table_of(folder: Path) -> bytes:
    """What the DM of a certificate holds."""
    (table,) = manifest_of(folder)["modules"][0]["tables"]
    return Path(folder, "cert", table["levels"]).read_bytes()


@pytest.fixture(scope="module", autouse=True)
def declared_cells() -> Iterator[None]:
    """Levels alone are chosen: smaller cells would show more of three."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(chooser.CELLS_MAX, "P2b", 0)
        yield


@pytest.fixture(scope="module")
def proof(tmp_path_factory: pytest.TempPathFactory) -> Proof:
    """A proof of a text, and its folder; each once."""

    @cache
    def of(text: str) -> tuple[ModuleResult, Path]:
        folder = tmp_path_factory.mktemp("proof")
        return verified(folder, text), folder

    return of


@pytest.mark.parametrize("name", OPEN)
def test_two_are_chosen_where_three_show_less_and_it_is_said_why(name: str, proof: Proof) -> None:
    result, folder = proof(OPEN[name])
    assert (result.verdict, result.problem.levels) == ("proved", 2)
    assert result.levels_why == WHY[name]
    assert f"levels 2: with 3, as by default, {WHY[name]}" in result.notes
    (three, of_three), (two, of_two) = (proof(written(OPEN[name], n)) for n in (3, 2))
    assert (three.verdict, three.problem.levels, three.levels_why) == ("undecided", 3, "")
    assert {n: (f.verdict, f.text) for n, f in two.findings.items() if n != "DM"} == {
        n: (f.verdict, f.text) for n, f in result.findings.items() if n != "DM"
    }
    assert table_of(folder) == table_of(of_two) != table_of(of_three)


@pytest.mark.parametrize("name", OPEN)
def test_it_is_said_what_fewer_levels_cost_as_flown(name: str, proof: Proof) -> None:
    result, _ = proof(OPEN[name])
    cost = result.levels_cost
    assert cost is not None
    for count, flown in ((3, cost.before), (2, cost.after)):
        _, folder = proof(written(OPEN[name], count))
        (module,) = soter.load(folder / "p.soter").simulate().modules.values()
        assert flown is not None
        assert (flown.takeovers_per_min, flown.ac_share) == (module.switches_to_sc, module.ac_share)
        assert flown.table_bytes > 0
    assert f"fewer levels: {cost}" in result.notes


@pytest.mark.parametrize("known", [True, False], ids=["from the cache", "computed"])
@pytest.mark.parametrize("name", OPEN)
def test_what_is_proved_is_what_flies(
    name: str, known: bool, proof: Proof, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, folder = proof(OPEN[name])
    if known:
        monkeypatch.setattr(missing_predicates, "_compute_sets", lambda *_: pytest.fail("again"))
    else:
        monkeypatch.setattr(missing_predicates, "_cached_sets", lambda *_: None)
    flat = system_of(check_file(str(folder / "p.soter")), None)
    (note,) = missing_predicates.complete(flat)
    assert note.endswith("; with 2 levels, as less is shown with 3")
    (module,) = flat.modules
    assert f"{tuple(table_of(folder))}" in repr(module.symbol.safer)
    assert module.looks == 1, "a margin of two looks would be that of three levels"


@pytest.mark.parametrize("name", OPEN)
def test_a_run_is_that_of_the_number_that_was_chosen(name: str, proof: Proof) -> None:
    traces = [
        soter.load(proof(text)[1] / "p.soter").simulate().trace_sha256
        for text in (OPEN[name], written(OPEN[name], 2), written(OPEN[name], 3))
    ]
    assert traces[0] == traces[1] != traces[2]


def test_where_three_do_nothing_is_chosen_said_or_certified(proof: Proof) -> None:
    result, folder = proof(FINE)
    assert (result.verdict, result.problem.levels, result.levels_why) == ("proved", 3, "")
    assert not any("level" in note for note in result.notes)
    assert "levels" not in manifest_of(folder)["modules"][0]


CLAIMS = st.frozensets(st.sampled_from(["P2a", "ttf", "safer", "P2b", "start"]))


@given(CLAIMS, CLAIMS, st.booleans())
def test_fewer_are_chosen_just_where_they_show_more(
    three: frozenset[str], two: frozenset[str], is_open: bool
) -> None:
    """Claim by claim; the start is none of levels, and without K there is no choice."""
    problem: Any = levels_problem(is_open)
    of_levels = frozenset(OF_LEVELS)
    failing = {3: three, 2: two}
    with patch.object(chooser, "_cases_with_other_levels", lambda *_: None):
        chosen = chooser.choose_cells_and_levels(
            problem, lambda p: [cases_that_fail(failing[p.levels])]
        )
    more = two & of_levels < three & of_levels
    fewer = is_open and more and "P2a" not in three | two
    assert chosen.problem.levels == (2 if fewer else 3)
    assert bool(chosen.why) == fewer


@cache
def levels_problem(is_open: bool) -> Any:
    """A problem of three levels."""
    flat = system_of(check_file("p.soter", FINE if is_open else written(FINE, 3)), None)
    problem = extract(flat, flat.modules[0])
    assert problem.levels_open == is_open
    return problem


def cases_that_fail(claims: frozenset[str]) -> Any:
    failures = [SimpleNamespace(claim=c, text=f"{c} fails", proof=None) for c in sorted(claims)]
    return SimpleNamespace(
        failures=failures, failures_of=lambda claim: [f for f in failures if f.claim == claim]
    )


# ---------------------------------------------------------------- certificates


@pytest.fixture(scope="module")
def proved(proof: Proof) -> Path:
    """A program with two levels chosen, its certificate, and a robot that deploys it."""
    _, folder = proof(COARSE)
    (folder / "robot.soter").write_text(ROBOT)
    return folder


def test_the_certificate_says_the_number_and_is_accepted(proved: Path) -> None:
    assert manifest_of(proved)["modules"][0]["levels"] == 2
    assert soter.recheck(proved / "cert").accepted


def refused(folder: Path, forge: Callable[[dict[str, Any]], None]) -> str:
    """Why a certificate with another entry is not accepted."""
    manifest = manifest_of(folder)
    forge(manifest["modules"][0])
    small_proofs.reseal(folder / "cert", manifest)
    report = soter.recheck(folder / "cert")
    assert not report.accepted
    return report.reason


@pytest.mark.parametrize("said", [3, 4, 1, 0, True, 2.0, "2", None])
def test_another_number_than_that_of_its_sets_is_rejected(
    said: object, proved: Path, tmp_path: Path
) -> None:
    shutil.copytree(proved / "cert", tmp_path / "cert")
    reason = refused(tmp_path, lambda entry: entry.update(levels=said))
    assert reason == (
        "the tables S are not as many as the levels ask for"
        if said in (3, 4) and said is not True
        else "`levels` is not as it should be"
    )


def test_the_number_of_no_certificate_is_the_default(proved: Path, tmp_path: Path) -> None:
    shutil.copytree(proved / "cert", tmp_path / "cert")
    reason = refused(tmp_path, lambda entry: entry.pop("levels"))
    assert reason == "the tables S are not as many as the levels ask for"


@pytest.mark.parametrize("text", [written(FINE, 3), TANK], ids=["number", "predicates"])
def test_what_the_program_says_is_not_said_otherwise(
    text: str, proof: Proof, tmp_path: Path
) -> None:
    result, folder = proof(text)
    assert result.verdict == "proved"
    shutil.copytree(folder / "cert", tmp_path / "cert")
    reason = refused(tmp_path, lambda entry: entry.update(levels=2))
    assert reason == "the number of levels is another one in the program"


def test_a_build_has_the_tables_of_the_certificate(proved: Path, tmp_path: Path) -> None:
    program = soter.load(proved / "robot.soter")
    made = program.build("c", tmp_path / "out", cert=proved / "cert")
    assert "checked again" in made.inherits[0]
    code = " ".join(" ".join(f.read_text() for f in (tmp_path / "out").glob("*.c")).split())
    assert ", ".join(map(str, table_of(proved))) in code


def test_a_build_refuses_tables_with_another_number_of_levels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are as right as others, and not those that every other command flies."""
    monkeypatch.setattr(missing_predicates, "_store_sets", lambda *_: None)
    monkeypatch.setattr(chooser, "LEVELS_DEFAULT", 2)
    assert verified(tmp_path, FINE).problem.levels == 2
    monkeypatch.undo()
    (tmp_path / "robot.soter").write_text(ROBOT)
    assert soter.recheck(tmp_path / "cert").accepted
    with pytest.raises(SoterError, match="is built with other tables than it has"):
        soter.load(tmp_path / "robot.soter").build("c", tmp_path / "out", cert=tmp_path / "cert")
    assert verified(tmp_path, FINE).problem.levels == 3
    soter.load(tmp_path / "robot.soter").build("c", tmp_path / "out", cert=tmp_path / "cert")

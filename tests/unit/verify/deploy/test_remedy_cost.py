"""What an advised change costs: the figures of `soter run`, of the program as it is and changed."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import pytest

import soter
from soter.cli.main import main
from soter.verify.claims.choose_cells_and_levels import CELLS_MAX
from soter.verify.diagnosis import tried_remedies
from unit.verify.diagnosis.tank_modules import TANK, changed

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import FlownFigures, RemedyCost

PREDICATES = (
    ("  ttf level < 0.25 || level > 1.75;\n", ""),
    ("  safer level > 0.4 && level < 1.6;\n", ""),
)
COARSE = (*PREDICATES, ("/ 320;", "/ 16; levels 3;"))
FINER = ("/ 16;", "/ 32;")
OLD, YOUNG = ("max_age 100ms", "max_age 4s"), ("max_age 4s", "max_age 100ms")
BOLD = ("ttf level < 0.25 || level > 1.75", "ttf level < 0.21 || level > 1.79")
EXTERN = "extern node Learned period 100ms { subscribes level; publishes pump; }"
LEARNED = EXTERN.replace("extern ", "").replace("pump; }", "pump; step { publish pump = 0.1; } }")


@pytest.fixture(autouse=True)
def declared_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    """Smaller cells are advised, not chosen."""
    monkeypatch.setitem(CELLS_MAX, "P2b", 0)


def cost_of(path: Path, text: str) -> RemedyCost:
    """What the one advice that proves all of it costs."""
    path.write_text(text)
    (module,) = soter.load(path).verify(refute=False, explain=True, budget_s=0.0).modules
    (cost,) = [f.cost for f in module.findings.values() if f.cost is not None]
    return cost


def check_flown(flown: FlownFigures | None, path: Path, text: str) -> None:
    """They are those of a run."""
    path.write_text(text)
    run = soter.load(path).simulate()
    (module,) = run.modules.values()
    assert flown is not None
    assert flown.takeovers_per_min == module.switches_to_sc / (run.duration_s / 60.0)
    assert flown.ac_share == module.ac_share
    assert module.switches_to_sc > 0


@pytest.mark.parametrize(
    ("start", "remedies"),
    [
        (COARSE, (FINER,)),
        ((OLD,), (YOUNG,)),
        ((BOLD,), tuple((new, "") for new in (f"  {BOLD[1]};\n", PREDICATES[1][0]))),
        ((OLD, BOLD), (YOUNG, (f"  {BOLD[1]};\n", ""), PREDICATES[1])),
    ],
    ids=["more cells", "younger reads", "predicates left out", "two of them"],
)
def test_the_figures_are_those_of_runs(
    tmp_path: Path, start: tuple[tuple[str, str], ...], remedies: tuple[tuple[str, str], ...]
) -> None:
    path = tmp_path / "tank.soter"
    text = changed(*start)
    cost = cost_of(path, text)
    assert (cost.system, cost.until_s, cost.not_measured) == ("Plant", 60.0, "")
    check_flown(cost.before, path, text)
    check_flown(cost.after, path, changed(*remedies, text=text))


def test_a_run_is_as_long_as_so_many_periods_of_the_dm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """60 s are no more than a few decisions of a DM that decides every few minutes."""
    longer = changed(OLD, ("until 60s", "until 24h"))
    monkeypatch.setattr(tried_remedies, "PERIODS", 1000)
    assert cost_of(tmp_path / "tank.soter", longer).until_s == 100.0
    assert cost_of(tmp_path / "tank.soter", changed(OLD)).until_s == 60.0


def test_tables_have_their_bytes(tmp_path: Path) -> None:
    """Four cells a byte, and breakpoints; none where predicates are written."""
    cost = cost_of(tmp_path / "tank.soter", changed(*COARSE))
    assert cost.before is not None
    assert cost.after is not None
    assert (cost.before.table_bytes, cost.after.table_bytes) == (4 + 17 * 8, 8 + 33 * 8)
    written = cost_of(tmp_path / "tank.soter", changed(OLD))
    assert written.after is not None
    assert written.after.table_bytes == 0


@pytest.mark.parametrize(
    ("pair", "why"),
    [
        ((LEARNED, EXTERN), "`verify` asks no externs, and system `Plant` has `SafeTank.Learned`"),
        ((" until 60s;", ""), "system `Plant` says no `until`"),
    ],
)
def test_where_nothing_can_be_run_it_says_so(
    tmp_path: Path, pair: tuple[str, str], why: str
) -> None:
    cost = cost_of(tmp_path / "tank.soter", changed(*COARSE, pair))
    assert (cost.not_measured, cost.before, cost.after) == (why, None, None)


def test_a_second_instance_of_the_module_is_not_guessed(tmp_path: Path) -> None:
    """What is written of the module changes both, and one was tried."""
    fleet = "system Fleet default { a: Plant; b: Plant; until 60s; }\n"
    (tmp_path / "tank.soter").write_text(changed(*COARSE) + fleet)
    modules = (
        soter.load(tmp_path / "tank.soter").verify(refute=False, explain=True, budget_s=0.0).modules
    )
    costs = [f.cost for m in modules for f in m.findings.values() if f.cost is not None]
    why = "the module stands 2 times in system `Fleet`, and one was tried"
    assert [cost.not_measured for cost in costs] == [why, why]


def test_beside_another_module_only_the_one_is_changed(tmp_path: Path) -> None:
    path = tmp_path / "tank.soter"
    body = changed(*COARSE).partition("system")[0]
    again = re.sub(r"\b(level|pump|Tank|Learned|Hold|SafeTank)\b", r"\1_b", body)
    again = again.replace("soter 1;", "").replace("t.h", "u.h")
    both = body + again + "system Two { t: Tank; module SafeTank; u: Tank_b; module SafeTank_b; "
    both += "until 60s; }\n"
    path.write_text(both)
    first = soter.load(path).verify("SafeTank", refute=False, explain=True, budget_s=0.0).modules[0]
    (cost,) = [f.cost for f in first.findings.values() if f.cost is not None]
    path.write_text(both.replace(*FINER, 1))
    run = soter.load(path).simulate()
    assert cost.after is not None
    assert cost.after.takeovers_per_min == run.modules["SafeTank"].switches_to_sc
    assert cost.after.ac_share == run.modules["SafeTank"].ac_share
    assert cost.after != cost.before


def test_what_takes_too_long_is_not_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tried_remedies, "CPU_S", 0.0)
    cost = cost_of(tmp_path / "tank.soter", changed(OLD))
    assert "take more than 0 s of CPU time" in cost.not_measured


def test_text_and_document_say_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "tank.soter"
    path.write_text(changed(*COARSE))
    main(["verify", str(path), "--budget", "0"])
    (line,) = [t for t in capsys.readouterr().out.splitlines() if t.startswith("  costs  ")]
    main(["verify", str(path), "--budget", "0", "--json"])
    found: Any = json.loads(capsys.readouterr().out)["modules"]["SafeTank"]["properties"]
    cost = found["P2b"]["cost"]
    assert f"with it {cost['after']['takeovers_per_min']:.4g} takeovers a minute" in line
    assert line.startswith("  costs  60 s of Plant simulated, seed 1: before ")
    assert found["P2a"]["cost"] is None


def test_what_is_proved_or_not_mended_costs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "tank.soter"
    path.write_text(TANK)
    (module,) = soter.load(path).verify().modules
    assert all(f.cost is None for f in module.findings.values())

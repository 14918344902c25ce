"""Certificates of modules of which no set was found: checked for what they do claim.

Where K is empty a DM with computed predicates has no table, and nothing that is claimed rests on
one.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

import soter
from soter.api import recheck
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

ONE = """soter 1;
topic seen: { x: float, v: float } max_age 20ms;
topic push: float in [-1.0, 1.0] = 0.0;
topic heat: float max_age 20ms;
plant Cart period 10ms {
  reads push; drives seen = { x: x, v: v };
  state x: float = 0.0; state v: float = 0.0;
  der x = v; der v = push;
}
plant Oven period 10ms {
  drives heat = t; state t: float = 1.0; disturbance w: float in [0.2, 0.4];
  der t = w - 0.5 * t;
}
node Any period 20ms { publishes push; step { publish push = 1.0; } }
node Off period 20ms { subscribes seen; publishes push; step { publish push = LAW; } }
rta M {
  ac Any; sc Off; period 20ms;
  safe abs(seen.x) < 1.0;
  verify { METHOD }
}
system S default { c: Cart; module M; until 10s; }
"""
GRID = "grid seen.x in [-1.0, 1.0] / 16, seen.v in [-1.0, 1.0] / 16;"
TWO = "grid seen.x in [-1.0, 1.0] / 16, seen.v in [-1.0, 1.0] / 16; grid heat in [0.0, 2.0] / 16;"
PROGRAMS = {
    "a grid": ONE.replace("LAW", "0.0").replace("METHOD", GRID),
    "a shield": ONE.replace("LAW", "0.0")
    .replace("METHOD", f"{GRID} levels 2;")
    .replace("ac Any", "shield 4; ac Any"),
    "one of two groups": ONE.replace("LAW", "0.0")
    .replace("METHOD", TWO)
    .replace("c: Cart;", "c: Cart; o: Oven;")
    .replace("safe abs(seen.x) < 1.0;", "safe abs(seen.x) < 1.0 && heat < 3.0;"),
}


def certificate(tmp_path: Path, program: str) -> Path:
    path = tmp_path / "nothing.soter"
    path.write_text(program)
    report = soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    assert report.modules[0].findings["P2a"].verdict == "undecided"
    return tmp_path / "cert"


LONG = "one of two groups"


@pytest.mark.parametrize(
    "which",
    [*(n for n in PROGRAMS if n != LONG), pytest.param(LONG, marks=pytest.mark.long)],
)
def test_what_is_claimed_without_a_table_is_confirmed(tmp_path: Path, which: str) -> None:
    folder = certificate(tmp_path, PROGRAMS[which])
    assert json.loads((folder / "manifest.json").read_text())["modules"][0]["tables"] == []
    report = recheck(folder)
    assert report.accepted, report.reason
    assert not report.safe
    assert report.modules[0].confirmed == ["P1a", "P1b"]


def claims(*names: str) -> Callable[[dict[str, Any]], None]:
    return lambda entry: entry["claims"].update(dict.fromkeys(names, "proved"))


FORGERIES: dict[str, Callable[[dict[str, Any]], None]] = {
    "P1c": claims("P1c"),
    "P2a": claims("P2a"),
    "ttf": claims("ttf"),
    "safer": claims("safer"),
    "P2b": claims("P2b"),
    "start": claims("start"),
    "all": claims("P2a", "P3", "ttf", "safer", "start", "P2b"),
    "no tables at all": lambda entry: entry.pop("tables"),
    "a table of nothing": lambda entry: entry["tables"].append({"axes": [], "levels": "sets/x"}),
}


@pytest.mark.parametrize("which", FORGERIES)
def test_what_rests_on_a_table_is_rejected_without_one(tmp_path: Path, which: str) -> None:
    folder = certificate(tmp_path, PROGRAMS["a grid"])
    manifest = json.loads((folder / "manifest.json").read_text())
    FORGERIES[which](manifest["modules"][0])
    small_proofs.seal(folder, manifest)
    assert not recheck(folder).accepted


def test_where_no_k_was_found_it_is_said_that_no_state_of_it_was_drawn(tmp_path: Path) -> None:
    safe = "safe abs(seen.x) < 1.0;"
    written = f"{safe} ttf abs(seen.x) > 0.5; safer abs(seen.x) < 0.2;"
    report = recheck(certificate(tmp_path, PROGRAMS["a grid"].replace(safe, written)))
    assert report.accepted, report.reason
    assert report.modules[0].unseen == "no state of K was drawn"

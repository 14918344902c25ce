"""Attacks on shields: no way on which a command acts that was not judged (docs/evidence.md).

Purpose: every command that AC gets through is permitted together with what may still act, by a
reader of the tests' own; the same in deployed C; no step of a controller lasts; the explorer knows
that a step below a shield reads the time; a DM that forgets commands too soon is refuted.
Non-goals: hostile runs and tables (`test_shield.py`), the theorem (docs/proof-flight.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import processes
import soter
from correct.test_shield import COMMANDS, SMALL, tables_of, written
from generators.c_packages import make
from soter.core.steps import lower
from soter.explore.model.footprints import Footprints
from soter.language.front_end import check_file, system_of_test
from soter.language.model.typed import Literal
from soter.language.model.types import BOOL
from soter.native.compiler import MEANING, find_compiler
from soter.native.shared_library import CHECK_FAILED
from soter.verify.deploy import missing_predicates, shield_tables
from soter.verify.deploy.missing_predicates import complete
from soter.verify.grid import estimate_sets
from soter.verify.problem.inputs import errors_by_state

if TYPE_CHECKING:
    from pathlib import Path

WINDOW_NS = 21_000_000
"""A + L: in a run each command is published at its release."""
LAST_MOMENT = (
    "publish accel = motion.x + motion.v > 5.0 ? (sin(120.0 * time) > 0.0 ? A : -A) : 0.5;"
)
VEHICLE = """
system Vehicle deploys Track {
  external topic motion every 5ms measured motion.x within 0.02, motion.v within 0.05;
  external topic accel;
  module Shielded;
}
"""
shields_between = estimate_sets.engine_with_command_in
LOOP = """#include "Vehicle_firmware.h"
#include <stdio.h>
static Vehicle self;
int main(void) {
  long long now = 0;
  shield_Motion m;
  double accel = 0.0;
  if (Vehicle_start(&self, 0) != NULL) { return 1; }
  while (scanf("%lld %la %la", &now, &m.x, &m.v) == 3) {
    if (Vehicle_publish_motion(&self, &m, now, now) != 0) { return 2; }
    (void)Vehicle_step(&self, now);
    (void)Vehicle_read_accel(&self, &accel, NULL);
    printf("%a\\n", accel);
  }
  return 0;
}
"""


@pytest.mark.parametrize("step", ["publish accel = A;", COMMANDS["to and fro"], LAST_MOMENT])
def test_what_ac_gets_through_is_permitted_when_it_does(step: str, tmp_path: Path) -> None:
    program = soter.load(written(tmp_path, step))
    tables = tables_of(program)
    run = program.simulate(system="Track", seed=5, until="12s")
    trace = run.require_trace()
    at_ns = trace["header"]["ct"].astype(np.int64)
    accel, x, v = run.array("accel"), run.array("motion.x"), run.array("motion.v")
    mode = trace["modules"]["mode"][:, 0]
    edges = [np.array(e) for e in tables.edges]
    checked = 0
    for k in np.flatnonzero(mode[1:] & (accel[1:] != accel[:-1])) + 1:
        recent = accel[max(0, np.searchsorted(at_ns, at_ns[k] - WINDOW_NS, "right") - 1) : k + 1]
        cells = np.clip(np.floor((recent + 3.0) / 6.0 * 8), 0, 7).astype(int)
        where = tuple(
            int(np.searchsorted(e, value)) - 1 for e, value in zip(edges, (x[k], v[k]), strict=True)
        )
        assert tables.commands.tops[where][cells.min()] > cells.max(), (at_ns[k], recent)
        checked += 1
    assert checked
    if step != COMMANDS["to and fro"]:
        assert run.modules["Shielded"].gate_faults


@pytest.mark.parametrize("cells", [1, 15, 16, 64])
def test_both_engines_remember_all_cells(cells: int, tmp_path: Path) -> None:
    """Times of many cells are a large value, which lies where the storage plan of a step says."""
    path = tmp_path / "cells.soter"
    path.write_text(SMALL.replace("shield 4", f"shield {cells}").replace("sin(5.0 * time)", "1.0"))
    program = soter.load(path)
    runs = [program.simulate(seed=4, until="4s", engine=e) for e in ("interp", "native")]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert runs[1].modules["Keep"].gate_faults


def test_deployed_c_judges_as_the_simulator_does(tmp_path: Path) -> None:
    path = written(tmp_path, LAST_MOMENT)
    path.write_text(path.read_text("utf-8") + VEHICLE, "utf-8")
    program = soter.load(path)
    run = program.simulate(system="Track", seed=5, until="12s")
    at_ns = run.require_trace()["header"]["ct"].astype(np.int64)
    program.build("c", tmp_path / "c", "Vehicle")
    done = make(tmp_path / "c", "lib")
    assert done.returncode == 0, done.stderr
    (tmp_path / "loop.c").write_text(LOOP)
    own, parts = tmp_path / "loop", [str(tmp_path / "loop.c"), str(tmp_path / "c" / "libshield.a")]
    parts.insert(1, str(CHECK_FAILED))
    words = [
        *find_compiler().command,
        "-std=c99",
        *MEANING,
        f"-I{tmp_path / 'c'}",
        *parts,
        "-lm",
        "-o",
    ]
    done = processes.run([*words, str(own)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    readings = zip(at_ns, run.array("motion.x"), run.array("motion.v"), strict=True)
    lines = [f"{t} {float(x).hex()} {float(v).hex()}" for t, x, v in readings]
    (tmp_path / "readings").write_text("\n".join(lines))
    with (tmp_path / "readings").open() as readings_of_run:
        told = processes.run([str(own)], stdin=readings_of_run, capture_output=True, text=True)
    assert told.returncode == 0
    assert [float.fromhex(x) for x in told.stdout.split()] == run.array("accel").tolist()
    assert run.modules["Shielded"].gate_faults


def test_no_sc_below_a_shield_overruns(tmp_path: Path) -> None:
    """What counts later was judged too soon, and nobody remembers it."""
    test = "test T { system S; overrun Keep.Back by 1ms; horizon 1s; always at < 3.0; }"
    (tmp_path / "late.soter").write_text(SMALL + test)
    assert "M027" in {d.code for d in check_file(str(tmp_path / "late.soter")).diagnostics.items}


def test_the_explorer_knows_that_a_shielded_step_depends_on_the_time(tmp_path: Path) -> None:
    path = tmp_path / "timed.soter"
    path.write_text(
        SMALL.replace("publish speed = sin(5.0 * time);", "publish speed = choose { -1.0, 1.0 };")
        + "test T { system S; horizon 100ms; always at < 3.0; }"
    )
    flat = system_of_test(check_file(str(path)), "T")
    complete(flat)
    footprints = Footprints(flat, lower(flat))
    assert {
        c.role: footprints.actor_effects(c.index, None).timed
        for c in flat.components
        if c.role in {"ac", "sc"}
    } == {"ac": True, "sc": True}


@pytest.mark.parametrize("short_ns", [2_000_000, 32_000_000])
def test_a_dm_that_forgets_commands_too_soon_is_refuted(
    short_ns: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "small.soter").write_text(SMALL)
    monkeypatch.setattr(shield_tables, "SLACK_NS", -short_ns)
    report = soter.load(tmp_path / "small.soter").verify(refute=False)
    assert report["Keep"].findings["DM"].verdict == "refuted"


def test_command_cells_that_lie_elsewhere_are_refuted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    edges = shield_tables.command_edges

    def moved(low: float, high: float, cells: int) -> tuple[float, ...]:
        return tuple(e + 0.01 for e in edges(low, high, cells))

    (tmp_path / "small.soter").write_text(SMALL)
    monkeypatch.setattr(shield_tables, "command_edges", moved)
    report = soter.load(tmp_path / "small.soter").verify(refute=False)
    assert report["Keep"].findings["DM"].verdict == "refuted"


class Hopeful:
    """A group of which a prover with a slip in it asks."""

    def __init__(self, group: Any, *, shorter: int = 1) -> None:
        self.group, self.shorter = group, shorter

    def cells_safe_for(self, horizon: Any, core: Any) -> Any:
        return self.group.cells_safe_for(horizon // self.shorter, core)


def too_short(engine: Any, control: int, low: float, high: float) -> Any:
    """H is a third of what it has to be."""
    return Hopeful(shields_between(engine, control, low, high), shorter=3)


def a_cell_lower(engine: Any, control: int, low: float, high: float) -> Any:
    """Cells of commands that lie one further down."""
    return shields_between(engine, control, max(low - 0.5, -1.0), high - 0.5)


@pytest.mark.whole
@pytest.mark.parametrize("slip", [too_short, a_cell_lower])
def test_what_a_slip_in_the_prover_permits_is_rejected(
    slip: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "small.soter").write_text(SMALL)
    monkeypatch.setattr(estimate_sets, "engine_with_command_in", slip)
    soter.load(tmp_path / "small.soter").verify(cert=tmp_path / "cert", refute=False)
    assert not soter.recheck(tmp_path / "cert").accepted


def test_a_table_that_forgets_errors_of_estimates_is_rejected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "small.soter").write_text(SMALL.replace("within 0.01", "within 0.05"))
    monkeypatch.setattr(
        estimate_sets,
        "errors_by_state",
        lambda problem: dict.fromkeys(errors_by_state(problem), 0.0),
    )
    soter.load(tmp_path / "small.soter").verify(cert=tmp_path / "cert", refute=False)
    assert not soter.recheck(tmp_path / "cert").accepted


def test_a_silent_dm_is_refuted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its step does not look at what is held: only commands that are published are judged."""
    expressions = shield_tables.shield_expressions

    def silent(problem: Any, *rest: Any) -> Any:
        held, permits, ttf = expressions(problem, *rest)
        return held, permits, Literal(BOOL, ttf.span, False)

    (tmp_path / "small.soter").write_text(SMALL)
    monkeypatch.setattr(missing_predicates, "shield_expressions", silent)
    report = soter.load(tmp_path / "small.soter").verify(refute=False)
    assert report["Keep"].findings["DM"].verdict == "refuted"

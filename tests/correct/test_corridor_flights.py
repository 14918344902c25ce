"""The drone in corridors of boxes: proved a wall at a time, flown, and broken where it must be."""

from __future__ import annotations

import shutil
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from long_tests import examples
from soter.api import load
from soter.certificate.grid import grid_group
from soter.certificate.grid.group_claims import ChainCheck
from soter.certificate.rechecker import recheck
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.front_end import check_file, system_of
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import assumption_texts
from soter.verify.verify_module import verify_module

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.certificate.cell_sets import Block, Grid
    from soter.certificate.grid.grid_group import Task
    from soter.language.model.typed import TypedProgram
    from soter.verify.claims.results import VerifyReport

    Show = Callable[[Block], Iterator[Block]]

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
BLOCKS = examples(15)
"""Of nine cells, of each claim of each view."""
WALLS = ("east", "west", "north", "south", "above", "below")


@cache
def corridor() -> TypedProgram:
    """Checked when a test asks for it: each worker reads this file as it collects."""
    program = check_file(str(DRONE / "corridor.soter")).program
    assert program is not None
    return program


def consts(*names: str) -> tuple[float, ...]:
    return tuple(float(corridor().consts[n].value) for n in names)


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, VerifyReport]:
    folder = tmp_path_factory.mktemp("corridors") / "cert"
    return folder, load(DRONE / "corridor.soter").verify(refute=False, cert=folder)


@pytest.mark.parametrize("wall", WALLS)
def test_the_motion_primitive_is_proved_for_every_corridor(wall: str) -> None:
    flat = system_of(check_file(str(DRONE / "corridor.soter")), None, {}, exact=False)
    views = systems_by_view(flat, flat.modules[0])
    seen = {module.view: (system, module) for system, module in views}
    assert tuple(seen) == WALLS
    result = verify_module(extract(*seen[wall]), refute=False)
    assert result.verdict == "proved"
    assert any(
        "jumps into" in a or "jumps while" in a for a in assumption_texts(result.assumptions)
    ), "that boxes change is an assumption"


@pytest.mark.long
def test_the_re_checker_confirms_samples_of_every_view(
    proved: tuple[Path, VerifyReport], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every claim, on blocks drawn at random; no cell has to be halved (all: bench/recheck)."""
    draw = np.random.default_rng(2)
    asked = []

    def some(what: str, grid: Grid, show: Show, *_rest: object) -> Iterator[Task]:
        asked.append(what)
        for _ in range(BLOCKS):
            low = [int(draw.integers(n)) for n in grid.shape]
            at = tuple((a, min(a + 3, n)) for a, n in zip(low, grid.shape, strict=True))
            yield partial(grid_group._failure_in_block, what, grid, show, at), 1.0

    monkeypatch.setattr(grid_group, "block_tasks", some)
    monkeypatch.setattr(ChainCheck, "leads_in_parts", lambda *_: False)
    report = recheck(proved[0])
    assert report.accepted, report.reason
    assert [m.name.rpartition(" ")[2] for m in report.modules] == list(WALLS)
    assert all("P2b" in m.confirmed for m in report.modules)
    assert len(asked) == 6 * len(WALLS)
    for module in report.modules:
        (shown,) = module.shown
        assert shown.key.endswith(" flown")
        (jumps,) = [a.text for a in module.assumptions if a.key.startswith("jumps ")]
        assert jumps.startswith("where iris.reference change,"), "only that is left to assume"


def room(wall: np.ndarray, tau: float, u: float, b: float, tail: float, fastest: float) -> bool:
    """`Fits` of corridor.soter, written once more."""
    e_q, e_v, d = consts("E_Q", "E_V", "D")
    faster = float(wall["toward"]) + e_v
    later = max(faster + (u + d) * tau, 0.0)
    need = max((faster + 0.5 * (u + d) * tau) * tau, 0.0) + later**2 / (2 * b) + tail
    slow = float(wall["toward"]) - e_v - (u + d) * tau
    return bool(float(wall["ahead"]) - e_q >= need and later <= fastest and slow >= -fastest)


@pytest.mark.parametrize(
    ("file", "system"),
    [("corridor.soter", "Protected"), ("corridor_adversaries.soter", "Failing")],
)
def test_a_box_is_entered_inside_of_its_s0_only(file: str, system: str) -> None:
    run = load(DRONE / file).simulate(system, until=90.0, seed=3)
    assert run.violations == 0
    assert run.trace is not None
    named = run.trace["topics"]
    topics = {n.rsplit(".", 1)[-1]: named[n] for n in named.dtype.names or ()}
    box = np.array(topics["flown"]["block"]["high"].tolist())
    changes = np.flatnonzero((np.diff(box, axis=0) != 0.0).any(axis=1)) + 1
    assert len(changes) >= 5
    for i in changes:
        for name in WALLS:
            more = "_UP" if name in ("above", "below") else ""
            limits = consts(*(n + more for n in ("U", "B", "TAIL", "W")))
            assert room(topics[name][i], 0.03, *limits), (i, name)


@pytest.mark.long
def test_a_box_that_is_entered_anywhere_is_left(tmp_path: Path) -> None:
    """What is assumed of `Follower` is needed."""
    folder = tmp_path / "drone"
    shutil.copytree(DRONE, folder, ignore=shutil.ignore_patterns("__pycache__", ".soter"))
    path = folder / "corridor.soter"
    text = path.read_text(encoding="utf-8")
    guard = "if MayEnter(blocks[at + 1], m) {"
    assert guard in text
    path.write_text(
        text.replace(guard, "if boxes.Contains(blocks[at + 1], m.p) {"), encoding="utf-8"
    )
    runs = [
        load(folder / "corridor_adversaries.soter").simulate(name, until=300.0, seed=1, trace=False)
        for name in ("Ramming", "Pushing", "Jerking", "Failing")
    ]
    assert sum(run.violations for run in runs) > 0

"""Sets of equal modules are computed once, whatever the systems of the file that have them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

import soter
from soter.verify.deploy import missing_predicates

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
param TOP: float = 1.0 in [0.5, 1.5];
topic pos: float in [-50.0, 50.0] max_age 20ms;
topic vel: float in [-TOP, TOP] = 0.0;
plant Cart period 10ms { reads vel; drives pos = x; state x: float; der x = vel; }
node Fast period 10ms { publishes vel; step { publish vel = TOP; } }
node Stop period 10ms { publishes vel; step { publish vel = 0.0; } }
rta Guard {
  ac Fast;
  sc Stop;
  period 50ms;
  safe abs(pos) < 10.0;
  LAW
  verify { grid pos in [-10.0, 10.0] / 40; recover never; }
}
system Guarded default { c: Cart; module Guard; until 1s; always abs(c.truth.x) < 10.0; }
system Unguarded { c: Cart; module Guard; force Guard ac; until 2s; }
system Slow { c: Cart; module Guard; force Guard sc; until 3s; always c.truth.x < 99.0; }
system Vehicle deploys Guarded {
  external topic pos every 10ms measured pos within 0.0;
  external topic vel;
  module Guard;
}
"""


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The modules whose sets were computed, and not found in the cache."""
    modules: list[str] = []
    compute = missing_predicates._compute_sets

    def remembered(problem: Any, *rest: Any) -> Any:
        modules.append(problem.name)
        return compute(problem, *rest)

    monkeypatch.setattr(missing_predicates, "_compute_sets", remembered)
    kept: dict[str, Any] = {}
    monkeypatch.setattr(missing_predicates, "_cached_sets", lambda key, _: kept.get(key))
    monkeypatch.setattr(
        missing_predicates, "_store_sets", lambda key, *sets: kept.update({key: sets})
    )
    return modules


@pytest.mark.parametrize("law", ["", "failsafe vel = 0.0;"])
def test_every_system_of_a_file_has_the_same_sets(
    law: str, computed: list[str], tmp_path: Path
) -> None:
    file = tmp_path / "cart.soter"
    file.write_text(PROGRAM.replace("LAW", law), encoding="utf-8")
    program = soter.load(file)
    shares = {name: missing_predicates.complete(program.declared(name)) for name in program.systems}
    assert len(shares) == 4
    assert len({tuple(notes) for notes in shares.values()}) == 1
    assert computed == ["Guard"]


def test_every_target_takes_the_same_sets(computed: list[str], tmp_path: Path) -> None:
    file = tmp_path / "cart.soter"
    file.write_text(PROGRAM.replace("LAW", "failsafe vel = 0.0;"), encoding="utf-8")
    program = soter.load(file)
    for target, system, board in (
        ("c", "Guarded", None),
        ("posix", "Vehicle", None),
        ("cortex-m", "Guarded", "mps2-an500"),
    ):
        program.build(target, tmp_path / target, system, board=board)
    assert computed == ["Guard"]


def test_other_starts_may_have_other_sets(computed: list[str], tmp_path: Path) -> None:
    """K is made smaller for P2b only where the start stays in it; a law is linear about a start."""
    file = tmp_path / "cart.soter"
    text = PROGRAM.replace("LAW", "").replace("state x: float;", "state x: float = FROM;")
    text = text.replace("param TOP", "param FROM: float = 0.0 in [0.0, 2.0];\nparam TOP")
    file.write_text(text, encoding="utf-8")
    program = soter.load(file)
    for start in (0.0, 1.0, 0.0):
        missing_predicates.complete(program.declared("Guarded", {"FROM": start}))
    assert computed == ["Guard", "Guard"]


def test_other_numbers_are_other_sets(computed: list[str], tmp_path: Path) -> None:
    file = tmp_path / "cart.soter"
    file.write_text(PROGRAM.replace("LAW", ""), encoding="utf-8")
    program = soter.load(file)
    for top in (1.0, 0.5, 1.0):
        missing_predicates.complete(program.declared("Guarded", {"TOP": top}))
    assert computed == ["Guard", "Guard"]


def test_a_robot_that_deploys_the_proved_system_is_not_called_unprovable(tmp_path: Path) -> None:
    file = tmp_path / "cart.soter"
    file.write_text(PROGRAM.replace("LAW", ""), encoding="utf-8")
    rest = soter.load(file).verify(refute=False).coverage.rest
    (said,) = (line for line in rest if "Vehicle" in line)
    inherits = "it deploys Guarded, `soter build --cert` says what it inherits"
    assert said == f"Guard in system Vehicle: {inherits}"

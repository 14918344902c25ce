"""The programs of `examples/rest`: rest and start of each are proved, and it flies unharmed."""

from __future__ import annotations

from pathlib import Path

import pytest

from generators.file_listing import files_in
from soter.api import Program
from soter.language.front_end import check_file

ROOT = Path(__file__).resolve().parents[4]
EVERY = files_in(ROOT / "examples" / "rest", "*.soter")
QUICK = ("docking", "hills")


@pytest.mark.parametrize("path", EVERY, ids=lambda p: p.stem)
def test_a_program_with_rest_gets_no_diagnostics(path: Path) -> None:
    assert [d.message for d in check_file(str(path)).diagnostics.items] == []


@pytest.mark.parametrize(
    "path",
    [p if p.stem in QUICK else pytest.param(p, marks=pytest.mark.long) for p in EVERY],
    ids=lambda p: p.stem,
)
def test_rest_and_the_start_are_proved_and_an_honest_ac_flies(path: Path) -> None:
    program = Program(str(path))
    (module,) = program.verify(refute=False).modules
    assert module.verdict == "assumed"
    assert (module.findings["P2a"].verdict, module.findings["start"].verdict) == (
        "proved",
        "proved",
    )
    run = program.simulate(until="20s", seed=3)
    assert run.violations == 0
    assert all(m.ac_share > 0.8 for m in run.modules.values())

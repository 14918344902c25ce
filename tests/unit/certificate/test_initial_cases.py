"""Of which values of the parameters the start is asked: those with which a run may begin."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from bench.recheck.small_modules import PROGRAMS

from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("state", "values"),
    [
        ("state k: int in [1, 3] = 2;", {(1,): False, (2,): True, (3,): False}),
        ("state k: bool = true;", {(0,): False, (1,): True}),
        ("state k: bool = false;", {(0,): True, (1,): False}),
    ],
)
def test_a_run_begins_with_the_declared_value(
    tmp_path: Path, state: str, values: dict[tuple[int, ...], bool]
) -> None:
    path = tmp_path / "small.soter"
    path.write_text(PROGRAMS["written"].replace("disturbance w", f"{state}\n  disturbance w", 1))
    facts = small_proofs.facts_of(path, "S", "M")
    assert [p.name.split(".")[-1] for p in facts.parameters] == ["k"]
    (parameter,) = facts.parameters
    assert {v: v[0] in parameter.begins for v in facts.parameter_combinations()} == values

"""Schedules of which no claim is true as it is read here: what is refused of them, by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from bench.recheck.small_modules import PROGRAMS

from soter.certificate.terms.terms import NotRecheckedError
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.reading.module_facts import Facts

Pairs = tuple[tuple[str, str], ...]


def facts_of(folder: Path, text: str, *pairs: tuple[str, str]) -> Facts:
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    (folder / "small.soter").write_text(text)
    return small_proofs.facts_of(folder / "small.soter", "S", "M")


# ---------------------------------------------------------------- maps

BEHIND = """plant World period 50ms {
  reads u;
  drives x = q;
  state q: float in [-0.1, 0.1];
  next q = q + 0.1 * u;
}
node Fast"""
WORLD = (
    ("node Fast", BEHIND),
    ("verify {", "verify {\n    abstracts w by p: P = { p: w.truth.q };"),
    ("{ p: P; module M;", "{ w: World; module M;"),
)
"""Behind the map of the proof flies another one."""


@pytest.mark.parametrize(
    "behind", [(), WORLD, (*WORLD, ("World period 50ms", "World period 25ms"))]
)
def test_a_map_that_is_read_when_it_steps_is_rechecked(tmp_path: Path, behind: Pairs) -> None:
    assert facts_of(tmp_path, PROGRAMS["steps"], *behind).own.age == 0


@pytest.mark.parametrize(
    ("pairs", "why"),
    [
        ((("verify {", "verify {\n    dropout 50ms;"),), "`dropout` beside a map"),
        ((("verify {", "verify {\n    dropout 1us;"),), "`dropout` beside a map"),
        ((*WORLD, ("verify {", "verify {\n    dropout 50ms;")), "`dropout` beside a map"),
        ((("node Slow period 50ms", "node Slow period 50ms phase 10ms"),), "step together"),
        ((*WORLD, ("World period 50ms", "World period 100ms")), "`w` does not publish whenever"),
        ((*WORLD, ("World period 50ms", "World period 30ms")), "`w` does not publish whenever"),
        ((*WORLD, ("World period 50ms", "World period 10ms")), "shorter than its period"),
        ((("max_age 20ms", "max_age 50ms"),), "shorter than its period"),
        ((("verify {", "verify {\n    acts within 1ms;"),), "delays beside a map"),
        ((("verify {", "verify {\n    late sc 1ms;"),), "delays beside a map"),
    ],
)  # fmt: skip
def test_what_is_read_and_acts_beside_a_map_is_of_one_instant(
    tmp_path: Path, pairs: Pairs, why: str
) -> None:
    with pytest.raises(NotRecheckedError, match=why):
        facts_of(tmp_path, PROGRAMS["steps"], *pairs)

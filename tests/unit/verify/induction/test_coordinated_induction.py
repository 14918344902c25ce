"""The mode of another module in what is proved by induction: any of two values at every step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from generators.mode_reading_modules import BACK_OF_Y, PLAN_AND, PLAN_OR, PLANS, changed
from soter.api import load
from soter.certificate.rechecker import recheck
from soter.diagnostics.diagnostic import SoterError
from soter.language.model import typed
from soter.language.model.tree_walk import rewritten
from soter.language.model.types import MODE
from soter.verify.problem import verification_system
from soter.verify.problem.problem import assumption_texts

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import ModuleResult

pytest.importorskip("z3")

SAFETY = ("P2a", "P3", "ttf", "safer", "start", "DM")
HOVER = "step { publish candidate = Plan.Hover; }"
FLIES_ON = (
    HOVER,
    (
        "step { if mode(KeepY) == Mode.SC { publish candidate = Plan.Around; } "
        "else { publish candidate = Plan.Hover; } }"
    ),
)
SILENT = (HOVER, "step { if mode(KeepY) == Mode.AC { publish candidate = Plan.Hover; } }")
FAULTS = (HOVER, "step { assert mode(KeepY) == Mode.AC; publish candidate = Plan.Hover; }")
OWN = ("verify { induction; }", "verify { induction; lemma mode(SafePlanner) != Mode.AC || true; }")
HOLDS_BACK = (
    "if age(candidate) > seconds(SETTLED) {",
    "if mode(KeepY) == Mode.AC && age(candidate) > seconds(SETTLED) {",
)


def verified(folder: Path, *changes: tuple[str, str]) -> ModuleResult:
    path = folder / "plans.soter"
    path.write_text(changed(PLANS, *changes))
    return load(path).verify("SafePlanner", str(folder / "cert"), refute=False)["SafePlanner"]


@pytest.mark.parametrize(
    ("changes", "waits"),
    [
        ([PLAN_OR], False),
        ([PLAN_AND], True),
        ([FLIES_ON], False),
        ([PLAN_OR, PLAN_AND, FLIES_ON], True),
        ([PLAN_OR, OWN], False),
    ],
    ids=["ttf", "safer", "SC", "all", "and its own"],
)
def test_looking_at_a_mode_is_proved_and_rechecked(
    tmp_path: Path, changes: list[tuple[str, str]], waits: bool
) -> None:
    module_result = verified(tmp_path, *changes)
    assert {p: module_result.findings[p].verdict for p in SAFETY} == dict.fromkeys(SAFETY, "proved")
    back = module_result.findings["P2b"]
    assert back.verdict == ("assumed" if waits else "proved")
    assert back.text.endswith(" while KeepY is in AC: not proved") == waits
    assert (
        any(
            "for P2b alone: KeepY is in AC" in a
            for a in assumption_texts(module_result.assumptions)
        )
        == waits
    )
    checked = recheck(tmp_path / "cert")
    assert checked.accepted, checked.reason
    (module,) = checked.modules
    assert ("P2b" in module.confirmed) == (not waits)
    assert {*SAFETY} - {"DM"} <= set(module.confirmed)
    assert any(a.key == "mode KeepY" for a in module.assumptions)


@pytest.mark.parametrize(
    "changes",
    [
        [("ttf !PhiPlan(candidate);", PLAN_OR[1].replace("||", "&&"))],
        [SILENT],
        [FAULTS],
    ],
    ids=["ttf and a mode", "SC says nothing", "SC faults"],
)
def test_what_needs_to_know_the_mode_is_not_proved(
    tmp_path: Path, changes: list[tuple[str, str]]
) -> None:
    module_result = verified(tmp_path, *changes)
    assert module_result.findings["P2a"].verdict == "undecided"
    assert module_result.findings["P3"].verdict == "undecided"


def test_a_node_that_looks_at_another_mode_may_publish_anything(tmp_path: Path) -> None:
    with pytest.raises(SoterError) as caught:
        verified(tmp_path, ("safe PhiPlan(inForce);", "safe mode(KeepY) == Mode.AC;"))
    assert [d.code for d in caught.value.diagnostics] == ["R030"]
    module_result = verified(tmp_path, HOLDS_BACK)
    assert module_result.findings["P2a"].verdict == "undecided"  # what it publishes is not followed


@pytest.mark.long
def test_waiting_for_one_that_waits_gives_no_control_back(tmp_path: Path) -> None:
    circle = (BACK_OF_Y[0], BACK_OF_Y[1].replace("KeepX", "SafePlanner"))
    module_result = verified(tmp_path, PLAN_AND, circle)
    assert module_result.findings["P2a"].verdict == "proved"
    assert module_result.findings["P2b"].verdict == "undecided"
    assert "each may wait for the other for ever" in module_result.findings["P2b"].text
    assert "P2b" not in recheck(tmp_path / "cert").modules[0].confirmed


def _only_ac(code: object, names: object) -> object:
    """A prover that takes every other module to be in AC, wherever its mode is read."""
    del names

    def instead(part: object) -> object:
        if isinstance(part, typed.ModeRead):
            return typed.Literal(MODE, part.span, verification_system.AC)
        return part

    return rewritten(code, instead)


@pytest.mark.parametrize("change", [SILENT, FAULTS], ids=["SC says nothing", "SC faults"])
def test_a_prover_that_thinks_it_knows_the_mode_is_found_out(
    tmp_path: Path, change: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for cached in (verification_system._module_with_topics, verification_system._node_with_topics):
        cached.cache_clear()
    monkeypatch.setattr(verification_system, "_code_with_topics_for_reads", _only_ac)
    module_result = verified(tmp_path, change)
    for cached in (verification_system._module_with_topics, verification_system._node_with_topics):
        cached.cache_clear()
    assert module_result.findings["P2a"].verdict == "proved"
    checked = recheck(tmp_path / "cert")
    assert not checked.accepted
    assert "something fails in an execution" in checked.reason

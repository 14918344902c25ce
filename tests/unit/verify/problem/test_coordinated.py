"""Modules that look at each other's modes: what is proved of them, and what never may be."""

from __future__ import annotations

import random
from contextlib import nullcontext
from typing import TYPE_CHECKING

import numpy as np
import pytest

from generators.mode_reading_modules import (
    ALONG,
    AND,
    BACK_OF_Y,
    GRID,
    LAW,
    OR,
    SAFER,
    SLOWER,
    TAKEN_OF_Y,
    TTF,
    TURN,
    changed,
)
from soter.api import load
from soter.certificate.extras import sc_locals_and_modes
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.supported_constructs import require_supported
from soter.certificate.rechecker import recheck
from soter.certificate.report import NotRecheckedError
from soter.diagnostics.diagnostic import SoterError
from soter.language.model import typed
from soter.language.model.tree_walk import rewritten
from soter.language.model.types import MODE
from soter.verify.problem import verification_system
from soter.verify.problem.problem import assumption_texts
from soter.verify.scope import composed_assumptions_of
from tables import all_rows
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.report import Report
    from soter.verify.claims.results import ModuleResult, VerifyReport

SAFETY = ("P2a", "P3", "ttf", "safer", "start", "DM")
HEARD = (
    "node SlowX",
    (
        "topic brake: float in [0.5, 1.0] = 1.0;\n"
        "node Brake period 50ms { publishes brake; "
        "step { publish brake = mode(KeepY) == Mode.SC ? 0.5 : 1.0; } }\nnode SlowX"
    ),
)
BRAKED = [
    HEARD,
    ("subscribes x; publishes u;", "subscribes x, brake; publishes u;"),
    (LAW, "clamp(-2.0 * x, -brake, brake)"),
    ("module KeepX;", "module KeepX; node Brake;"),
]
AC_LOOKS = (
    "node FastX period 20ms { publishes u; step { publish u = 1.0; } }",
    (
        "node FastX period 20ms { publishes u; "
        "step { publish u = mode(KeepY) == Mode.AC ? 1.0 : mode(KeepX) == Mode.AC ? 0.5 : 0.1; } }"
    ),
)
IN_A_BRANCH = (
    "publish u = " + LAW + ";",
    (
        "var most = 1.0; if mode(KeepY) == Mode.SC { most = 0.5; } "
        "publish u = clamp(-2.0 * x, -most, most);"
    ),
)


def verified(
    folder: Path, *changes: tuple[str, str], text: str = GRID, module: str | None = "KeepX"
) -> VerifyReport:
    path = folder / "two.soter"
    path.write_text(changed(text, *changes))
    return load(path).verify(module, str(folder / "cert"), refute=False)


def of_x(folder: Path, *changes: tuple[str, str]) -> ModuleResult:
    return verified(folder, *changes)["KeepX"]


def rechecked(folder: Path) -> Report:
    return recheck(folder / "cert")


@pytest.mark.parametrize(
    ("changes", "waits"),
    [
        ([OR], False),
        ([AND], True),
        ([SLOWER], False),
        ([IN_A_BRANCH], False),
        ([OR, AND, SLOWER], True),
        (BRAKED, False),
        ([AC_LOOKS], False),
        ([TAKEN_OF_Y], False),
    ],
    ids=["ttf", "safer", "SC", "in a branch", "all", "a third node", "AC", "the other one"],
)
def test_looking_at_a_mode_is_proved_and_rechecked(
    tmp_path: Path, changes: list[tuple[str, str]], waits: bool
) -> None:
    module_result = of_x(tmp_path, *changes)
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
    checked = rechecked(tmp_path)
    assert checked.accepted, checked.reason
    (module,) = checked.modules
    confirmed = {*SAFETY, "P2b"} - {"DM", *(["P2b"] if waits else [])}
    assert confirmed <= set(module.confirmed)
    assert ("P2b" in module.confirmed) == (not waits)
    looks = any(pair in changes for pair in (OR, AND, SLOWER, IN_A_BRANCH))
    assert any(a.key == "mode KeepY" for a in module.assumptions) == looks
    assert any(a.key == "waits KeepY" for a in module.assumptions) == waits


@pytest.mark.long
def test_what_is_taken_for_granted_stands_in_the_table(tmp_path: Path) -> None:
    report = verified(tmp_path, OR, AND, module=None)
    rows = {(t.module, t.what): (t.why, t.open) for t in composed_assumptions_of(report)}
    told = rows["KeepX", "mode(KeepY) is SC or AC"]
    assert told == ("enforced: the DM of KeepY", False)
    assert rows["KeepX", "for P2b alone: KeepY in AC"] == ("assumed of KeepY", True)
    assert report["KeepY"].findings["P2b"].verdict == "proved"


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ([(TTF, OR[1].replace("||", "&&"))], "ttf"),
        ([(SAFER, AND[1].replace("&&", "||"))], "safer"),
        ([(TTF, "ttf abs(x) > (mode(KeepY) == Mode.SC ? 1.99 : 1.6);")], "ttf"),
        ([(SAFER, "safer abs(x) < (mode(KeepY) == Mode.SC ? 1.99 : 1.3);")], "safer"),
        ([(TTF, "ttf mode(KeepY) == Mode.SC;")], "ttf"),
        ([(LAW, f"mode(KeepY) == Mode.SC ? 0.2 : {LAW}")], "P2a"),
        ([(LAW, f"mode(KeepY) == Mode.AC ? 0.2 : {LAW}")], "P2a"),
        ([(LAW, f"mode(KeepY) == Mode.SC ? -1.2 : {LAW}")], "P2a"),
    ],
    ids=[
        "ttf and a mode",
        "safer or a mode",
        "a wider ttf",
        "a wider safer",
        "a mode alone",
        "SC lets go in SC",
        "SC lets go in AC",
        "SC leaves its set",
    ],
)
def test_what_needs_to_know_the_mode_is_not_proved(
    tmp_path: Path, changes: list[tuple[str, str]], wrong: str
) -> None:
    module_result = of_x(tmp_path, *changes)
    assert module_result.findings[wrong].verdict == "undecided"
    assert module_result.findings["P3"].verdict == "undecided"
    assert module_result.verdict == "undecided"


@pytest.mark.long
def test_two_laws_that_keep_safe_do_not_when_they_take_turns(tmp_path: Path) -> None:
    def core(which: str) -> str:
        module_result = verified(tmp_path, ("WHICH", which), text=TURN, module="KeepZ")["KeepZ"]
        return module_result.findings["P2a"].verdict

    assert core("true") == "proved"
    assert core("false") == "proved"
    assert core("mode(KeepY) == Mode.SC") == "undecided"


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ([AND, BACK_OF_Y], "each may wait for the other for ever"),
        ([AND, TAKEN_OF_Y], "each may wait for the other for ever"),
        ([AND, ("system S {", "system S { force KeepY sc;")], "KeepY is forced to SC"),
    ],
    ids=["both wait", "waits for whom it takes along", "one that never is"],
)
def test_waiting_for_one_that_waits_gives_no_control_back(
    tmp_path: Path, changes: list[tuple[str, str]], why: str
) -> None:
    module_result = of_x(tmp_path, *changes)
    assert module_result.findings["P2b"].verdict == "undecided"
    assert why in module_result.findings["P2b"].text
    assert any(why in a for a in assumption_texts(module_result.assumptions))
    assert all(module_result.findings[p].verdict == "proved" for p in SAFETY)
    assert "P2b" not in rechecked(tmp_path).modules[0].confirmed


def test_both_that_wait_for_each_other_are_told(tmp_path: Path) -> None:
    report = verified(tmp_path, AND, BACK_OF_Y, module=None)
    for name in ("KeepX", "KeepY"):
        assert report[name].findings["P2b"].verdict == "undecided"
        assert report[name].findings["P2a"].verdict == "proved"


def test_two_that_wait_for_each_other_stay_in_sc(tmp_path: Path) -> None:
    path = tmp_path / "two.soter"
    path.write_text(changed(GRID, AND, BACK_OF_Y))
    run = load(path).simulate(until=5.0)
    assert not run.mode("KeepX").any()
    assert not run.mode("KeepY").any()
    path.write_text(changed(GRID, AND))
    run = load(path).simulate(until=5.0)
    assert run.mode("KeepX").any()


@pytest.mark.parametrize("before", [True, False], ids=["one instant early", "at once"])
def test_a_proved_pair_never_leaves_whichever_dm_is_first(tmp_path: Path, before: bool) -> None:
    both = "module KeepX; module KeepY;" if before else "module KeepY; module KeepX;"
    path = tmp_path / "two.soter"
    path.write_text(changed(GRID, OR, AND, SLOWER, ("module KeepX; module KeepY;", both)))
    run = load(path).simulate(until=20.0)
    assert not run.violations
    x, y = (run.mode(name)[::2] == 1 for name in ("KeepX", "KeepY"))  # where DMs look
    assert x.any()
    assert not y[5:].all()
    assert (x[1:] & ~y[1:]).any() == before  # AC has control although Y went to SC just now
    seen = y[:-1] if before else y[1:]
    assert not (x[1:] & ~seen).any()


@pytest.mark.parametrize("before", [True, False], ids=["one instant early", "at once"])
def test_one_who_must_come_along_comes_too_late_or_not_and_is_never_counted_on(
    tmp_path: Path, before: bool
) -> None:
    """SC of X alone is too weak: while it has control Y must be in SC, from that instant on."""
    first, then = ("Y", "X") if before else ("X", "Y")
    text = ALONG.replace("FIRST", f"module Keep{first}; module Keep{then};")
    path = tmp_path / "two.soter"
    path.write_text(text)
    run = load(path).simulate(until=10.0)
    assert (run.violations > 0) == before
    report = load(path).verify(refute=False)
    assert report["KeepX"].verdict == "undecided"
    assert report["KeepX"].findings["P2a"].verdict == "undecided"
    assert report["KeepY"].findings["P2a"].verdict == "proved"


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (("abs(x) < 2.0;", "abs(x) < 2.0 && mode(KeepY) == Mode.AC;"), "`safe`"),
        ((TTF, "ttf abs(x) > 1.6 || mode(KeepX) == Mode.SC;"), "`ttf`"),
        ((LAW, f"mode(KeepX) == Mode.SC ? {LAW} : 0.0"), "the safe controller `SlowX`"),
    ],
    ids=["safe", "ttf of its own", "SC of its own"],
)
def test_other_places_are_refused(tmp_path: Path, change: tuple[str, str], where: str) -> None:
    with pytest.raises(SoterError) as caught:
        verified(tmp_path, change)
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code == "R007"
    assert diagnostic.message == f"{where} reads `mode(...)`, which a proof cannot follow"
    assert "`safe` has to hold in all of them" in diagnostic.notes[0]


def test_no_hint_and_no_map_of_a_view_can_ask_for_a_mode(tmp_path: Path) -> None:
    with pytest.raises(SoterError) as caught:
        verified(tmp_path, ("verify { grid x", "verify { core mode(KeepY) == Mode.SC; grid x"))
    assert [d.code for d in caught.value.diagnostics] == ["T013"]


# ---------------------------------------------------------------- the re-checker by itself


def _only_sc(code: object, names: object) -> object:
    """A prover that takes every other module to be in SC, wherever its mode is read."""
    del names

    def instead(part: object) -> object:
        if isinstance(part, typed.ModeRead):
            return typed.Literal(MODE, part.span, verification_system.SC)
        return part

    return rewritten(code, instead)


@pytest.mark.parametrize(
    "changes",
    [
        [(TTF, "ttf abs(x) > (mode(KeepY) == Mode.SC ? 1.6 : 1.99);")],
        [(SAFER, "safer abs(x) < (mode(KeepY) == Mode.SC ? 1.3 : 1.99);")],
        [(LAW, f"mode(KeepY) == Mode.AC ? 0.2 : {LAW}")],
    ],
    ids=["ttf", "safer", "SC"],
)
def test_a_prover_that_thinks_it_knows_the_mode_is_found_out(
    tmp_path: Path, changes: list[tuple[str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    for cached in (verification_system._module_with_topics, verification_system._node_with_topics):
        cached.cache_clear()
    monkeypatch.setattr(verification_system, "_code_with_topics_for_reads", _only_sc)
    module_result = of_x(tmp_path, *changes)
    for cached in (verification_system._module_with_topics, verification_system._node_with_topics):
        cached.cache_clear()
    assert module_result.findings["P3"].verdict == module_result.findings["P2a"].verdict == "proved"
    checked = rechecked(tmp_path)
    assert not checked.accepted
    assert checked.reason


@all_rows(
    ("change", "most", "why"),
    [
        (SLOWER, 1, ""),
        (SLOWER, 0, "SC looks at the modes of more than 0 modules"),
        (OR, 0, ""),
        (("safe abs(x) <", "safe mode(KeepY) == Mode.SC || abs(x) <"), 1, "another predicate"),
    ],
)
def test_a_mode_is_read_in_few_places_and_of_few_modules(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    change: tuple[str, str],
    most: int,
    why: str,
) -> None:
    """Who is in which mode may change at any time: `safe` would, too."""
    monkeypatch.setattr(sc_locals_and_modes, "MODES_MAX", most)
    (tmp_path / "two.soter").write_text(changed(GRID, change))
    facts = small_proofs.facts_of(tmp_path / "two.soter", "S", "KeepX")
    model = CaseModel(facts, (), tuple(facts.axes[i] for i in range(len(facts.states))))
    with pytest.raises(NotRecheckedError, match=why) if why else nullcontext():
        require_supported(facts)
        model.sc_commands(*model.new_terms())


@pytest.mark.long
def test_a_step_on_defaults_is_tried_in_every_mode(tmp_path: Path) -> None:
    text = """soter 1;
topic x: float in [-4.0, 4.0] max_age 20ms;
topic seen: float in [-4.0, 9.0] = 9.0 max_age 20ms;
topic u: float in [-1.0, 1.0];
type Own = { p: float };
plant X period 10ms { reads u; drives x = p; state p: float; der p = u; }
plant M period 10ms { reads u; drives seen = p; state p: float; der p = u; }
node Est period 10ms { subscribes x; publishes seen; step { publish seen = x; } }
node FastX period 20ms { publishes u; step { publish u = 1.0; } }
node SlowX period 20ms {
  subscribes seen; publishes u;
  step {
    let safe = mode(KeepY) == Mode.SC;
    publish u = safe ? clamp(-2.0 * seen, -1.0, 1.0) : clamp(18.0 * seen / (DIVISOR), -1.0, 1.0);
  }
}
rta KeepX {
  ac FastX; sc SlowX; period 20ms;
  safe abs(seen) < 2.0; ttf abs(seen) > 1.2; safer abs(seen) < 1.0;
  verify { abstracts a by m: M = { p: a.truth.p }; grid m.p in [-2.0, 2.0] / 200; }
}
"""
    text = text + GRID.partition("topic u: float in [-1.0, 1.0];\n")[2].partition("plant X")[0]
    text += "system S { a: X; b: Y; node Est; module KeepY; module KeepX; until 2s; }\n"

    def start(divisor: str) -> tuple[str, str]:
        module_result = verified(tmp_path, ("DIVISOR", divisor), text=text)["KeepX"]
        assert module_result.findings["P2a"].verdict == "proved"
        return module_result.findings["start"].verdict, module_result.findings["start"].text

    assert start("seen - 10.0")[0] == "proved"
    verdict, why = start("seen - 9.0")
    assert verdict == "undecided"
    assert "SC faults on the defaults" in why


@pytest.mark.long
def test_an_adversary_who_chooses_the_mode_never_leaves_what_was_proved(tmp_path: Path) -> None:
    """Pairs of laws, drawn: from cells of K he switches as he likes, and mostly to do harm."""
    chance = random.Random(3)  # noqa: S311 - test points
    seen = {"proved": 0, "undecided": 0}
    for _ in range(6):
        drawn = [chance.choice((-1, 1)) * chance.uniform(0.2, 1.2) for _ in range(4)]
        laws = [(round(drawn[0], 2), round(drawn[1], 2)), (round(drawn[2], 2), round(drawn[3], 2))]
        text = TURN.replace("long ? 1.8 : 0.45", f"long ? {laws[0][0]} : {laws[1][0]}")
        text = text.replace("long ? -0.45 : -1.8", f"long ? {laws[0][1]} : {laws[1][1]}")
        which = ("WHICH", "mode(KeepY) == Mode.SC")
        module_result = verified(tmp_path, which, text=text, module="KeepZ")["KeepZ"]
        verdict = module_result.findings["P2a"].verdict
        seen[verdict] += 1
        if verdict == "proved":
            (sets,) = module_result.cases[0].groups
            for _ in range(200):
                cell = chance.choice([tuple(c) for c in np.argwhere(sets.core > 0)])
                start = [
                    chance.uniform(e[i], e[i + 1]) for e, i in zip(sets.edges, cell, strict=True)
                ]
                _drive(chance, start, laws)
    assert min(seen.values()) > 0, seen


def _drive(chance: random.Random, start: list[float], laws: list[tuple[float, float]]) -> None:
    """200 steps; greedy for a while, then at random."""
    p, q = start
    for k in range(200):
        assert abs(p) < 1.95
        assert abs(q) < 1.95
        after = [(min(max(a * q, -2.0), 2.0), min(max(b * p, -2.0), 2.0)) for a, b in laws]
        p, q = chance.choice(after) if k % 3 == 0 else max(after, key=lambda z: max(map(abs, z)))

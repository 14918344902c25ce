"""The state of a view jumps only into R(H): confirmed, or an assumption with the reason."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING, Any

import pytest

from generators.handover_program import CHANGES, GUARD, GUARDS, IN, handover, of_walls
from soter.api.program import load
from soter.certificate.case_check import CaseCheck
from soter.certificate.cell_sets import Cells
from soter.certificate.extras.handovers import jumps_by_plant
from soter.certificate.reading.module_facts import DiffersError
from soter.certificate.reading.problem import read_facts
from soter.certificate.rechecker import recheck
from soter.certificate.report import NotRecheckedError
from soter.cli.main import main
from soter.language.front_end import check_file, system_of
from unit.certificate.small_proofs import edit_program

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.report import Report

pytest.importorskip("z3")
pytest.importorskip("flint")

Proved = tuple["Path", "Report", list[Any]]
VIEWS = ("left", "right")


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> Proved:
    """A certificate of the two boxes, its report, and what the hand-overs were asked with."""
    folder = tmp_path_factory.mktemp("boxes")
    (folder / "boxes.soter").write_text(of_walls())
    load(folder / "boxes.soter").verify(refute=False, cert=folder / "cert")
    asked: list[Any] = []

    def noted(*given: Any) -> Any:
        asked.append(given)
        return jumps_by_plant(*given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("soter.certificate.extras.handovers.jumps_by_plant", noted)
        patch.setattr("os.cpu_count", lambda: 1)
        report = recheck(folder / "cert")
    return folder / "cert", report, asked


def facts_of(tmp_path: Path, text: str) -> list[Facts]:
    """Of each view; NotRecheckedError where a program is not understood."""
    path = tmp_path / "boxes.soter"
    path.write_text(text)
    checked = check_file(str(path))
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None, {}, exact=False)
    return [read_facts(flat, "Keep", view) for view in VIEWS]


def whys(tmp_path: Path, text: str, proved: Proved) -> list[str]:
    """Of each view: why its jumps are not confirmed, with the sets of another program.

    They are those of this one: neither `enters` nor the node is in them.
    """
    reasons = []
    for facts, (other, groups, claims) in zip(facts_of(tmp_path, text), proved[2], strict=True):
        facts.times, facts.extents = other.times, other.extents
        (jumps,) = jumps_by_plant(facts, groups, claims).values()
        (jump,) = jumps
        reasons.append(jump.why)
    return reasons


# ---------------------------------------------------------------- confirmed


def test_a_node_that_asks_and_a_guard_that_keeps_to_r_are_confirmed(proved: Proved) -> None:
    report = proved[1]
    assert report.accepted, report.reason
    assert len(report.modules) == len(VIEWS)
    for module in report.modules:
        (shown,) = module.shown
        assert shown.key == "enters seen box"
        assert "the state lies in R(H)" in shown.text
        assert not any(a.key.startswith("jumps ") for a in module.assumptions)


def test_the_command_says_what_was_confirmed(
    proved: Proved, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("soter.cli.recheck.recheck", lambda *_: proved[1])
    main(["recheck", str(proved[0])])
    assert capsys.readouterr().out.count("confirmed: Estimator changes") == len(VIEWS)
    main(["recheck", str(proved[0]), "--json"])
    document = json.loads(capsys.readouterr().out)
    for module in document["modules"].values():
        assert [s["key"] for s in module["shown"]] == ["enters seen box"]
    assert not any(k.startswith("jumps ") for k in document["assumption_keys"])


def test_a_node_that_does_not_ask_is_accepted_and_assumed_to(
    proved: Proved, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An assumption is no claim: nothing is rejected for it. (The claims are those of before.)"""
    monkeypatch.setattr(CaseCheck, "show_claims", lambda _: None)
    folder = tmp_path / "cert"
    shutil.copytree(proved[0], folder)
    edit_program(folder, (GUARD, "asked"))
    report = recheck(folder, workers=1)
    assert report.accepted, report.reason
    for module in report.modules:
        assert not module.shown
        (jumps,) = [a.text for a in module.assumptions if a.key == "jumps seen"]
        assert "jumps while the estimate lies in S_0" in jumps
        assert "`enters` does not confirm it: box: the first step of Estimator" in jumps


# ---------------------------------------------------------------- the node


def test_a_node_that_asks_in_other_words(tmp_path: Path, proved: Proved) -> None:
    assert whys(tmp_path, of_walls(), proved) == ["", ""]


@pytest.mark.parametrize("name", [n for n in CHANGES if n != "for less time"])
def test_a_node_that_does_not_keep_its_guard(tmp_path: Path, name: str, proved: Proved) -> None:
    try:
        reasons = whys(tmp_path, handover(*CHANGES[name], enters="May(box, motion)"), proved)
        shown = whys(tmp_path, handover(enters="May(box, motion)"), proved)
    except NotRecheckedError:
        return  # a certificate of such a program is rejected
    assert any("the first step of" in w or "a step of" in w or "fail-safe" in w for w in reasons)
    assert not any("step" in w for w in shown), "of the node that asks all is shown of steps"


BESIDE = "publish left = { room: motion.x - b.low"
WRONG = {
    "does not ask": [(GUARD, "asked")],
    "asks of the state before": [
        (GUARD, "asked && might"),
        ("let b =", "might = May(other, motion);\n    let b ="),
    ],
    "asks before its last change": [("let b =", "if asked { at = 1 - at; }\n    let b =")],
    "shows the old wall once more": [
        ("let other", "let was = BOXES[at];\n    let other"),
        (BESIDE, "publish left = { room: motion.x - was.low"),
        ("publish right = { room: b.high", "publish right = { room: was.high"),
    ],
    "publishes the box of the step before": [
        ("let other", "let was = BOXES[at];\n    let other"),
        ("publish box = b;", "publish box = was;"),
    ],
    "begins in another box": [("var at: int in [0, 1];", "var at: int in [0, 1] = 1;")],
    "may choose any box": [("publish box = b;", "publish box = choose { BOXES[0], BOXES[1] };")],
    "leaves out the box": [("publish box = b;", "if asked { publish box = b; }")],
    "has a fail-safe box": [("  var at:", "  failsafe box = BOXES[0];\n  var at:")],
    "forgets a wall": [("motion.x - b.low, toward", "b.low, toward")],
}


@pytest.mark.parametrize("name", WRONG)
def test_a_node_by_which_the_state_may_jump_elsewhere(
    tmp_path: Path, name: str, proved: Proved
) -> None:
    """The left wall is changed by every one of them."""
    assert whys(tmp_path, of_walls(IN, *WRONG[name]), proved)[0]


def test_a_step_that_shows_the_jump_later(tmp_path: Path, proved: Proved) -> None:
    """SC goes by the old walls where it reads what the step did not publish."""
    text = of_walls().replace(
        "    publish along = {",
        "    publish along = asked ? { low: 0.0, high: 0.0, w: 0.0 } : {",
    )
    assert whys(tmp_path, text, proved) == ["", ""]
    text = of_walls().replace("publishes left, right, along, box;", "publishes left, right, box;")
    begin, end = text.index("    publish along = {"), text.index("node Fast")
    other = """node Later period 10ms {
  subscribes motion, left, right;
  publishes along;
  step {
    publish along = {
      low: clamp(left.room, -NEAR, NEAR), high: clamp(right.room, -NEAR, NEAR), w: right.toward
    };
  }
}

"""
    text = text[:begin] + "  }\n}\n\n" + other + text[end:]
    text = text.replace("  node Estimator;", "  node Estimator;\n  node Later;")
    with pytest.raises(DiffersError, match="may show several instants"):
        whys(tmp_path, text.replace("w: right.toward", "w: motion.v"), proved)
    text = text.replace("subscribes motion, left", "subscribes left")
    assert all("is not published by Estimator alone" in w for w in whys(tmp_path, text, proved))


def test_a_part_of_a_topic_that_no_map_reads_may_change(tmp_path: Path, proved: Proved) -> None:
    text = of_walls(
        IN, ("publish box = b;", "publish box = { low: b.low, high: b.high, n: time };")
    )
    text = text.replace("high: float };\ntopic box", "high: float, n: float };\ntopic box")
    text = text.replace("low: LOW, high: HIGH }", "low: LOW, high: HIGH, n: 0.0 }")
    text = text.replace("high: 10.0 }", "high: 10.0, n: 0.0 }")
    assert whys(tmp_path, text, proved) == ["", ""]


def test_an_sc_that_remembers_is_not_told(tmp_path: Path, proved: Proved) -> None:
    text = of_walls().replace("    var gap = 0.0;", "    last = along.w > 0.0;\n    var gap = 0.0;")
    text = text.replace(
        "publishes push;\n  step {\n    last",
        "publishes push;\n  var last: bool;\n  step {\n    last",
    )
    assert all("keeps locals" in w for w in whys(tmp_path, text, proved))


def test_a_map_that_moves_by_itself_is_not_told(tmp_path: Path, proved: Proved) -> None:
    """What it reads of the box may stay, and the state jumps all the same."""
    text = of_walls().replace("d.truth.x - box.low", "d.truth.x - box.low + age(box)")
    left, right = whys(tmp_path, text, proved)
    assert left == "the map of seen reads more than plants and topics"
    assert right == ""


def test_without_enters_nothing_is_tried(tmp_path: Path, proved: Proved) -> None:
    for facts in facts_of(tmp_path, of_walls().replace("enters In(left, right);", "")):
        _, groups, claims = proved[2][0]
        assert jumps_by_plant(facts, groups, claims) == {}


# ---------------------------------------------------------------- the sets


@pytest.mark.parametrize(("old", "new", "shown", "why"), GUARDS)
def test_a_guard_that_lets_too_much_in(
    tmp_path: Path, old: str, new: str, shown: list[bool], why: str, proved: Proved
) -> None:
    """As the prover has it, view by view."""
    assert old in IN
    reasons = whys(tmp_path, of_walls(IN.replace(old, new)), proved)
    assert [why in w for w in reasons] == [not s for s in shown]
    assert [w == "" for w in reasons] == shown


def test_a_guard_that_speaks_of_nothing_that_plants_drive(tmp_path: Path, proved: Proved) -> None:
    reasons = whys(tmp_path, handover(), proved)
    assert all("bounds" in w for w in reasons)


def test_a_topic_without_a_set_bounds_no_state(tmp_path: Path, proved: Proved) -> None:
    text = of_walls()
    bounded = "topic left: Wall in { room in [-100.0, 100.0], toward in [-9.0, 9.0] }"
    assert bounded in text
    left, right = whys(tmp_path, text.replace(bounded, "topic left: Wall"), proved)
    assert "nothing that it reads bounds" in left
    assert right == ""


@pytest.mark.parametrize(("error", "why"), [("0.1", "outside R(H)"), ("20.0", "outside the grid")])
def test_what_is_published_may_be_off_by_its_error(
    tmp_path: Path, error: str, why: str, proved: Proved
) -> None:
    """R(H) is the same: SC goes by another topic."""
    measured = "measured along.high within NEAR;"
    text = of_walls().replace(measured, f"{measured}\n  measured left.room within {error};")
    left, right = whys(tmp_path, text, proved)
    assert why in left
    assert right == ""


def test_a_state_may_lie_beyond_the_set_of_what_shows_it(tmp_path: Path, proved: Proved) -> None:
    """By the error: up to 79, where no value above 59 is published, and the grid ends at 60."""
    text = of_walls(IN.replace("l.room < 50.0", "l.room > 25.0"))
    text = text.replace(
        "topic left: Wall in { room in [-100.0, 100.0]",
        "topic left: Wall in { room in [-100.0, 59.0]",
    )
    assert whys(tmp_path, text, proved)[0] == ""
    measured = "measured along.high within NEAR;"
    text = text.replace(measured, f"{measured}\n  measured left.room within 20.0;")
    left = whys(tmp_path, text, proved)[0]
    assert left == "it may hold where seen.r is above 60.0, outside the grid"


def test_of_where_the_state_jumps_to_nobody_knows_that_it_is_safe(
    tmp_path: Path, proved: Proved
) -> None:
    """Unlike of `ttf` and `safer`: cells on which `safe` fails count, too."""
    text = of_walls().replace("safe left.room >= 0.0", "safe left.room >= 1.0")
    facts = facts_of(tmp_path, text)[0]
    other, ((grid,),), claims = proved[2][0]
    facts.times, facts.extents = other.times, other.extents
    group = grid.tables
    whole = group.free
    try:
        group.free = whole.copy()
        group.free[: sum(e < 1.0 for e in group.grid.edges[0]) - 1] = False
        (jumps,) = jumps_by_plant(facts, [[grid]], claims).values()
        assert "outside R(H), at" in jumps[0].why
    finally:
        group.free = whole


def with_another(text: str) -> str:
    """One more topic that the plant of the left view drives, and that the node publishes."""
    same = "publish left = { room: motion.x - b.low, toward: -motion.v };"
    for old, new in (
        ("topic push:", "topic aside: Wall in [-100.0, 100.0] max_age 11ms;\ntopic push:"),
        ("  drives left =", "  drives aside = { room: r, toward: w };\n  drives left ="),
        ("publishes left, right,", "publishes left, aside, right,"),
        (same, f"{same}\n    {same.replace('left', 'aside')}"),
    ):
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def test_what_neither_dm_nor_sc_reads_shows_nothing(tmp_path: Path, proved: Proved) -> None:
    """That it shows the state is nobody's assumption."""
    text = with_another(of_walls().replace("In(left, right);", "In(aside, right);"))
    left, right = whys(tmp_path, text, proved)
    assert left == "it reads what neither DM nor SC reads"
    assert right == ""


def test_a_jump_that_is_not_shown_whole_is_not_told(tmp_path: Path, proved: Proved) -> None:
    """All that shows a view is published in the step, whoever of the module reads it."""
    text = with_another(of_walls())
    text = text.replace("safe left.room >= 0.0", "safe left.room >= 0.0 && aside.room >= 0.0")
    assert whys(tmp_path, text, proved) == ["", ""]
    left, right = whys(
        tmp_path,
        text.replace("publish aside", "if !asked { publish aside").replace(
            "toward: -motion.v };\n    publish right", "toward: -motion.v }; }\n    publish right"
        ),
        proved,
    )
    assert "without showing it" in left
    assert right == ""


def test_a_cell_that_is_taken_out_of_r_is_missed(proved: Proved, tmp_path: Path) -> None:
    """Where a guard may hold, and nowhere else, R(H) has to hold the cell."""
    facts = facts_of(tmp_path, of_walls())[0]
    other, ((grid,),), claims = proved[2][0]
    facts.times, facts.extents = other.times, other.extents
    group = grid.tables
    whole = group.free.copy()
    at = group.grid.cells_around((2.0, 2.0, 0.0, 0.0))
    assert at is not None
    assert Cells(group.grid, whole).members_in(at) == 1
    try:
        group.free = whole.copy()
        group.free[tuple(low for low, _ in at)] = False
        (jumps,) = jumps_by_plant(facts, [[grid]], claims).values()
        assert "outside R(H), at" in jumps[0].why
    finally:
        group.free = whole


def test_sets_that_nobody_claims_confirm_nothing(proved: Proved, tmp_path: Path) -> None:
    facts = facts_of(tmp_path, of_walls())[0]
    _, groups, _ = proved[2][0]
    (jumps,) = jumps_by_plant(facts, groups, {"P2a"}).values()
    assert jumps[0].why == "nothing is claimed with which R(H) is confirmed"


@pytest.mark.parametrize(
    "where", ["extras.handovers.why_not_entered", "induction.handover_jumps.why_jumps_not_shown"]
)
def test_what_goes_wrong_confirms_nothing(
    proved: Proved, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    def fails(*_: object) -> str:
        msg = "out of luck"
        raise ValueError(msg)

    monkeypatch.setattr(f"soter.certificate.{where}", fails)
    failed = "the re-checker itself failed (ValueError: out of luck)"
    assert whys(tmp_path, of_walls(), proved) == [failed] * 2

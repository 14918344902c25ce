"""The state of a view jumps only in steps in which `enters` holds: shown of a node, or not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from generators.handover_program import CHANGES, handover
from soter.api.program import load
from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.front_end import check_file, system_of
from soter.verify.induction.handover import jumping_topics
from soter.verify.problem.problem import assumption_texts
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("z3")


def shown(tmp_path: Path, text: str) -> list[str]:
    """Of each view: why its hand-over is not shown; "" where it is."""
    path = tmp_path / "boxes.soter"
    path.write_text(text)
    checked = check_file(str(path))
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None, {}, exact=False)
    reasons = []
    for system, module in systems_by_view(flat, flat.modules[0]):
        (link,) = module.symbol.verify.abstracts
        reasons += [h.why for h in jumping_topics(system, module, link)]
    return reasons


def test_a_node_that_asks_before_it_changes_a_box(tmp_path: Path) -> None:
    assert shown(tmp_path, handover()) == ["", ""]


@all_rows("name", CHANGES)
def test_a_node_that_does_not_keep_its_guard(tmp_path: Path, name: str) -> None:
    """In one view at least: a guard of one wall is one for that wall."""
    if name == "for less time":
        text = handover(*CHANGES[name], enters="Asked(box, motion)")
        reasons = shown(tmp_path, text.replace("node Estimator", ASKED + "node Estimator", 1))
    else:
        reasons = shown(tmp_path, handover(*CHANGES[name]))
    assert any(reasons)


ASKED = """fun Asked(b: Box, m: Motion): bool {
  return Fits({ room: m.x - b.low, toward: -m.v }, 0.05)
      && Fits({ room: b.high - m.x, toward: m.v }, 0.05);
}
"""


def test_a_part_of_a_topic_that_no_map_reads_may_change(tmp_path: Path) -> None:
    text = handover(("publish box = b;", "publish box = { low: b.low, high: b.high, n: time };"))
    text = text.replace("high: float };\ntopic box", "high: float, n: float };\ntopic box")
    text = text.replace("low: LOW, high: HIGH }", "low: LOW, high: HIGH, n: 0.0 }")
    text = text.replace("high: 10.0 }", "high: 10.0, n: 0.0 }")
    assert shown(tmp_path, text) == ["", ""]


def test_an_sc_that_remembers_is_not_told(tmp_path: Path) -> None:
    text = handover().replace("    var gap = 0.0;", "    last = along.w;\n    var gap = 0.0;")
    text = text.replace(
        "publishes push;\n  step {\n    last",
        "publishes push;\n  var last: float;\n  step {\n    last",
    )
    assert "var last" in text
    assert shown(tmp_path, text) == ["Keep.Slow keeps locals"] * 2


def test_without_enters_nothing_is_tried(tmp_path: Path) -> None:
    assert shown(tmp_path, handover().replace("enters May(box, motion);", "")) == []


@pytest.mark.long
def test_without_enters_every_change_is_an_assumption(tmp_path: Path) -> None:
    """Nothing was promised: proved, and printed."""
    path = tmp_path / "boxes.soter"
    path.write_text(handover(*CHANGES["none"]).replace("enters May(box, motion);", ""))
    for module in load(path).verify(refute=False).modules:
        assert module.verdict == "proved"
        assert any("jumps while" in a for a in assumption_texts(module.assumptions))


def test_enters_without_views_is_refused(tmp_path: Path) -> None:
    text = handover()
    begin, end = text.index("view left"), text.index("view right")
    path = tmp_path / "boxes.soter"
    views = text[begin : text.index("system S")]
    path.write_text(text.replace(views, views[: end - begin][10:].strip()[1:-1] + "  }\n}\n"))
    with pytest.raises(SoterError) as error:
        load(path).verify(refute=False)
    assert any("`enters` says nothing" in d.message for d in error.value.diagnostics)


@pytest.mark.long
def test_where_no_node_keeps_it_nothing_is_proved(tmp_path: Path) -> None:
    path = tmp_path / "boxes.soter"
    path.write_text(handover(*CHANGES["none"]))
    for module in load(path).verify(refute=False).modules:
        assert {c for c, f in module.findings.items() if not f.holds} == {"P2a", "P3"}
        assert "shows nothing" in module.findings["P2a"].text
        assert any("jumps while" in a for a in assumption_texts(module.assumptions))


def test_of_what_no_plant_of_the_view_drives_nothing_is_proved(tmp_path: Path) -> None:
    """A node keeps it, and nobody can say what it says of the view's state."""
    path = tmp_path / "boxes.soter"
    path.write_text(handover())
    for module in load(path).verify(refute=False).modules:
        assert {c for c, f in module.findings.items() if not f.holds} == {"P2a", "P3"}
        said = [a for a in assumption_texts(module.assumptions) if "May(box, motion)" in a]
        assert len(said) == 1
        assert "in the same one: proved)" in said[0]
        assert not any("jumps while" in a for a in assumption_texts(module.assumptions))


@pytest.mark.parametrize("seed", range(6))
def test_who_asks_stays_inside_whatever_ac_does(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "boxes.soter"
    path.write_text(handover())
    run = load(path).simulate(until="60s", seed=seed)
    assert run.violations == 0
    assert len({float(x) for x in run.topic("box")["low"]}) == 2


def test_who_does_not_ask_leaves_its_box(tmp_path: Path) -> None:
    """So the property is one that can fail."""
    path = tmp_path / "boxes.soter"
    path.write_text(handover(*CHANGES["none"]))
    assert load(path).simulate(until="60s", seed=1).violations > 0


def test_a_map_that_reads_an_age_is_not_kept(tmp_path: Path) -> None:
    """A box that is published again as it was is young again, and the state jumps with its age."""
    text = handover()
    aged = text.replace("d.truth.x - box.low", "d.truth.x - box.low + age(box)")
    assert aged != text
    assert any("reads the age" in why for why in shown(tmp_path, aged))

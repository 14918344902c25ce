"""What a change leaves standing: what hangs on a declaration that differs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from soter.api.comparing import AGAIN, GONE, NEW, OPEN, STANDS, Comparison, compare
from soter.diagnostics.diagnostic import SoterError
from soter.language.model.canonical_text import canonical_text
from tables import all_rows

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CART = EXAMPLES / "wall" / "cart.soter"
HAZARDS = EXAMPLES / "wall" / "cart_hazards.csv"
PROOF = ("proof", "SafeCart in Protected")
DM = ("times", "the DM of SafeCart in Protected")
RUNS = ("runs", "Protected")


def compared(folder: Path, *edits: tuple[str, str], of: Path = CART) -> Comparison:
    text = of.read_text(encoding="utf-8")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    (folder / of.name).write_text(text, encoding="utf-8")
    return compare(of, folder / of.name)


def by_status(found: Comparison, status: str) -> set[tuple[str, str]]:
    return {(c.what, c.name) for c in found.consequences if c.status == status}


def test_places_layout_and_comments_change_nothing(tmp_path: Path) -> None:
    found = compared(
        tmp_path, ("node Fast", "// Slow.\n\nnode   Fast"), ("plant Cart", "\nplant Cart")
    )
    assert found.declarations == ()
    assert {c.status for c in found.consequences} == {STANDS}


@all_rows(
    ("edit", "named", "again", "stands"),
    [
        (("clamp(4.0", "clamp(4.5"), "node Fast",
         {("times", "SafeCart.Fast in Protected"), RUNS}, {PROOF, DM}),
        (("wind: float in [-0.2", "wind: float in [-0.3"), "plant Cart", {PROOF, DM, RUNS}, set()),
        (("acts within", "// R1\n    acts within"), "", set(), {PROOF, DM, RUNS}),
        (("until 30s", "until 31s"), "system Protected, system Unprotected", {RUNS}, {PROOF, DM}),
    ],
)  # fmt: skip
def test_of_each_change_what_hangs_on_it_is_named(
    tmp_path: Path,
    edit: tuple[str, str],
    named: str,
    again: set[tuple[str, str]],
    stands: set[tuple[str, str]],
) -> None:
    found = compared(tmp_path, edit)
    assert ", ".join(f"{d.kind} {d.name}" for d in found.declarations) == named
    assert again <= by_status(found, AGAIN)
    assert stands <= by_status(found, STANDS)
    assert {b for c in found.again for b in c.because} <= {*named.replace(",", "").split()}


def test_a_declaration_is_told_in_the_lines_of_the_program(tmp_path: Path) -> None:
    (changed,) = compared(tmp_path, ("clamp(4.0", "clamp(4.5")).declarations
    said = [line[0] + line.strip("+- ") for line in changed.lines]
    step = "publish accel = clamp({} * (goal - motion.x) - 1.0 * motion.v, -A, A);"
    assert said == ["-" + step.format("4.0"), "+" + step.format("4.5")]


def test_what_is_new_or_gone_is_told(tmp_path: Path) -> None:
    found = compared(tmp_path, ("node Careful", "node Gentle"), ("sc Careful", "sc Gentle"))
    assert {(d.name, d.how) for d in found.declarations} == {
        ("Careful", GONE), ("Gentle", NEW), ("SafeCart", "changed"),
    }  # fmt: skip
    assert ("times", "SafeCart.Gentle in Protected") in by_status(found, NEW)
    assert ("times", "SafeCart.Careful in Protected") in by_status(found, GONE)
    assert PROOF in by_status(found, AGAIN)


def test_a_requirement_hangs_on_what_it_traces_to(tmp_path: Path) -> None:
    text = CART.read_text(encoding="utf-8").replace("clamp(4.0", "clamp(4.5")
    (tmp_path / "new.soter").write_text(text, encoding="utf-8")
    found = compare(CART, tmp_path / "new.soter", HAZARDS)
    status = {c.name: c.status for c in found.consequences if c.what == "requirement"}
    assert {name for name, s in status.items() if s == AGAIN} == {"H1", "R1"}
    assert {name for name, s in status.items() if s == OPEN} == {"H4"}, "it leads to nothing"
    assert len(status) == 6


def test_a_program_with_errors_is_not_compared(tmp_path: Path) -> None:
    with pytest.raises(SoterError):
        compared(tmp_path, ("sc Careful", "sc Carless"))
    with pytest.raises(SoterError, match="no certificate"):
        compare(tmp_path, CART)


@dataclass(eq=False)
class Knot:
    name: str
    others: tuple[Knot, ...] = ()


def test_the_text_of_a_graph_ends_and_tells_shapes_apart() -> None:
    a, b = Knot("a"), Knot("b")
    a.others, b.others = (b, a), (a, a)
    again = Knot("a", (Knot("b"),))
    assert canonical_text(a) == canonical_text(a)
    assert canonical_text(a) != canonical_text(again)
    assert canonical_text(frozenset({1, 2, 3})) == canonical_text(frozenset({3, 2, 1}))
    assert canonical_text((1, (2,))) != canonical_text(((1, 2),))


def test_the_dm_of_a_module_that_poses_no_problem_is_timed_again(tmp_path: Path) -> None:
    """Its predicates are its own, and nothing is proved of it."""
    robot = """soter 1; input topic x: float in [0.0, 5.0] max_age 20ms;
topic u: float in [0.0, 1.0] = 0.0;
node A period 10ms { publishes u; step { publish u = 1.0; } }
node B period 10ms { publishes u; step { publish u = 0.0; } }
rta M { ac A; sc B; period 10ms; safe x < 3.0; ttf x > 2.0; safer x < 1.0; }
system S { module M; input x every 10ms; until 1s; }
"""
    (tmp_path / "robot.soter").write_text(robot, encoding="utf-8")
    (tmp_path / "new").mkdir()
    found = compared(tmp_path / "new", ("ttf x > 2.0", "ttf x > 2.5"), of=tmp_path / "robot.soter")
    assert ("times", "the DM of M in S") in by_status(found, AGAIN)
    assert not [c for c in found.consequences if c.what == "proof"]


def test_a_part_whose_text_might_leave_something_out_has_none() -> None:
    with pytest.raises(TypeError, match="no text is known of a ndarray"):
        canonical_text((1.0, np.zeros(10_000)))

"""A state that nothing bounds is left out of a proof exactly where nothing that is asked reads it.

The oracle is the graph of who reads whom that the drawn programs are made from.
"""

from __future__ import annotations

import random
from contextlib import nullcontext
from typing import TYPE_CHECKING

import pytest

from soter.certificate.extras.left_out_states import (
    leave_out_states,
    refuse_reads_of_left_out_states,
    require_unread_states,
)
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import assumption_texts
from soter.verify.verify_module import verify_module
from tables import all_rows
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.problem.problem import Problem

LANE = """soter 1;
topic pose: { x: float, y: float, h: float } max_age 40ms;
topic turn: float in [-0.25, 0.25] = 0.0;
plant Car period 10ms {
  reads turn;
  drives pose = { x: x, y: y, h: h };
  state x: float = 0.0;
  state y: float = 0.0;
  state h: float = 0.0;
  disturbance bend: float in [-0.02, 0.02];
  der x = 15.0 * cos(h);
  der y = 15.0 * sin(h);
  der h = turn + bend;
  measured pose.x within 0.5, pose.y within 0.05, pose.h within 0.01;
}
node Policy period 20ms {
  subscribes pose;
  publishes turn;
  step { publish turn = clamp(0.5 * (0.7 - pose.y) - 2.0 * pose.h, -0.25, 0.25); }
}
node Keep period 20ms {
  subscribes pose;
  publishes turn;
  step { publish turn = clamp(-0.25 * pose.y - 3.0 * pose.h, -0.25, 0.25); }
}
rta SafeLane {
  ac Policy;
  sc Keep;
  period 40ms;
  safe abs(pose.y) < 0.9;
  verify { levels 2; grid pose.y in [-0.9, 0.9] / 20, pose.h in [-0.3, 0.3] / 20; }
}
system S { c: Car; module SafeLane; }
"""

ANOTHER = "  state z: float = 0.0;\n  der z = sin(x) * z + clamp(x, -1.0, 1.0);\n"


def problem_of(folder: Path, text: str) -> Problem:
    """Of the module of a program."""
    path = folder / "lane.soter"
    path.write_text(text, encoding="utf-8")
    flat = system_of(check_file(str(path)), "S", {})
    return extract(flat, flat.modules[0])


def left_out_of(problem: Problem) -> str:
    """What the assumptions name as left out."""
    said = (t.partition(": ")[2] for t in assumption_texts(problem.assumptions) if "left out" in t)
    return ", ".join(said)


def changed(old: str, new: str) -> str:
    """The lane with one other line."""
    assert LANE.count(old) == 1
    return LANE.replace(old, new)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("der x = 15.0 * cos(h)", "der x = 15.0 * cos(h)", "c.x"),
        ("0.7 - pose.y", "0.7 - pose.y + 0.01 * pose.x", "c.x"),
        ("der x = 15.0 * cos(h)", "der x = 15.0 * cos(h) - 0.5 * x", "c.x"),
        ("der x = 15.0 * cos(h)", "der x = 15.0 * cos(h) + sin(x * x)", "c.x"),
        ("  der x =", f"{ANOTHER}  der x =", "c.x, c.z"),
    ],
    ids=["as_it_is", "read_by_ac", "leaves", "bounded", "read_by_another_that_is_left_out"],
)
def test_what_nothing_asks_for_is_left_out_and_said(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    problem = problem_of(tmp_path, changed(old, new))
    assert left_out_of(problem) == expected
    assert [x.name for x in problem.quantities.states] == ["c.y", "c.h"]


@pytest.mark.parametrize(
    ("old", "new", "reader"),
    [
        ("clamp(-0.25 * pose.y", "clamp(-0.25 * pose.y + 0.001 * pose.x", "SC"),
        ("< 0.9;\n", "< 0.9 && pose.x > -5.0;\n", "`safe`"),
        ("turn + bend;", "turn + bend * cos(x);", "the rate of `c.h`"),
        ("{ x: x,", "{ x: 2.0 * x,", "what plants publish, which has to fit"),
        ("15.0 * cos(h)", "15.0 * cos(h) + 0.1 * x * x", "its own rate, by which it may end"),
        ("15.0 * cos(h)", "log(h + 0.5)", "its own rate, by which it may end"),
        ("15.0 * cos(h)", "tan(9.0 * h)", "its own rate, by which it may end"),
        ("15.0 * cos(h)", "1.0 / (h - 0.1)", "its own rate, by which it may end"),
        ("grid pose.y in", "core abs(pose.x) < 9.0; grid pose.y in", "`core`"),
    ],
)
def test_what_is_read_needs_bounds_and_a_reader_is_named(
    tmp_path: Path, old: str, new: str, reader: str
) -> None:
    with pytest.raises(SoterError) as refused:
        problem_of(tmp_path, changed(old, new))
    (diagnostic,) = refused.value.diagnostics
    assert diagnostic.code == "R008"
    assert f"`c.x` is read by {reader}" in diagnostic.notes


def test_sets_are_those_of_the_plant_without_that_state(tmp_path: Path) -> None:
    without = LANE
    for line in ("  state x: float = 0.0;\n", "  der x = 15.0 * cos(h);\n"):
        without = without.replace(line, "")
    without = without.replace("x: x, ", "x: 0.0, ")
    results = [verify_module(problem_of(tmp_path, text)) for text in (LANE, without)]
    verdicts = [{k: f.verdict for k, f in r.findings.items()} for r in results]
    assert verdicts[0] == verdicts[1]
    assert verdicts[0]["P2a"] == "proved"
    assert results[0].shares == results[1].shares
    assert results[0].shares["core"] > 0.2


class Drawn:
    """The lane with states of which nothing is known but who reads them."""

    def __init__(self, seed: int) -> None:
        random_ = random.Random(seed)  # noqa: S311 - no secrets
        count = random_.randint(1, 4)
        self.names = [f"z{k}" for k in range(count)]
        self.reads: dict[str, set[str]] = {}
        declared, rates = "", ""
        for name in self.names:
            of = {n for n in self.names if random_.random() < 0.35}
            self.reads[name] = of
            declared += f"  state {name}: float = 0.0;\n"
            form = random_.choice(["{} - 0.5", "sin({})", "clamp({}, -1.0, 1.0) * cos(h)"])
            rates += f"  der {name} = {form.format(' + '.join(['h', *sorted(of)]))};\n"
        self.asked = {n for n in self.names if random_.random() < 0.15}
        self.by_sc = {n for n in self.names if random_.random() < 0.15}
        extra = "".join(f" + 0.001 * sin({n})" for n in sorted(self.asked))
        text = changed("turn + bend;", f"turn + bend{extra};")
        text = text.replace("  der x =", f"{declared}{rates}  der x =")
        fields = "".join(f", {n}: float" for n in self.names)
        text = text.replace("h: float }", f"h: float{fields} }}")
        text = text.replace("h: h }", f"h: h{''.join(f', {n}: {n}' for n in self.names)} }}")
        seen = "".join(f" + 0.001 * clamp(pose.{n}, -1.0, 1.0)" for n in sorted(self.by_sc))
        self.text = text.replace("clamp(-0.25 * pose.y", f"clamp(-0.25 * pose.y{seen}")

    def needed(self) -> set[str]:
        """What something asked reads, and what that reads, and so on."""
        found: set[str] = set()
        new = self.asked | self.by_sc
        while new - found:
            found |= new
            new = {m for n in found for m in self.reads[n]}
        return found


@all_rows("seed", range(20))
def test_of_drawn_states_prover_and_rechecker_leave_out_what_nothing_reads(
    tmp_path: Path, seed: int
) -> None:
    drawn = Drawn(seed)
    needed = drawn.needed()
    bounded = "".join(f", c.{n} in [-1.0, 1.0] / 2" for n in sorted(needed))
    text = drawn.text.replace("/ 20; }", f"/ 20; grid {bounded[2:]}; }}" if bounded else "/ 20; }")
    problem = problem_of(tmp_path, text)
    free = sorted({"x", *drawn.names} - needed)
    assert sorted(left_out_of(problem).split(", ")) == [f"c.{n}" for n in free]

    random_ = random.Random(seed)  # noqa: S311 - no secrets
    for _ in range(4):
        facts = small_proofs.facts_of(tmp_path / "lane.soter", "S", "SafeLane")
        left = {n for n in free if random_.random() < 0.8}
        kept = {"y", "h", "x", *drawn.names} - left
        read = {m for n in kept & {*drawn.names} for m in drawn.reads[n]}
        leave_out_states(facts, [f"c.{n}" for n in left])
        facts.extents = tuple((-1.0, 1.0) for _ in facts.states)
        model = CaseModel(facts, (), facts.extents)
        if read & left:
            with pytest.raises(RejectedError, match="reads what is left out"):
                refuse_reads_of_left_out_states(model)
        else:
            refuse_reads_of_left_out_states(model)


@pytest.mark.parametrize(
    ("old", "new", "names", "why"),
    [
        ("h: float }", "h: float }", ["c.h"], "no sets of c.h"),
        ("der x = 15.0", "der x = x * x + 15.0", ["c.x"], "may end"),
        ("der x = 15.0", "der x = x * abs(x) + 15.0", ["c.x"], "may end"),
        ("< 0.9;\n", "< 0.9 && pose.x > -5.0;\n", ["c.x"], "reads what is left out"),
        (
            "y: float, h: float } max",
            "y: float, h: float } in { x in [-9.0, 9.0] } max",
            ["c.x"],
            "reads what is left out",
        ),
    ],
    ids=["an_axis", "ends", "ends_by_a_product", "safe", "a_set"],
)
def test_the_rechecker_refuses_what_leaves_out_more(
    tmp_path: Path, old: str, new: str, names: list[str], why: str
) -> None:
    path = tmp_path / "lane.soter"
    path.write_text(changed(old, new), encoding="utf-8")
    facts = small_proofs.facts_of(path, "S", "SafeLane")

    def looked_at() -> None:
        leave_out_states(facts, names)
        facts.extents = tuple((-1.0, 1.0) for _ in facts.states)
        refuse_reads_of_left_out_states(CaseModel(facts, (), facts.extents))

    with pytest.raises(RejectedError, match=why):
        looked_at()


OPEN = ("grid pose.y in", "grid pose.x in [-1.0, 1.0] / 4 open, pose.y in")
STEPS = tuple(
    (f"der {s} = {rate}", f"next {s} = {s} + 0.02 * ({rate})")
    for s, rate in (("x", "15.0 * cos(h)"), ("y", "15.0 * sin(h)"), ("h", "turn + bend"))
)
MAP = (*STEPS, ("Car period 10ms", "Car period 20ms"), ("max_age 40ms", "max_age 10ms"))


@all_rows(
    ("pairs", "groups", "why"),
    [
        ((), 1, ""),
        ((), 2, "beside other groups"),
        ((("levels 2;", "levels 2; enters pose.y < 0.5;"),), 1, "of a map, or of `enters`"),
        (MAP, 1, "of a map, or of `enters`"),
        ((("pose.y - 3.0", "pose.y + 0.001 * pose.x - 3.0"),), 1, "`c.x`.* is read by SC"),
        ((("turn + bend;", "turn + bend + 0.001 * x;"),), 1, "`c.x`.* is read by SC"),
    ],
)
def test_the_rechecker_follows_no_state_beyond_the_ends_of_an_axis_that_something_asks_for(
    tmp_path: Path, pairs: tuple[tuple[str, str], ...], groups: int, why: str
) -> None:
    text = LANE
    for old, new in (OPEN, *pairs):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    (tmp_path / "lane.soter").write_text(text, encoding="utf-8")
    facts = small_proofs.facts_of(tmp_path / "lane.soter", "S", "SafeLane")
    facts.extents = tuple((-1.0, 1.0) for _ in facts.states)
    with pytest.raises(NotRecheckedError, match=why) if why else nullcontext():
        require_unread_states(CaseModel(facts, (), facts.extents), groups)


@pytest.mark.parametrize("rate", ["log(h - 0.5)", "tan(9.0 * h)", "sqrt(h)", "1.0 / y", "log(x)"])
def test_a_rate_that_is_not_defined_everywhere_leaves_nothing_out(
    tmp_path: Path, rate: str
) -> None:
    path = tmp_path / "lane.soter"
    path.write_text(changed("15.0 * cos(h)", rate), encoding="utf-8")
    facts = small_proofs.facts_of(path, "S", "SafeLane")
    leave_out_states(facts, ["c.x"])
    facts.extents = tuple((-1.0, 1.0) for _ in facts.states)
    with pytest.raises((RejectedError, NotRecheckedError)):
        refuse_reads_of_left_out_states(CaseModel(facts, (), facts.extents))

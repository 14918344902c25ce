"""Why a decision module decided: the part of the predicate, on the values that it read."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import processes
import soter
from soter.simulate import decisions
from soter.simulate.explain_decision import Explainer
from soter.simulate.run_observer import decided_rows

if TYPE_CHECKING:
    from soter.simulate.result import Run

PROGRAM = """
soter 1;
topic raw: float in [-100.0, 100.0];
topic seen: float in [-100.0, 100.0] max_age 25ms;
topic u: float in [-1.0, 1.0];
const LIMIT: float = 2.0;
plant P period 10ms { reads u; drives raw = x; state x: float = 0.0; next x = x + 0.25; }
node Filter period 10ms {
  subscribes raw; publishes seen;
  step { if SPEAKS { publish seen = raw; } }
}
node Ac period 10ms { subscribes seen; publishes u; step { publish u = COMMAND; } }
node Sc period 10ms { publishes u; step { publish u = 0.0; } }
rta M {
  ac Ac; sc Sc; period 20ms; clean 2;
  safe raw < 100.0;
  ttf TTF;
  safer seen < LIMIT && seen >= 0.0;
}
system S default { p: P; node Filter; module M; until 200ms; }
"""


def run(
    folder: Path,
    *,
    ttf: str = "seen * 2.0 > 4.0 || seen < -1.0",
    command: str = "0.5",
    speaks: str = "true",
    engine: str = "native",
    extra: str = "",
) -> Run:
    text = PROGRAM.replace("TTF", ttf).replace("COMMAND", command).replace("SPEAKS", speaks)
    path = folder / "why.soter"
    path.write_text(text.replace("until", f"{extra} until"), encoding="utf-8")
    return soter.load(path).simulate(engine=engine)


def every(of: Run) -> list[decisions.DecisionStepRecord]:
    """All DM steps, each explained."""
    explainer = Explainer(of.system, of.layout)
    assert of.trace is not None
    steps = []
    rows = np.flatnonzero(decided_rows(of.system, of.trace)[:, 0])
    for row, d in zip(rows, decisions.decision_steps(of.system, of.trace), strict=True):
        raw = of.trace[row - 1].tobytes() if row else None
        why = explainer.explain(0, raw, of.trace[row].tobytes())
        steps.append(replace(d, why=why))
    return steps


def test_a_takeover_names_the_part_that_was_true_and_both_its_values(tmp_path: Path) -> None:
    simulation = run(tmp_path)
    to_ac, to_sc = simulation.decisions
    assert to_ac.time_ns == 20_000_000
    assert to_ac.words == ["seen = 0.25 < LIMIT = 2", "seen = 0.25 >= 0.0"]
    assert to_sc.words == ["seen * 2.0 = 4.5 > 4.0"]
    assert to_sc.why is not None
    first, second = to_sc.why.ttf
    assert (first.value, second.value) == (True, False)
    assert [(o.text, o.value) for o in second.operands] == [("seen", 2.25), ("-1.0", -1.0)]


def test_values_are_those_that_the_module_read_not_those_at_the_end_of_the_instant(
    tmp_path: Path,
) -> None:
    simulation = run(tmp_path)
    change = simulation.decisions[1]
    row = int(np.flatnonzero(np.rint(simulation.time_s() * 1e9) == change.time_ns)[0])
    assert change.why is not None
    read = change.why.ttf[1].operands[0].value
    assert read == simulation.topic("seen")[row - 1] != simulation.topic("seen")[row]


def test_a_stale_topic_is_named_with_its_age(tmp_path: Path) -> None:
    simulation = run(tmp_path, ttf="seen > 50.0", speaks="time < 0.095")
    change = simulation.decisions[1]
    assert change.after == "SC"
    assert change.words == ["seen is 0.03 s old, max_age 0.025 s"]


def test_what_was_never_published_has_no_age(tmp_path: Path) -> None:
    (first, *_) = every(run(tmp_path, speaks="false"))
    assert first.words[0] == "seen is never published, max_age 0.025 s"
    assert first.why is not None
    assert first.why.stale[0].age_s is None


def test_a_gate_fault_is_named_with_its_kind_and_what_ac_owes_after_it(tmp_path: Path) -> None:
    simulation = run(tmp_path, command="time > 0.055 && time < 0.065 ? 7.0 : 0.5")
    steps = {d.time_ns // 1_000_000: d for d in every(simulation)}
    assert steps[80].after == "SC"
    assert steps[80].words == ["`range` of M.Ac"]
    assert [d.words for d in simulation.decisions if d.time_ns == 80_000_000] == [
        ["`range` of M.Ac"]
    ]


def test_staying_in_sc_says_what_is_missing(tmp_path: Path) -> None:
    steps = every(run(tmp_path))
    last = steps[-1]
    assert (last.before, last.after) == ("SC", "SC")
    assert last.words == ["not seen = 4.75 < LIMIT = 2"]


def test_a_fault_in_a_predicate_is_told_as_one(tmp_path: Path) -> None:
    simulation = run(tmp_path, ttf="1 / (seen > 1.0 ? 0 : 1) > 1")
    assert simulation.decisions[1].words == ["1 / (seen > 1.0 ? 0 : 1) > 1: step fault `divide`"]


TANK = """soter 1;
topic look: { rate: float, level: float } max_age 100ms;
topic pump: float in [-0.1, 0.1] = 0.0;
plant Tank period 50ms {
  reads pump; drives look = { rate: 2.0 * pump, level: h }; state h: float = 1.0;
  der h = pump; measured look.level within 0.01;
}
node Pushes period 100ms { publishes pump; step { publish pump = PUSH; } }
node Hold period 100ms {
  subscribes look; publishes pump; step { publish pump = clamp(1.0 - look.level, -0.1, 0.1); }
}
rta M {
  ac Pushes; sc Hold; period 100ms; safe look.level > 0.2;
  verify { grid look.level in [0.2, 1.8] / 160; }
}
system S default { t: Tank; module M; until 20s; }
"""


@pytest.mark.parametrize(
    ("push", "ends"), [("0.1", "the grid ends at look.level = 1.8: `safe` holds"), ("-0.1", "")]
)
def test_a_takeover_by_the_end_of_a_grid_is_told_from_one_by_safe(
    tmp_path: Path, push: str, ends: str
) -> None:
    (tmp_path / "tank.soter").write_text(TANK.replace("PUSH", push), encoding="utf-8")
    changes = soter.load(tmp_path / "tank.soter").simulate().decisions
    (why,) = next(c.words for c in changes if c.after == "SC")
    assert " outside S_0" in why
    assert ("the grid ends" in why) == bool(ends)
    assert ends in why


def test_both_engines_explain_alike(tmp_path: Path) -> None:
    native, interp = (run(tmp_path, engine=e).decisions for e in ("native", "interp"))
    assert [(d.words, d.why) for d in native] == [(d.words, d.why) for d in interp]


def test_where_the_order_is_drawn_values_that_do_not_fit_are_not_told(tmp_path: Path) -> None:
    text = "faults { order any; }"
    steps = every(run(tmp_path, ttf="seen != raw - 0.25", extra=text))
    known = [d.why.known for d in steps if d.why is not None]
    assert not all(known)
    assert all(not d.why.ttf for d in steps if d.why is not None and not d.why.known)


@pytest.mark.parametrize("name", ["wall/cart.soter", "generality/standing.soter"])
def test_every_step_of_an_example_is_explained(name: str) -> None:
    program = soter.load(Path(__file__).parents[3] / "examples" / name)
    steps = every(program.simulate(until=5))
    assert steps
    assert all(d.why is not None and d.why.known for d in steps)


@pytest.mark.long
def test_the_run_command_lists_why(tmp_path: Path) -> None:
    run(tmp_path)
    command = (sys.executable, "-m", "soter.cli.main", "run", "why.soter")
    told, found_ = (
        processes.run(
            (*command, o), cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout
        for o in ("--why", "--json")
    )
    assert "seen * 2.0 = 4.5 > 4.0" in told
    document = json.loads(found_)
    change = document["mode_changes"][1]
    assert change["why"]["words"] == ["seen * 2.0 = 4.5 > 4.0"]
    assert change["why"]["ttf"][0]["operands"][0] == {"text": "seen * 2.0", "value": 4.5}
    assert change["margin_s"] == 0.0


def test_margins_of_a_run_are_those_that_a_program_reads(tmp_path: Path) -> None:
    text = PROGRAM.replace("TTF", "seen > 2.0").replace("COMMAND", "0.5").replace("SPEAKS", "true")
    ear = """
topic told: float in [0.0, 1.0];
node Ear period 10ms { publishes told; step { publish told = margin(M); } }
"""
    text = text.replace("node Ac ", f"{ear}node Ac ")
    path = tmp_path / "told.soter"
    path.write_text(text.replace("node Filter;", "node Filter; node Ear;"), encoding="utf-8")
    simulation = soter.load(path).simulate()
    assert simulation.margin("M").max() == 0.02
    assert (simulation.margin("M") == simulation.topic("told")).all()

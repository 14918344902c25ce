"""Schedules of which no claim is true as it is read here: what is refused of them, by itself."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING

import pytest
from bench.recheck.small_modules import PROGRAMS

from soter.certificate.extras import node_paths
from soter.certificate.extras.estimates_and_shield import command_cells
from soter.certificate.extras.sc_locals_and_modes import check_start_answers
from soter.certificate.reading.module_facts import DiffersError
from soter.certificate.rechecker import read_problem
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import assumption_texts
from tables import all_rows
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


# ---------------------------------------------------------------- no problem of a proof on grids

NOBODY = "node Nobody period 10ms { publishes x; step { publish x = 0.0; } }\nnode Fast"
COUNTS = "node Count period 10ms { publishes k; step { publish k = 1; } }\nnode Fast"
DRAWN = ("drives raw = q;", "drives raw = choose bool ? q : 0.0;")
OTHER_KIND = (
    ("{ p: P;", "{ p: P; q: Q;"),
    ("node Fast", "plant Q period 10ms { drives y = q; state q: float; next q = q; }\nnode Fast"),
    ("topic u:", "topic y: float max_age 20ms;\ntopic u:"),
    ("verify {", "verify {\n    grid q.q in [-1.0, 1.0] / 1;"),
)
INTEGER = (
    ("topic u:", "topic k: int;\ntopic u:"),
    ("reads u;", "reads u, k;"),
    ("node Fast", COUNTS),
    ("{ p: P;", "{ p: P; node Count;"),
    ("der p = u + w", "der p = u + w * float(k)"),
)
SHIELD = ("  verify {", "  shield 4;\n  verify {")


@all_rows(
    ("name", "pairs", "levels", "why"),
    [
        (
            "written",
            (("node Fast", NOBODY), ("{ p: P;", "{ node Nobody;")),
            3,
            "no verification plant",
        ),
        ("written", OTHER_KIND, 3, "flows and maps in one module"),
        ("written", INTEGER, 3, "the disturbance `k` is no float"),
        ("written", (("x: float max_age 20ms", "x: float"),), 3, "has no `max_age`"),
        ("flying", (DRAWN,), 3, "the plant `world` chooses"),
        ("computed", (), 1, "`levels` is not as it should be"),
        ("computed", (), True, "`levels` is not as it should be"),
        ("written", (), 4, "another one in the program"),
        ("computed", (("verify {", "verify {\n    levels 3;"),), 4, "another one in the program"),
    ],
)
def test_a_problem_of_another_kind_is_refused(
    tmp_path: Path, name: str, pairs: Pairs, levels: int, why: str
) -> None:
    text = PROGRAMS[name]
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    (tmp_path / "small.soter").write_text(text)
    checked = check_file(str(tmp_path / "small.soter"))
    assert checked.ok, checked.diagnostics
    with pytest.raises((RejectedError, NotRecheckedError), match=why):
        read_problem(system_to_prove(checked, "S"), {"module": "M", "levels": levels})


STRAIGHT_READ = (
    ("node Estimate period 10ms { subscribes raw; publishes x; step { publish x = raw; } }\n", ""),
    ("drives raw = q;", "drives x = q;"),
    (" node Estimate;", ""),
    (", Estimate 1ms", ""),
)


@all_rows(
    ("figure", "pairs", "why"),
    [
        ("NODES_MAX", (), "more than 0 nodes on a path"),
        ("NODES_MAX", STRAIGHT_READ, "more than 0 nodes on a path"),
        ("LOOKS_MAX", (), "more ways between plants and module"),
    ],
)
def test_as_many_nodes_and_ways_are_followed_as_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, figure: str, pairs: Pairs, why: str
) -> None:
    facts_of(tmp_path, PROGRAMS["flying"], *pairs)
    monkeypatch.setattr(node_paths, figure, 0)
    with pytest.raises(NotRecheckedError, match=why):
        facts_of(tmp_path, PROGRAMS["flying"], *pairs)


@all_rows(("ac", "refused"), [("50ms", False), ("20ms", True)])
def test_an_ac_under_a_shield_steps_with_a_plant_that_moves_in_steps(
    tmp_path: Path, ac: str, refused: bool
) -> None:
    text = PROGRAMS["steps"]
    beside = tuple((x, "") for x in text.splitlines() if x.startswith(("  ttf", "  safer")))
    facts = facts_of(tmp_path, text, *beside, SHIELD, ("Fast period 50ms", f"Fast period {ac}"))
    with pytest.raises(NotRecheckedError, match="between the steps") if refused else nullcontext():
        assert command_cells(facts) == 4


BESIDE_X = (
    ("topic u:", "topic y: float in [-1.0, 1.0] max_age 20ms;\ntopic u:"),
    ("  drives x = p;", "  drives x = p;\n  drives y = clamp(p, -1.0, 1.0);"),
)
SC_READS = (
    ("node Slow period 50ms {\n  subscribes x;", "node Slow period 50ms {\n  subscribes x, y;"),
    ("clamp(-GAIN * x", "clamp(-GAIN * x - y"),
)


@all_rows(("more", "refused"), [((), False), (SC_READS, True)])
def test_an_sc_under_a_shield_reads_what_its_dm_reads(
    tmp_path: Path, more: Pairs, refused: bool
) -> None:
    """Of what SC alone reads no verdict says that it is young."""
    facts = facts_of(tmp_path, PROGRAMS["written"], *BESIDE["a shield"], *BESIDE_X, *more)
    with pytest.raises(NotRecheckedError, match="DM does not") if refused else nullcontext():
        assert command_cells(facts) == 4


LAMP = (
    ("topic u:", "topic lamp: float in [0.0, 1.0];\ntopic u:"),
    ("publishes u;", "publishes u, lamp;"),
    ("step { publish u", "step { publish lamp = 1.0; publish u"),
)
FELT = (("reads u;", "reads u, lamp;"), ("der p = u + w", "der p = u * lamp + w"))
FLOWN = (*FELT, ("reads force;", "reads force, lamp;"), ("der q = force", "der q = force * lamp"))


@all_rows(("name", "felt"), [("written", FELT), ("flying", FLOWN)])
def test_each_output_is_felt_by_a_plant(tmp_path: Path, name: str, felt: Pairs) -> None:
    """Of what nobody feels it is not known when it acts."""
    facts_of(tmp_path, PROGRAMS[name], *LAMP, *felt)
    with pytest.raises(NotRecheckedError, match="feels `lamp`"):
        facts_of(tmp_path, PROGRAMS[name], *LAMP)


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
    assert facts_of(tmp_path, PROGRAMS["steps"], *behind).derived.age == 0


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


# ---------------------------------------------------------------- SC's own times


GRID = next(x for x in PROGRAMS["written"].splitlines() if "grid" in x)
PREDICATES = [x for x in PROGRAMS["written"].splitlines() if x.startswith(("  ttf", "  safer"))]
BESIDE: dict[str, Pairs] = {
    "cells": (),
    "a law": (("  verify {", "  failsafe u = 0.0;\n  verify {"),),
    "a shield": (*((x, "") for x in PREDICATES), ("  verify {", "  shield 4;\n  verify {")),
}


@all_rows("beside", BESIDE)
@all_rows(("latest", "late"), [(21, False), (22, True), (49, True), (499, True)])
def test_sc_that_acts_within_more_than_half_its_period_is_rechecked_on_cells_alone(
    tmp_path: Path, beside: str, latest: int, late: bool
) -> None:
    """Its step takes 1 ms, behind a DM that is done within 3 ms."""
    pairs: Pairs = (("acts within 1ms", f"acts within {latest}ms"), *BESIDE[beside])
    if not late or beside == "cells":
        facts = facts_of(tmp_path, PROGRAMS["written"], *pairs)
        assert facts.has_late_commands == (2 * facts.times["j_ns"] > 50_000_000) == late
    else:
        with pytest.raises(NotRecheckedError, match="half its period"):
            facts_of(tmp_path, PROGRAMS["written"], *pairs)


@pytest.mark.parametrize(("within", "jitter"), [("4ms", 8), ("1ms to 4ms", 7), ("4ms to 4ms", 4)])
def test_both_sides_know_how_soon_a_command_acts_at_least(
    tmp_path: Path, within: str, jitter: int
) -> None:
    pairs: Pairs = (("acts within 1ms", f"acts within {within}"),)
    facts = facts_of(tmp_path, PROGRAMS["written"], *pairs)
    problem = extract(facts.flying, facts.flying.modules[0])
    assert facts.times["j_ns"] == problem.times.jitter_sc == jitter * 1_000_000
    for name in ("h0_ns", "H_star_ns", "d_ns"):
        known = facts_of(tmp_path, PROGRAMS["written"], ("acts within 1ms", "acts within 4ms"))
        assert facts.times[name] == known.times[name]


# ---------------------------------------------------------------- defaults

SEEN = """soter 1;
topic place: float max_age 20ms;
topic speed: float max_age 20ms;
topic pos: float in [-9.0, 9.0] = 0.0 max_age 200ms;
topic vel: float in [-9.0, 9.0] = 0.0 max_age 200ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant World period 10ms {
  reads u; drives place = p; drives speed = v;
  state p: float = 2.0; state v: float = 1.5;
  der p = u; der v = 0.0;
}
plant Model period 10ms {
  reads u; drives pos = q; drives vel = r;
  state q: float = 2.0; state r: float = 1.5;
  der q = u; der r = 0.0;
}
node EstP period 60ms { subscribes place; publishes pos; step { publish pos = place; } }
node EstV period 60ms phase 30ms { subscribes speed; publishes vel; step { publish vel = speed; } }
node Fast period 50ms { subscribes pos; publishes u; step { publish u = 1.0; } }
node Slow period 10ms {
  subscribes pos, vel;
  publishes u;
  step { ASSERT publish u = clamp(-pos, -1.0, 1.0); }
}
rta M {
  ac Fast; sc Slow; period 50ms;
  safe abs(pos) < 8.0; ttf abs(pos) > 5.0; safer abs(pos) < 4.0;
  verify {
    abstracts w by m: Model = { q: w.truth.p, r: w.truth.v };
    grid pos in [-9.0, 9.0] / 90;
    grid m.r in [1.0, 2.0] / 10;
  }
}
system S { w: World; node EstP; node EstV; module M; }
"""
"""At 10 ms SC reads a state of `pos` beside the default of `vel`."""
ASSERTS = ("ASSERT", "assert !(pos > 1.0 && vel == 0.0);")
READS = "subscribes place; publishes pos; step {"
ONE_NODE = (
    (READS, "subscribes place, SECOND; publishes pos, vel; step { publish vel = SECOND;"),
    ("publishes vel; step { publish vel = speed;", "publishes mid; step { publish mid = speed;"),
    ("topic u:", "topic mid: float max_age 200ms;\ntopic u:"),
    ("EstP period 60ms", "EstP period 60ms phase 20ms"),
)
STRAIGHT = """topic x: float in [-9.0, 9.0] = 0.0 max_age 30ms;
topic y: float in [-9.0, 9.0] = 0.0 max_age 30ms;
plant P period 10ms { reads u; drives x = p; state p: float = 2.0; der p = u; }
plant Q period 10ms { drives y = q; state q: float = 1.5; der q = 0.0; }
topic u: float in [-1.0, 1.0] = 0.0;
node Fast period 50ms { subscribes x; publishes u; step { publish u = 1.0; } }
node Slow period 50ms {
  subscribes x, y;
  publishes u;
  step { assert !(x > 1.0 && y == 0.0); publish u = clamp(-x, -1.0, 1.0); }
}
rta M {
  ac Fast; sc Slow; period 50ms;
  safe abs(x) < 8.0; ttf abs(x) > 5.0; safer abs(x) < 4.0;
  verify { grid x in [-9.0, 9.0] / 90; grid q.q in [1.0, 2.0] / 10; dropout 60ms; }
}
system S { p: P; q: Q; module M; }
"""


@pytest.mark.parametrize(
    ("text", "pairs"),
    [
        (SEEN, (ASSERTS,)),
        (SEEN, (ASSERTS, ("EstP period 60ms", "EstP period 60ms phase 40ms"))),
        (SEEN, (ASSERTS, *ONE_NODE, ("SECOND", "mid"))),
        ("soter 1;\n" + STRAIGHT, ()),
    ],
    ids=["two nodes", "the other one first", "one node, which reads a default", "silent plants"],
)
def test_sc_may_not_fault_on_a_state_beside_a_default(
    tmp_path: Path, text: str, pairs: Pairs
) -> None:
    facts = facts_of(tmp_path, text, *pairs)
    with pytest.raises(NotRecheckedError, match="fault on what it then reads"):
        check_start_answers(facts)


@pytest.mark.parametrize(
    "pairs",
    [(("ASSERT", ""),), (ASSERTS, *ONE_NODE, ("SECOND", "speed"))],
    ids=["nothing to fault on", "one node"],
)
def test_what_is_published_at_once_is_default_at_once(tmp_path: Path, pairs: Pairs) -> None:
    facts = facts_of(tmp_path, SEEN, *pairs)
    assert facts.setting.release_with_state(0, facts.setting.by_sc) > facts.setting.sc.phase
    check_start_answers(facts)


BOTH = (("ASSERT", "let both = pos + vel;"),)
NO_SET = (("topic pos: float in [-9.0, 9.0] = 0.0", "topic pos: float"),)


@all_rows(
    ("pairs", "why"),
    [
        (NO_SET, "of `pos` what was published before all that it reads shows a state, and it has"),
        ((("step { let", "var n: int in [0, 1]; step { let"),), "an SC with locals"),
    ],
)
def test_a_step_before_there_are_states_is_shown_for_all_that_it_may_read_and_keep(
    tmp_path: Path, pairs: Pairs, why: str
) -> None:
    check_start_answers(facts_of(tmp_path, SEEN, *BOTH))
    with pytest.raises(NotRecheckedError, match=why):
        check_start_answers(facts_of(tmp_path, SEEN, *BOTH, *pairs))


# ---------------------------------------------------------------- commands through other modules

STEERED = """soter 1;
topic x: float max_age 30ms;
topic goal: float in [-1.0, 1.0] = 0.0;
topic passed: float in [-1.0, 1.0] = 0.0;
topic motor: float in [-1.0, 1.0] = 0.0;
topic lit: float max_age 30ms;
plant World period 10ms { reads motor; drives x = q; state q: float = 0.0; der q = motor; }
plant Lamp period 10ms { reads goal; drives lit = l; state l: float = 0.0; der l = goal; }
plant Model period 10ms { reads goal; drives x = p; state p: float = 0.0; der p = goal; }
node Relay period 10ms { subscribes goal; publishes passed; step { publish passed = goal; } }
node Fast period 50ms { subscribes x; publishes goal; step { publish goal = 1.0; } }
node Slow period 50ms {
  subscribes x; publishes goal; step { publish goal = clamp(-x, -1.0, 1.0); }
}
node Pilot period 200ms { subscribes goal; publishes motor; step { publish motor = goal; } }
node Hover period 50ms { subscribes x; publishes motor; step { publish motor = 0.0; } }
rta M {
  ac Fast; sc Slow; period 50ms;
  safe abs(x) < 3.0; ttf abs(x) > 2.0; safer abs(x) < 1.0;
  verify { abstracts w by m: Model = { p: w.truth.q }; grid x in [-3.0, 3.0] / 60; }
}
rta Fly {
  ac Pilot; sc Hover; period 200ms;
  safe abs(x) < 9.0; ttf abs(x) > 8.0; safer abs(x) < 7.0;
}
system S { w: World; l: Lamp; node Relay; module M; module Fly; }
"""
"""What M says acts on the lamp at once, and on the world when the AC of another module lets it."""


PILOT = "Pilot period 200ms { subscribes goal"
THROUGH = {
    "its AC": (),
    "its SC": (("ac Pilot; sc Hover;", "ac Hover; sc Pilot;"), ("200ms { sub", "50ms { sub")),
    "a queue": ((PILOT, f"{PILOT} queue 2"), ("publish motor = goal", "publish motor = 0.0")),
    "behind a node": (
        (PILOT, PILOT.replace("goal", "passed")),
        ("publish motor = goal", "publish motor = passed"),
    ),
}


@pytest.mark.parametrize("pairs", THROUGH.values(), ids=list(THROUGH))
def test_commands_that_another_module_passes_on_are_not_followed(
    tmp_path: Path, pairs: Pairs
) -> None:
    with pytest.raises(NotRecheckedError, match=r"`Fly\.Pilot` of another module reads"):
        facts_of(tmp_path, STEERED, *pairs)


def test_commands_that_go_straight_are_followed(tmp_path: Path) -> None:
    pairs = (
        ("reads motor; drives x", "reads goal; drives x"),
        ("der q = motor", "der q = goal"),
        ("Pilot period 200ms { subscribes goal", "Pilot period 200ms { subscribes x"),
        ("publish motor = goal", "publish motor = 1.0"),
    )
    facts = facts_of(tmp_path, STEERED, *pairs)
    assert {e.clocks for e in facts.setting.effects} == {()}


# ---------------------------------------------------------------- what nodes elsewhere say

NODES = {
    "Estimate": "subscribes raw; publishes x; step { publish x = raw; } }",
    "Driver": "subscribes u; publishes force; step { publish force = u; } }",
}
UNDECLARED = ((", Driver 0ms", ""), (", Driver 1ms", ""))


def extern(node: str, says: str) -> tuple[tuple[str, str], ...]:
    """One of the two nodes of a program is an extern that says this of itself."""
    topics = NODES[node].split("step")[0]
    period = {"Estimate": "period 10ms", "Driver": "period 5ms"}[node]
    now = f'extern node {node} {period} from "c:e.c:e" {{ {topics}{says} }}'
    return ((f"node {node} {period} {{ {NODES[node]}", now),)


@pytest.mark.parametrize(
    "pairs",
    [
        extern("Estimate", "jitter 2ms;"),
        extern("Estimate", "wcet 2ms;"),
        extern("Driver", "jitter 1ms;"),
        (*extern("Driver", "jitter 1ms;"), *UNDECLARED),
        (*extern("Driver", "wcet 1us;"), *UNDECLARED),
    ],
    ids=["late sensor", "slow sensor", "late driver", "late in step", "slow in step"],
)
def test_a_node_elsewhere_that_says_longer_times_is_refused_by_both(
    tmp_path: Path, pairs: Pairs
) -> None:
    with pytest.raises(DiffersError, match="says itself that it may be later"):
        facts_of(tmp_path, PROGRAMS["flying"], *pairs)
    flat = system_to_prove(check_file(str(tmp_path / "small.soter")), "S")
    with pytest.raises(SoterError, match="R033"):
        extract(flat, flat.modules[0])


@pytest.mark.parametrize(
    "pairs",
    [
        extern("Estimate", "jitter 1ms; wcet 1ms;"),
        extern("Driver", "wcet 1ms;"),
        (*extern("Driver", ""), *UNDECLARED),
        (*extern("Driver", "jitter 1ms;"), ("Driver 0ms", "Driver 1ms")),
    ],
    ids=["sensor", "driver", "in step", "declared late"],
)
def test_a_node_elsewhere_within_its_times_is_part_of_a_proof(tmp_path: Path, pairs: Pairs) -> None:
    facts_of(tmp_path, PROGRAMS["flying"], *pairs)
    flat = system_to_prove(check_file(str(tmp_path / "small.soter")), "S")
    extract(flat, flat.modules[0])


@pytest.mark.parametrize("inside", [False, True])
def test_a_node_in_a_process_of_its_own_is_not_in_the_thread_of_the_module(
    tmp_path: Path, inside: bool
) -> None:
    """It passes a command on at its next step, unless the system takes it into the thread."""
    pairs: Pairs = (*extern("Driver", ""), *UNDECLARED)
    if inside:
        pairs = (*pairs, ("module M;", "module M; inline Driver;"))
    facts = facts_of(tmp_path, PROGRAMS["flying"], *pairs)
    kinds = [kind for kind, name in facts.ways.notes if name == "Driver"]
    assert ("in step" in kinds, "passes" in kinds) == (inside, not inside)
    flat = system_to_prove(check_file(str(tmp_path / "small.soter")), "S")
    problem = extract(flat, flat.modules[0])
    texts = assumption_texts(problem.assumptions)
    said = [t for t in texts if "Driver" in t and "thread of the module" in t]
    assert bool(said) == inside
    assert problem.times.jitter_sc == facts.times["j_ns"] == (5 if inside else 6) * 1_000_000

"""The problem of a module is what its program says: inputs, ranges, groups, times, assumptions."""

from __future__ import annotations

import math
import random
from pathlib import Path

import pytest

from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.verify.problem import schedule as clock
from soter.verify.problem.extract import extract, parameter_cases
from soter.verify.problem.problem import Interval, Problem, Times, assumption_texts

ROOT = Path(__file__).parents[4]
HEAD = """soter 1;
topic pose: { p: Vec2, h: float } max_age 20ms;
topic goal: float in [-1.0, 1.0];
topic push: { x in [-1.0, 1.0], y in [-2.0, 2.0] };
"""
BOAT = """soter 1;
type Pose = { p: Vec2, h: float };
type Gear = enum { LOW, HIGH };
topic pose: Pose max_age 20ms;
input topic goal: float in [-1.0, 1.0];
topic push: Vec2 in { x in [-1.0, 1.0], y in [-2.0, 2.0] };
topic fuel: float in [0.0, 9.0] max_age 30ms;
plant Boat period 10ms {
  reads push;
  let at = { p: p, h: heading };
  drives pose = at;
  state heading: float in [-0.1, 0.1];
  state p: Vec2 = { x: 1.0, y: -1.0 };
  state v: Vec2;
  state gear: Gear;
  state mass: float in [1.0, 2.0];
  disturbance wind: Vec2 in [-0.5, 0.25];
  der heading = 0.0 - heading;
  der p = v;
  der v = push + wind;
  measured pose.p within 0.125, pose.h within 0.0;
}
plant Tank period 10ms { drives fuel = f; state f: float = 9.0; der f = -0.1; }
node Fast period 20ms {
  subscribes pose;
  publishes push;
  step { publish push = { x: 1.0, y: pose.h }; }
}
node Slow period 20ms phase 5ms {
  subscribes pose, goal;
  publishes push;
  step { publish push = { x: clamp(goal - pose.p.x, -1.0, 1.0), y: 0.0 }; }
}
rta Keep {
  ac Fast;
  sc Slow;
  period 40ms;
  safe abs(pose.p.x) < 9.0;
  ttf abs(pose.p.x) > 2.0;
  safer abs(pose.p.x) < 1.0;
  verify {
    grid pose.p.x in [-9.0, 9.0] / 90, b.v.x in [-2.0, 2.0] / 4;
    grid b.p.y in [-1.0, 1.0] / 2, b.v.y in [-3.0, 3.0] / 3;
    grid pose.h in [-1.0, 1.0] / 1;
    grid b.mass in [1.0, 2.0] / 8;
    late dm 1ms, sc 2ms;
    response sc 3ms;
    horizon 200ms;
    recover within 5s;
    levels 4;
  }
}
system S { b: Boat; t: Tank; module Keep; }
"""


def problem_of(text: str, system: str | None = None) -> Problem:
    checked = check_file("test.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, system)
    return extract(flat, flat.modules[0])


@pytest.fixture(scope="module")
def boat() -> Problem:
    return problem_of(BOAT)


def test_inputs_stand_in_order_with_their_ranges(boat: Problem) -> None:
    q = boat.quantities
    assert [x.name for x in q.states] == [
        "b.heading", "b.p.x", "b.p.y", "b.v.x", "b.v.y", "b.mass",
    ]  # fmt: skip
    assert [x.name for x in q.controls] == ["push.x", "push.y"]
    assert boat.controls == (Interval(-1.0, 1.0), Interval(-2.0, 2.0))
    assert boat.disturbances == (Interval(-0.5, 0.25),) * 2
    assert [x.name for x in q.errors] == ["pose.p.x", "pose.p.y"]  # a bound of zero is no error
    assert boat.errors == (Interval(-0.125, 0.125),) * 2
    assert [x.name for x in q.others] == ["goal"]
    assert boat.others == (Interval(-1.0, 1.0),)


def test_a_plant_that_drives_nothing_the_module_reads_is_left_out(boat: Problem) -> None:
    assert [c.name for c in boat.system.components if c.role == "plant"] == ["b"]
    assert [c.index for c in boat.system.components] == list(range(4))
    assert [m.name for m in boat.system.modules] == ["Keep"]


def test_initial_states_are_points_or_the_declared_ranges(boat: Problem) -> None:
    assert boat.initial[0] == Interval(-0.1, 0.1)
    assert boat.initial[1:3] == (Interval(1.0, 1.0), Interval(-1.0, -1.0))


def test_discrete_states_without_dynamics_are_parameters(boat: Problem) -> None:
    assert [(p.name, p.values) for p in boat.parameters] == [("b.gear", (0, 1))]
    assert list(parameter_cases(boat)) == [(0,), (1,)]


def test_an_axis_is_a_topic_leaf_or_a_state(boat: Problem) -> None:
    names = [[a.name for a in g.axes] for g in boat.groups]
    assert names == [["b.p.x", "b.v.x"], ["b.p.y", "b.v.y"], ["b.heading"], ["b.mass"]]
    x, v = boat.groups[0].axes
    assert (x.state, v.state) == (1, 3)
    assert x.edges[0] == -9.0
    assert x.edges[-1] == 9.0
    assert len(x.edges) == 91
    assert boat.states[0] == Interval(-1.0, 1.0)


def test_every_topic_leaf_that_is_a_state_is_known(boat: Problem) -> None:
    pose = boat.system.topic("pose").index
    assert boat.topic_leaf_of_state == {1: (pose, 0), 2: (pose, 1), 0: (pose, 2)}


def test_times_are_read_off(boat: Problem) -> None:
    t = boat.times
    ms = 1_000_000
    assert (t.delta_dm, t.delta_sc, t.phase_sc) == (40 * ms, 20 * ms, 5 * ms)
    assert (t.age_dm, t.age_sc) == (20 * ms, 20 * ms)
    assert (t.late_dm, t.late_sc, t.response_dm, t.response_sc) == (ms, 2 * ms, 0, 3 * ms)
    assert t.declared == {"late_dm", "late_sc", "response_sc", "nodes"}
    assert t.h_star == (20 + 40 + 7 + 3) * ms  # G = 20 - 20 + 5, late by 2
    assert t.horizon_ns == 200 * ms
    assert (t.delay_sc, t.jitter_sc, t.between_states, t.start) == (
        23 * ms,
        5 * ms,
        61 * ms,
        10 * ms,
    )
    assert boat.recover_ns == 5_000 * ms
    assert boat.levels == 4


def test_assumptions_name_what_is_not_declared_and_what_is(boat: Problem) -> None:
    text = "\n".join(assumption_texts(boat.assumptions))
    for word in (
        "b.wind.x in [-0.5, 0.25]",
        "pose.p.x within 0.125",
        "late dm 1 ms",
        "undeclared times are zero: response dm",
    ):
        assert word in text
    assert "b.gear changes only while" in text


def test_h_star_is_the_worst_case_over_all_releases() -> None:
    draw = random.Random(7)  # noqa: S311 - no secrets
    for _ in range(300):
        delta_sc, delta_dm = sorted(draw.choices((4, 5, 6, 10, 12, 15, 20), k=2))
        late = [draw.randrange(4) for _ in range(4)]
        dm = clock.Releases(delta_dm, draw.randrange(delta_dm), late[0], late[2])
        sensor = clock.SensorPath(clock.Releases(1), max_age=draw.randrange(9))
        sc = clock.Releases(delta_sc, draw.randrange(delta_sc), late[1], late[3])
        acts = clock.ActuationPath(most=draw.randrange(4))
        times = Times(clock.Schedule(dm, sc, (sensor,), (sensor,), (acts,)))
        worst = 0
        for k in range(math.lcm(delta_dm, delta_sc) // delta_dm):
            sample = times.phase_dm + k * delta_dm - times.age_dm
            at = times.phase_dm + (k + 1) * delta_dm
            due = times.phase_sc + max(0, -(-(at - times.phase_sc) // delta_sc)) * delta_sc
            begins = max(at + times.late_dm + times.response_dm, due + times.late_sc)
            worst = max(worst, begins + times.response_sc + times.acts - sample)
        assert worst == times.schedule.h_star


def test_abstractions_take_the_place_of_the_plants_that_fly() -> None:
    text = BOAT.replace(
        "verify {", "verify { abstracts b by m: Model = { x: b.truth.p.x, u: 0.0 };"
    )
    text = text.replace("grid pose.p.x in [-9.0, 9.0] / 90, b.v.x in [-2.0, 2.0] / 4;", "")
    text = text.replace("grid b.p.y in [-1.0, 1.0] / 2, b.v.y in [-3.0, 3.0] / 3;", "")
    text = text.replace("grid pose.h in [-1.0, 1.0] / 1;", "grid m.x in [-9.0, 9.0] / 90;")
    text = text.replace("grid b.mass in [1.0, 2.0] / 8;", "grid m.u in [-1.0, 1.0] / 2;")
    text = text.replace("plant Tank", """plant Model period 20ms {
  reads push;
  drives pose = { p: { x: x, y: 0.0 }, h: 0.0 };
  state x: float;
  state u: float;
  der x = push.x;
  der u = -u;
}
plant Tank""")  # fmt: skip
    problem = problem_of(text)
    assert [x.name for x in problem.quantities.states] == ["m.x", "m.u"]
    assert [c.name for c in problem.system.components if c.role == "plant"] == ["m"]
    assert problem.assumptions[0].text.startswith("b behaves like m (Model)")
    assert problem.plant_period_ns == 20_000_000


def test_without_a_grid_the_sets_of_the_topics_bound_the_states() -> None:
    text = """soter 1;
topic x: float in [-4.0, 4.0] max_age 20ms;
topic u: float in [-1.0, 1.0];
plant P period 10ms { reads u; drives x = p; state p: float; der p = u; }
node Fast period 20ms { subscribes x; publishes u; step { publish u = clamp(2.0 - x, -1.0, 1.0); } }
node Slow period 20ms { subscribes x; publishes u; step { publish u = clamp(-x, -1.0, 1.0); } }
rta M { ac Fast; sc Slow; period 20ms; safe abs(x) < 3.0; }
system S { p: P; module M; }
"""
    problem = problem_of(text)
    assert problem.states == (Interval(-4.0, 4.0),)
    assert problem.computed
    assert problem.levels == 3


def test_a_map_has_no_ages_and_counts_in_steps() -> None:
    text = """soter 1;
topic x: float in [-4.0, 4.0] max_age 15ms;
topic u: float in [-1.0, 1.0];
plant P period 20ms { reads u; drives x = p; state p: float; next p = p + 0.02 * u; }
node Fast period 20ms { subscribes x; publishes u; step { publish u = clamp(2.0 - x, -1.0, 1.0); } }
node Slow period 20ms { subscribes x; publishes u; step { publish u = clamp(-x, -1.0, 1.0); } }
rta M { ac Fast; sc Slow; period 40ms; safe abs(x) < 3.0; }
system S { p: P; module M; }
"""
    problem = problem_of(text)
    assert problem.kind == "map"
    assert problem.times.h_star == 40_000_000
    assert (problem.times.delay_sc, problem.times.jitter_sc) == (0, 0)


def test_a_controller_that_is_to_be_found_has_its_commands() -> None:
    text = BOAT.replace("sc Slow;", "sc synthesized period 20ms;").replace(
        "levels 4;", "commands push.x in { 1.0, -1.0, 0.5 };"
    )
    checked = check_file("test.soter", text)
    flat = system_of(checked, None)
    with pytest.raises(SoterError, match="R004"):
        extract(flat, flat.modules[0])
    problem = extract(flat, flat.modules[0], synthesize=True)
    assert problem.commands == ((-1.0, 0.5, 1.0), (-2.0, 0.0, 2.0))


def test_the_cart_of_the_readme_is_a_problem() -> None:
    checked = check_file(str(ROOT / "examples" / "wall" / "cart.soter"))
    flat = system_of(checked, None)
    problem = extract(flat, flat.modules[0])
    assert [x.name for x in problem.quantities.inputs] == [
        "c.x", "c.v", "accel", "c.wind", "motion.x", "motion.v",
    ]  # fmt: skip

"""What the actors of a test are: calendars, which steps commute, what properties may see."""

from __future__ import annotations

import random
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from generators.explorer_configurations import asking_stream, packed_bits, replay
from soter.core.steps import lower
from soter.explore.engine.explorer_library import Engine, RawChoice, RawStep
from soter.explore.model.exploration_plan import make_plan
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from soter.explore.model.exploration_plan import ExplorationPlan, PlannedActor

PROGRAMS = Path(__file__).parent / "programs"
EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
RICH = PROGRAMS / "rich.soter"
TWO = EXAMPLES / "testing" / "two_modules.soter"
MS = 1_000_000

BASE = """soter 1;
topic out: float in [-1.0, 1.0];
topic seen: bool;
{topics}
{plant}
node Reader period 20ms {{ subscribes out; publishes seen; step {{ publish seen = {reads}; }} }}
system S {{ {instances} node Reader; {inputs} }}
test T {{ system S; horizon 100ms; always seen || !seen; {items} }}
"""
INPUT = "input topic out: float in [-1.0, 1.0];"


def planned(
    *,
    reads: str = "out > 0.0",
    items: str = "",
    plant: str = "",
    instances: str = "",
    inputs: str = "",
    max_age: str = "",
) -> ExplorationPlan:
    text = BASE.format(
        topics="", plant=plant, reads=reads, instances=instances, inputs=inputs, items=items
    )
    if not plant:
        text = text.replace("topic out:", "input topic out:").replace(
            "node Reader; ", "node Reader; input out in { 0.5, -0.5 } every 20ms; " if not inputs
            else "node Reader; ",
        )  # fmt: skip
    if max_age:
        text = text.replace("1.0];", f"1.0] max_age {max_age};", 1)
    checked = check_file("t.soter", text)
    assert checked.ok, [(d.code, d.message) for d in checked.diagnostics.items]
    system = system_of_test(checked, "T")
    return make_plan(system, lower(system))


def plan_in(path: Path, test: str) -> ExplorationPlan:
    system = system_of_test(check_file(str(path)), test)
    return make_plan(system, lower(system))


def by_name(plan: ExplorationPlan) -> dict[str, PlannedActor]:
    return {a.name: a for a in plan.actors}


def dependent(plan: ExplorationPlan, name: str) -> set[str]:
    mask = by_name(plan)[name].dependent
    return {a.name for i, a in enumerate(plan.actors) if mask >> i & 1}


# ---------------------------------------------------------------- dependence


def test_two_modules_that_share_nothing_are_independent() -> None:
    plan = plan_in(TWO, "BothStayInside")
    for a in plan.actors:
        side = a.name.split(".")[0]
        assert dependent(plan, a.name) == {
            b.name for b in plan.actors if b.name.startswith(f"{side}.")
        }


def test_dependence_is_mutual_and_everybody_depends_on_itself() -> None:
    plan = plan_in(RICH, "Late")
    for i, a in enumerate(plan.actors):
        assert a.dependent >> i & 1
        for j, b in enumerate(plan.actors):
            assert a.dependent >> j & 1 == b.dependent >> i & 1


def test_controllers_depend_on_their_dm_on_each_other_and_on_what_they_read() -> None:
    plan = plan_in(RICH, "Late")
    module = {"Keep.dm", "Keep.Home", "Keep.AnyMove"}
    assert dependent(plan, "Keep.dm") == {*module, "place"}
    assert dependent(plan, "Keep.AnyMove") == {*module, "place", "input.hue"}
    assert dependent(plan, "input.hue") == {"input.hue", "Keep.AnyMove"}


def test_who_pushes_into_a_queue_depends_on_who_empties_it() -> None:
    plan = plan_in(RICH, "Late")
    assert "Listener" in dependent(plan, "Talker")
    assert "Listener" in dependent(plan, "place")


ASKING = {"input.hue", "Keep.AnyMove", "left.Keeper.Anything", "right.Keeper.Anything"}
"""Actors whose steps ask once, for one of three."""


def walk(engine: Engine, seed: int) -> list[RawStep]:
    """One execution without skew: all steps of every instant, in a random order."""
    draw = random.Random(seed)  # noqa: S311 - an execution
    steps = [RawStep(-1, 4, -1, -1, ())]
    for now in range(0, engine.plan.horizon_ns + 1, engine.plan.tick_ns):
        due = [
            i
            for i, a in enumerate(engine.actors)
            if now >= a.phase_ns and (now - a.phase_ns) % a.period_ns == 0
        ]
        draw.shuffle(due)
        for i in due:
            name = engine.actors[i].name
            asked = RawChoice(asking_stream(name), 3, draw.randrange(3)) if name in ASKING else None
            choices = () if asked is None else (asked,)
            steps.append(RawStep(i, 0, now, now, choices))
    return steps


@pytest.mark.parametrize(("path", "test"), [(RICH, "Instants"), (TWO, "BothStayInside")])
def test_independent_steps_of_an_instant_may_be_swapped(path: Path, test: str) -> None:
    engine = Engine(system_of_test(check_file(str(path)), test))
    swapped = 0
    for seed in range(40):
        steps = walk(engine, seed)
        possible, _, configurations = replay(engine, steps)
        for k in range(2, possible):
            a, b = steps[k - 1], steps[k]
            if a.time_ns != b.time_ns or engine.actors[a.actor].dependent >> b.actor & 1:
                continue
            done, _, after = replay(engine, [*steps[: k - 1], b, a])
            assert done == k + 1
            assert (
                packed_bits(engine, after[k]) == packed_bits(engine, configurations[k])
            ).all(), (seed, k)
            swapped += 1
    assert swapped > 100


def test_a_step_changes_only_what_its_footprint_says() -> None:
    engine = Engine(system_of_test(check_file(str(RICH)), "Instants"))
    model, looked = engine.model, 0
    for seed in range(40):
        steps = walk(engine, seed)
        possible, _, configurations = replay(engine, steps)
        looked += possible
        for k in range(1, possible):
            if steps[k].time_ns != steps[k - 1].time_ns:
                continue  # ages are relative to now
            before, after = (
                packed_bits(engine, configurations[k - 1]),
                packed_bits(engine, configurations[k]),
            )
            writes = model.actor[steps[k].actor].writes
            for word in range(engine.words):
                may = int(writes[word]) | int(model.scheduled[word])
                assert (int(before[word]) ^ int(after[word])) & ~may == 0, (seed, k, word)
    assert looked > 400


# ---------------------------------------------------------------- what properties see


def test_only_what_a_property_reads_is_visible() -> None:
    plan = plan_in(TWO, "BothStayInside")
    assert {a.name for a in plan.actors if a.visible} == {"left.robot", "right.robot"}


def test_an_invariant_sees_its_module_and_what_its_safe_reads() -> None:
    plan = plan_in(RICH, "Late")
    seen = {a.name for a in plan.actors if a.visible}
    assert {"Keep.dm", "Keep.Home", "Keep.AnyMove", "place", "Listener", "Talker"} <= seen
    assert "input.hue" not in seen


# ---------------------------------------------------------------- calendars


def test_skew_and_lateness_widen_windows_but_not_those_of_plants_and_inputs() -> None:
    actors = by_name(plan_in(RICH, "Late"))
    windows = {name: a.window_ns // MS for name, a in actors.items()}
    assert windows == {
        "input.hue": 0,
        "place": 0,
        "Keep.dm": 5,
        "Keep.Home": 10,
        "Keep.AnyMove": 5,
        "Talker": 5,
        "Listener": 5,
    }
    assert actors["Keep.Home"].overrun_ns == 10 * MS
    assert actors["Keep.AnyMove"].skips == 2
    assert actors["Talker"].phase_ns == 5 * MS


def test_the_grid_is_the_greatest_common_divisor_unless_declared() -> None:
    plan = plan_in(RICH, "Late")
    assert (plan.quantum_ns, plan.tick_ns) == (5 * MS // 2, 5 * MS // 2), "as declared"
    finer = planned(items="skew 8ms; quantum 3ms; eventually seen within 7ms;")
    assert (finer.quantum_ns, finer.tick_ns) == (3 * MS, MS)


def test_inputs_come_first_then_the_deployed_order() -> None:
    names = [a.name for a in plan_in(RICH, "Late").actors]
    assert names == [
        "input.hue", "place", "Keep.dm", "Keep.Home", "Keep.AnyMove", "Talker", "Listener",
    ]  # fmt: skip


# ---------------------------------------------------------------- time and continua


@pytest.mark.parametrize(
    ("reads", "items", "timely"),
    [
        ("out > 0.0", "", False),
        ("out > 0.0", "skew 2ms;", False),
        ("time > 0.5", "", False),
        ("time > 0.5", "skew 2ms;", True),
        ("age(out) > 0.5", "late Reader by 2ms;", True),
        ("out > 0.0", "skew 2ms; eventually seen within 50ms;", True),
        ("out > 0.0", "overrun Reader by 2ms;", True),
        ("out > 0.0", "skip Reader at most 2;", False),
    ],
)
def test_time_matters_where_something_sees_it_and_something_has_a_choice(
    reads: str, items: str, timely: bool
) -> None:
    assert planned(reads=reads, items=items).timely == timely


def plant(state: str = "0.0", wind: str = "", measured: str = "") -> dict[str, str]:
    text = (
        f"plant P period 10ms {{ drives out = x; state x: float {state}; {wind}"
        f" next x = max(-0.5, min(0.5, x {'+ wind' if wind else ''})); {measured} }}"
    )
    return {"plant": text, "instances": "p: P;"}


@pytest.mark.parametrize(
    ("what", "sampled"),
    [
        (plant("= 0.0"), False),
        (plant("in [-0.1, 0.1]"), True),
        (plant("in [0.1, 0.1]"), False),
        (plant("= 0.0", "disturbance wind: float in [-0.1, 0.1];"), True),
        (plant("= 0.0", "disturbance wind: float in [0.1, 0.1];"), False),
        (plant("= 0.0", "disturbance wind: float in [-0.1, 0.1] hold 50ms;"), True),
        (plant("= 0.0", "", "measured out within 0.1;"), True),
        ({}, False),
        ({"inputs": "input out every 20ms;"}, True),
    ],
)
def test_a_continuum_is_sampled_where_a_float_is_drawn(what: dict[str, str], sampled: bool) -> None:
    assert planned(**what).sampled == sampled

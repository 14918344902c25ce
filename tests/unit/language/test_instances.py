"""Instances with parameters of their own, arrays of instances, wires between instances."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.codegen.unit import generate
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import CheckResult, check_file, system_of, system_of_test
from soter.simulate.run_options import param_values

if TYPE_CHECKING:
    from soter.language.model.system import System

HEAD = """soter 1;
param GAIN: float = 1.0 in [0.0, 9.0];
param PERIOD: duration = 10ms;
topic pos: float in [-90.0, 90.0];
input topic near: float in [-90.0, 90.0];
topic warned: bool;
plant Point period 10ms { drives pos = clamp(x, -90.0, 90.0); state x: float = GAIN;
  der x = law(); }
fun law(): float { return twice(GAIN); }
fun twice(x: float): float { return 2.0 * x; }
node Watch period PERIOD { subscribes near, pos; publishes warned;
  step { publish warned = near > GAIN; } }
system Robot { p: Point; node Watch; always pos < GAIN * 99.0; }
"""
PAIR = "system Pair { a: Robot { set GAIN = 3.0 }; b: Robot; }\n"


def checked(text: str) -> CheckResult:
    fleet = check_file("fleet.soter", HEAD + text)
    assert fleet.ok, [(d.code, d.message) for d in fleet.diagnostics.items]
    return fleet


def flat(text: str, overrides: dict[str, float] | None = None) -> System:
    return system_of(checked(text), "S", overrides)


def start(system: System, plant: str) -> float:
    """What GAIN is in a plant."""
    (value,) = system.component(plant).initial
    assert isinstance(value, float)
    return value


# ---------------------------------------------------------------- whose value holds


@pytest.mark.parametrize(
    ("text", "overrides", "a", "b"),
    [
        ("system S { a: Robot; b: Robot; }", {}, 1.0, 1.0),
        ("system S { a: Robot; b: Robot; set GAIN = 2.0; }", {}, 2.0, 2.0),
        ("system S { a: Robot { set GAIN = 3.0 }; b: Robot; set GAIN = 2.0; }", {}, 3.0, 2.0),
        ("system S { a: Robot { set GAIN = 3.0 }; b: Robot; }", {"GAIN": 4.0}, 3.0, 4.0),
        ("system S { a: Robot { set GAIN = 3.0 }; b: Robot; }", {"a.GAIN": 4.0}, 4.0, 1.0),
        ("system S { a: Robot { set p.GAIN = 3.0 }; b: Robot; set b.p.GAIN = 5.0; }", {}, 3.0, 5.0),
        ("system S { a: Robot { set p.GAIN = 3.0 }; b: Robot; }", {"a.GAIN": 4.0}, 3.0, 1.0),
        ("system S { a: Robot { set p.GAIN = 3.0 }; b: Robot; }", {"a.p.GAIN": 4.0}, 4.0, 1.0),
    ],
    ids=range(8),
)
def test_who_speaks_last_of_an_instance_wins(
    text: str, overrides: dict[str, float], a: float, b: float
) -> None:
    system = flat(text, overrides)
    assert (start(system, "a.p"), start(system, "b.p")) == (a, b)


def test_outer_systems_speak_after_inner_ones() -> None:
    system = flat(PAIR + "system S { x: Pair { set GAIN = 5.0 }; y: Pair; set y.a.GAIN = 6.0; }")
    plants = ("x.a.p", "x.b.p", "y.a.p", "y.b.p")
    assert [start(system, p) for p in plants] == [3.0, 5.0, 6.0, 1.0]


def test_a_test_sets_on_top_of_its_system() -> None:
    both = checked(
        PAIR + "system S { x: Pair; y: Pair { set GAIN = 4.0 }; set GAIN = 2.0; }\n"
        "test T { system S; horizon 20ms; set GAIN = 7.0; set x.a.GAIN = 8.0;"
        " always x.a.pos < 99.0; }"
    )
    system = system_of_test(both, "T")
    plants = ("x.a.p", "x.b.p", "y.a.p", "y.b.p")
    assert [start(system, p) for p in plants] == [8.0, 7.0, 3.0, 4.0]
    again = system_of_test(both, "T", {"x.b.GAIN": 0.5})
    assert [start(again, p) for p in plants] == [8.0, 0.5, 3.0, 4.0]


def test_what_is_told_of_parameters_gives_the_same_system_again() -> None:
    text = PAIR + "system S { for i in 0..2 { x[i]: Pair { set b.GAIN = float(i) }; } }"
    one = system_of(checked(text), "S", {"x[1].a.GAIN": 5.0})
    assert one.params == {
        "GAIN": 1.0,
        "PERIOD": 10_000_000,
        **{f"x[{i}].{n}.GAIN": v for i in (0, 1) for n, v in (("a", 3.0 + 2 * i), ("b", float(i)))},
    }
    again = system_of(checked(text), "S", one.params)
    assert again.params == one.params
    assert [c.initial for c in again.components] == [c.initial for c in one.components]


def test_periods_of_instances_are_their_own() -> None:
    system = flat("system S { for i in 1..4 { r[i]: Robot { set PERIOD = 5ms * i }; } }")
    periods = [system.component(f"r[{i}].Watch").period_ns for i in (1, 2, 3)]
    assert periods == [5_000_000, 10_000_000, 15_000_000]


def test_topics_belong_to_systems_and_not_to_nodes() -> None:
    head = HEAD.replace("pos: float in [-90.0, 90.0]", "pos: float in [-9.0 * GAIN, 9.0]")
    text = head + "system S { p: Point { set GAIN = 2.0 }; q: Robot { set GAIN = 3.0 }; }"
    fleet = check_file("fleet.soter", text)
    assert fleet.ok
    system = system_of(fleet, "S")
    lows = {t.name: t.bounds[0].low for t in system.topics if t.bounds[0] is not None}
    assert (lows["pos"], lows["q.pos"]) == (-9.0, -27.0)
    assert (start(system, "p"), start(system, "q.p")) == (2.0, 3.0)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("c.GAIN", "no system has an instance `c`"),
        ("a.GAIM", "there is no parameter `a.GAIM`"),
        ("a.p.q.GAIN", "no system has an instance `a.p.q`"),
    ],
)
def test_a_parameter_of_nobody_is_refused(name: str, message: str) -> None:
    program = checked(PAIR).program
    assert program is not None
    with pytest.raises(SoterError, match=message) as caught:
        param_values(program, {name: 2.0})
    assert [d.code for d in caught.value.diagnostics] == ["U004"]


def test_a_parameter_of_another_system_is_refused() -> None:
    both = checked(PAIR + "system S { c: Robot; }")
    with pytest.raises(SoterError) as caught:
        system_of(both, "S", {"a.GAIN": 2.0})
    assert [d.code for d in caught.value.diagnostics] == ["U004"]
    assert system_of(both, "S", {"a.GAIN": 2.0}, exact=False).params["GAIN"] == 1.0


# ---------------------------------------------------------------- arrays


def test_loops_are_what_they_are_written_out_as() -> None:
    loops = flat(
        "const N: int = 2; system S { for i in 0..N { for j in i + 1..N + 1 {"
        " g[i][j]: Robot { near = h.near, set GAIN = float(i + 2 * j) };"
        " never g[i][j].warned && g[i][j].pos > float(i); } } h: Robot; }"
    )
    plain = flat(
        "system S { g[0][1]: Robot { near = h.near, set GAIN = 2.0 };"
        " g[0][2]: Robot { near = h.near, set GAIN = 4.0 };"
        " g[1][2]: Robot { set GAIN = 5.0, near = h.near }; h: Robot;"
        " never g[0][1].warned && g[0][1].pos > float(0);"
        " never g[0][2].warned && g[0][2].pos > float(0);"
        " never g[1][2].warned && g[1][2].pos > float(1); }"
    )
    assert [t.name for t in loops.topics] == [t.name for t in plain.topics]
    told = [(c.name, c.period_ns, c.initial) for c in loops.components]
    assert told == [(c.name, c.period_ns, c.initial) for c in plain.components]
    assert [p.text for p in loops.properties] == [p.text for p in plain.properties]
    assert loops.params == plain.params
    assert loops.properties[1].text == "g[0][2].warned && g[0][2].pos > float(0)"


def test_bounds_and_indices_may_come_from_constant_arrays() -> None:
    system = flat(
        "const AT: int[3] = [2, 0, 1]; const ENDS: int[2] = [0, 3];"
        " system S { for i in ENDS[0]..ENDS[1] { r[AT[i]]: Robot { near = r[AT[2 - i]].pos }; } }"
    )
    assert [c.name for c in system.components if c.plant] == ["r[2].p", "r[0].p", "r[1].p"]
    assert topics(system)["r[2].Watch"][0] == "r[1].pos"


def test_loops_of_no_rounds_leave_a_system_empty() -> None:
    fleet = check_file("fleet.soter", HEAD + "system S { for i in 2..2 { r[i]: Robot; } }")
    assert [d.code for d in fleet.diagnostics.items] == ["M006"]


def test_names_of_elements_stay_apart_in_c() -> None:
    system = flat("system S { r[0]: Robot; r_0: Robot; r[1]: Robot; }")
    unit = generate(system, prefix="f")
    assert len(set(unit.names.values())) == len(unit.names)
    assert unit.names[system.component("r[0].Watch").index] == "f_r_0_Watch"
    assert "r_0_pos" in unit.header


def test_everything_of_a_test_stands_in_loops() -> None:
    both = checked(
        "node Idle period 10ms { publishes warned; step { publish warned = false; } }\n"
        "system S { for i in 0..3 { r[i]: Robot; } }\n"
        "test T { system S; horizon 30ms; for i in 0..2 { replace r[i].Watch by Idle;"
        " late r[i + 1].Watch by 1ms * (i + 1); skip r[i].Watch at most i + 1;"
        " eventually r[i].pos > 0.0 within 20ms; r[i].warned leadsto !r[i].warned within 10ms;"
        " always r[i].pos < 50.0; set r[i].GAIN = float(i);"
        " input r[i].near in { 1.0, 2.0 } every 10ms; }"
        " input r[2].near every 10ms; }"
    )
    system = system_of_test(both, "T")
    assert system.test is not None
    assert [c.node.name for c in system.components if c.node] == ["Idle", "Idle", "Watch"]
    name = [c.name for c in system.components]
    faults = [(f.kind, name[f.component], f.by_ns, f.at_most) for f in system.test.faults]
    assert faults == [
        ("late", "r[1].Watch", 1_000_000, 0),
        ("skip", "r[0].Watch", 0, 1),
        ("late", "r[2].Watch", 2_000_000, 0),
        ("skip", "r[1].Watch", 0, 2),
    ]
    assert [t.text for t in system.test.timed] == [
        "eventually r[0].pos > 0.0 within 20ms",
        "r[0].warned leadsto !r[0].warned within 10ms",
        "eventually r[1].pos > 0.0 within 20ms",
        "r[1].warned leadsto !r[1].warned within 10ms",
    ]
    assert [p.text for p in system.properties[-2:]] == ["r[0].pos < 50.0", "r[1].pos < 50.0"]
    assert len(system.inputs) == 3


# ---------------------------------------------------------------- wires


def topics(system: System) -> dict[str, list[str]]:
    """Of every component the topics that its code names, in order."""
    names = [t.name for t in system.topics]
    return {c.name: [names[i] for i in c.scope.topics.values()] for c in system.components}


def test_wires_lead_to_other_instances_whatever_their_order() -> None:
    system = flat(
        "system S { a: Robot { near = b.pos }; b: Robot { near = c.near };"
        " c: Robot { near = a.pos }; node Watch { near = c.near, pos = b.pos }; }"
    )
    read = topics(system)
    assert read["a.Watch"] == ["b.pos", "a.pos", "a.warned"]
    assert read["b.Watch"] == ["a.pos", "b.pos", "b.warned"]
    assert read["c.Watch"] == ["a.pos", "c.pos", "c.warned"]
    assert read["Watch"] == ["a.pos", "b.pos", "warned"]


def test_wires_lead_into_and_out_of_systems_of_systems() -> None:
    system = flat(
        "system Two { for i in 0..2 { r[i]: Robot { near = r[1 - i].pos }; } }\n"
        "system Open { a: Robot; b: Robot { near = a.pos }; "
        "node Watch { near = near, pos = b.pos }; }\n"
        "system S { t: Two; o: Open { near = t.r[1].pos }; l: Robot { near = o.a.pos }; }"
    )
    read = topics(system)
    assert read["t.r[0].Watch"][0] == "t.r[1].pos"
    assert read["o.Watch"][:2] == ["t.r[1].pos", "o.b.pos"]
    assert read["o.b.Watch"][0] == "o.a.pos"
    assert read["o.a.Watch"][0] == "o.a.near"
    assert read["l.Watch"][0] == "o.a.pos"

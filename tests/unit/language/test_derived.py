"""Systems made of systems: what is left, what is answered and driven from outside."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from generators.engine_comparison import (
    Subject,
    compile_library,
    interpreted_trace,
    native_trace,
    until_of,
)
from generators.file_listing import files_below
from soter.core.layout import state_layout
from soter.language.elaborate import derived_systems
from soter.language.front_end import check_file, system_of

if TYPE_CHECKING:
    from soter.language.model.system import Component, System

SOURCES = files_below(Path(__file__).resolve().parents[3] / "src" / "soter", "*.py")

VEHICLE = """
topic pose#: float in [-9.0, 9.0] max_age 20ms;
input topic goal#: float in [-5.0, 5.0] = 1.0;
topic push#: float in [-1.0, 1.0] = 0.0;
plant Body# period 5ms {
  reads push#;
  drives pose# = x;
  state x: float = 0.0;
  der x = push#;
  measured pose# within 0.1;
}
node Fast# period 10ms {
  subscribes pose#, goal#;
  publishes push#;
  step { publish push# = clamp(READ * (goal# - pose#), -1.0, 1.0); }
}
node Safe# period 10ms {
  subscribes pose#;
  publishes push#;
  guarantees push# <= 1.0;
  step { publish push# = clamp(-pose#, -1.0, 1.0); }
}
rta Keep# {
  ac Fast#;
  sc Safe#;
  period 20ms;
  safe abs(pose#) < 8.0;
  ttf abs(pose#) > 4.0;
  safer abs(pose#) < 3.0;
}
"""
PROGRAM = (
    "soter 1;"
    + VEHICLE.replace("#", "1").replace("READ", "1.0")
    + VEHICLE.replace("#", "2").replace("READ", "(mode(Keep2) == Mode.AC ? 1.0 : 0.5)")
    + VEHICLE.replace("#", "3").replace("READ", "(mode(Keep2) == Mode.AC ? 1.0 : 0.5)")
    + """
system Three {
  a: Body1;
  b: Body2;
  c: Body3;
  module Keep1;
  module Keep2;
  module Keep3;
  input goal1 every 30ms;
  until 1s;
  always abs(b.truth.x) < 100.0;
  always abs(pose2) < 100.0;
  never mode(Keep2) == Mode.AC && pose2 > 8.5;
}
"""
)


@pytest.fixture
def three() -> System:
    return system_of(check_file("three.soter", PROGRAM), "Three")


def names(system: System) -> list[str]:
    assert [c.index for c in system.components] == list(range(len(system.components)))
    assert [p.index for p in system.properties] == list(range(len(system.properties)))
    return [c.name for c in system.components]


def parts(system: System, *modules: str) -> list[int]:
    selection = [m for m in system.modules if m.name in modules]
    return [i for m in selection for i in (m.dm, m.ac, m.sc)]


def ac(system: System, module: str) -> Component:
    return next(system.components[m.ac] for m in system.modules if m.name == module)


def test_what_is_left_is_numbered_anew(three: System) -> None:
    left = derived_systems.with_only(three, parts(three, "Keep2", "Keep3"))
    assert names(left) == [
        *("Keep2.dm", "Keep3.dm", "Keep2.Safe2", "Keep3.Safe3", "Keep2.Fast2", "Keep3.Fast3")
    ]
    assert [(m.index, m.name) for m in left.modules] == [(0, "Keep2"), (1, "Keep3")]
    for m in left.modules:
        roles = [(left.components[i].role, left.components[i].module) for i in (m.dm, m.ac, m.sc)]
        assert roles == [("dm", m.index), ("ac", m.index), ("sc", m.index)]
    assert set(ac(left, "Keep3").scope.modules.values()) == {0}
    assert [(p.kind, p.component) for p in left.properties] == [
        ("always", None),
        ("never", None),
        ("guarantees", 2),
        ("guarantees", 3),
    ]


def test_who_reads_the_mode_of_what_went_is_answered_from_outside(three: System) -> None:
    left = derived_systems.with_only(three, parts(three, "Keep1", "Keep3"))
    assert [c.name for c in left.components if c.extern] == ["Keep3.Fast3"]
    assert "never" not in [p.kind for p in left.properties]


def without_plants(system: System) -> System:
    """What is deployed: the world publishes what its plants drove and what was drawn.

    Properties that read the state of a plant go with it.
    """
    driven = [
        c.scope.topics[t]
        for c in system.components
        if c.plant is not None
        for t, _ in c.plant.drives
    ]
    nodes = [c.index for c in system.components if c.plant is None]
    topics = {*driven, *(i.topic for i in system.inputs)}
    left = derived_systems.with_only(system, nodes)
    return replace(
        left,
        topics=tuple(
            replace(t, driver=derived_systems.OUTSIDE) if {t.index, t.queue_of} & topics else t
            for t in left.topics
        ),
        inputs=(),
    )


def test_the_given_system_stays_as_it_is(three: System) -> None:
    before = [(c.index, c.module, c.extern, dict(c.scope.modules)) for c in three.components]
    drivers = [t.driver for t in three.topics]
    left = derived_systems.without_bindings(without_plants(three))
    left.modules[0].scope.topics.clear()
    for c in left.components:
        c.scope.topics.clear()
    assert [(c.index, c.module, c.extern, c.scope.modules) for c in three.components] == before
    assert [t.driver for t in three.topics] == drivers
    assert all(m.scope.topics for m in three.modules)
    assert all(c.scope.topics for c in three.components)


def test_without_its_plants_the_world_publishes_what_they_drove(three: System) -> None:
    left = without_plants(three)
    assert not any(c.plant for c in left.components)
    assert len(left.components) == len(three.components) - 3
    outside = {t.name for t in left.topics if t.driver == derived_systems.OUTSIDE}
    assert outside == {f"{t}{i}" for t in ("pose", "goal") for i in (1, 2, 3)}
    assert left.inputs == ()
    assert [p.text for p in left.properties][:2] == [p.text for p in three.properties][1:3]
    assert left.until_ns == three.until_ns


def test_topics_are_those_of_the_instance(three: System) -> None:
    for c in three.components:
        place = c.scope.topics
        if c.plant is not None:
            assert c.writes == [place[t] for t, _ in c.plant.drives] != []
            assert c.reads == [place[t] for t in c.plant.reads]
        elif c.node is not None:
            assert c.writes == [place[t] for t in c.node.publishes] != []
            assert c.reads == [place[s.topic] for s in c.node.subscribes]
        else:
            assert c.writes == c.reads == [], "a DM"
    assert len({tuple(c.writes) for c in three.components if c.plant}) == 3


def test_a_queue_of_what_a_plant_drove_is_filled_from_outside() -> None:
    text = """soter 1;
topic hit: float in [0.0, 1.0] = 0.0;
topic sum: float in [0.0, 9.0] = 0.0;
plant World period 10ms { drives hit = x; state x: float = 0.5; der x = 0.0; }
node Add period 20ms {
  subscribes hit queue 4;
  publishes sum;
  step { publish sum = 1.0; }
}
system S { w: World; n: Add; until 1s; }
"""
    system = system_of(check_file("queue.soter", text), "S")
    left = without_plants(system)
    assert [t.driver for t in left.topics if t.queue_of is not None] == [derived_systems.OUTSIDE]
    hit = system.topic("hit")
    twice, twin = derived_systems.with_topic(system, hit, hit.symbol, "hit")
    assert twice.topics[hit.index].queues == hit.queues != ()
    assert twin.queues == (), "its values are no publications on the other"


def test_both_engines_run_a_system_without_its_plants(three: System, tmp_path: Path) -> None:
    left = without_plants(three)
    s = Subject("left", PROGRAM, left, state_layout(left), until_of(left, 50), 7)
    native = native_trace(compile_library([s], tmp_path, "-O2"), s)
    assert len(native) == 50
    assert (interpreted_trace(s) == native).all()
    modes = native.view(s.dtype)["modules"]["mode"]
    assert not modes.any()  # SC for ever: nobody says where it is


@pytest.mark.long
def test_only_one_file_takes_a_system_apart() -> None:
    fields = {"components", "modules", "topics", "properties", "inputs", "until_ns", "test"}
    sites = []
    for path in SOURCES:
        if "certificate" in path.parts:
            continue  # it derives its own systems, on purpose
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "replace":
                given = {str(k.arg) for k in call.keywords} & fields
                of = ast.unparse(call.args[0]) if call.args else ""
                if given and "scope" not in of:
                    sites.append(f"{path.name}: {sorted(given)}")
    assert {f.partition(":")[0] for f in sites} == {"derived_systems.py"}

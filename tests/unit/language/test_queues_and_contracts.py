"""Queues of subscriptions and contracts of nodes in the flat system."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.language.front_end import check_file, system_of
from soter.language.model.types import INT, ListType

if TYPE_CHECKING:
    from soter.language.model.system import System

QUEUED = """
topic t: int;
topic n: int;
topic m: int;
node A period 10ms { publishes t; step { publish t = 1; } }
node B period 50ms { subscribes t queue 8 drop_newest; publishes n; step { publish n = t.len; } }
node C period 50ms { subscribes t; publishes m; step { publish m = t; } }
node D period 30ms { subscribes t queue 3; publishes m; step { publish m = t.len; } }
"""


def flat(text: str) -> System:
    return system_of(check_file("test.soter", "soter 1;\n" + text), None)


def codes(text: str) -> list[str]:
    return [d.code for d in check_file("test.soter", "soter 1;\n" + text).diagnostics.items]


def test_a_queue_is_a_topic_of_its_own_beside_its_source() -> None:
    system = flat(QUEUED + "system S { node A; node B; node C; until 1s; always t >= 0; }")
    source, queue = system.topic("t"), system.topic("B.t.queue")
    assert source.queues == (queue.index,)
    assert queue.queue_of == source.index
    assert (queue.policy, queue.default, queue.driver) == ("drop_newest", (), "node `A`")
    assert queue.type == ListType(INT, 8)
    symbol = source.symbol
    scopes = {c.name: c.scope.topics.get(symbol) for c in system.components}
    assert scopes == {"A": source.index, "B": queue.index, "C": source.index}
    assert system.properties[0].scope.topics[symbol] == source.index


def test_every_instance_has_its_own_queue_and_a_queue_drops_the_oldest_if_nothing_is_said() -> None:
    text = (
        "system One { node A; node D; until 1s; }\nsystem Two default { a: One; b: One; node A; }"
    )
    system = flat(QUEUED + text)
    names = [t.name for t in system.topics if t.queue_of is not None]
    assert names == ["a.D.t.queue", "b.D.t.queue"]
    for name in names:
        queue = system.topic(name)
        assert queue.policy == "drop_oldest"
        assert queue.queue_of == system.topic(f"{name[0]}.t").index


def test_a_wired_subscription_queues_what_it_is_wired_to() -> None:
    text = "topic u: int;\nnode U period 10ms { publishes u; step { publish u = 2; } }\n"
    system = flat(QUEUED + text + "system S { node U; d: D { t = u }; until 1s; }")
    assert system.topic("d.t.queue").queue_of == system.topic("u").index


def test_the_bounds_of_a_queue_are_those_of_its_elements() -> None:
    text = """
topic t: { x: float, n: int in [0, 3] } in { x in [-1.0, 1.0] };
node A period 10ms { publishes t; step { publish t = { x: 0.5, n: 1 }; } }
node B period 50ms { subscribes t queue 2; step { for e in t { assert e.x < 1.0; } } }
system S { node A; node B; until 1s; }
"""
    system = flat(text)
    assert system.topic("B.t.queue").bounds == system.topic("t").bounds
    assert len(system.topic("t").bounds) == 2


def test_a_queue_that_nobody_fills_and_a_loop_by_wires_are_errors() -> None:
    assert codes(QUEUED + "system S { node B; }") == ["M005"]
    loop = "node L period 10ms { subscribes t queue 2; publishes n; step { publish n = t.len; } }"
    assert codes(QUEUED + loop + "system S { l: L { t = n }; }")[0] == "M001"


def test_the_decision_module_reads_the_topic_itself() -> None:
    text = """
topic u: int in [0, 9];
topic t: int;
node Ac period 10ms { subscribes t queue 2; publishes u; step { publish u = t.len; } }
node Sc period 10ms { publishes u; step { publish u = 0; } }
node T period 10ms { publishes t; step { publish t = 1; } }
rta M { ac Ac; sc Sc; period 10ms; safe t < 5; ttf t > 3; safer t < 2; }
system S { node T; module M; until 1s; }
"""
    system = flat(text)
    (module,) = system.modules
    assert module.inputs == (system.topic("t").index,)


CONTRACTS = """
topic t: int;
topic n: int;
node A period 10ms { publishes t; guarantees t > 0 && time >= 0.0; step { publish t = 1; } }
node B period 50ms {
  subscribes t;
  publishes n;
  assumes t > 0;
  assumes   age(t)
    < 1.0;
  guarantees n == t;
  step { publish n = t; }
}
"""


def test_contracts_are_properties_of_their_component_behind_those_of_systems() -> None:
    text = "system One { node A; b: B; until 1s; always n >= 0; }\n"
    system = flat(CONTRACTS + text + "system Two default { one: One; until 1s; never one.n < 0; }")
    properties = [(p.index, p.kind, p.text) for p in system.properties]
    assert properties == [
        (0, "never", "one.n < 0"),
        (1, "always", "n >= 0 in one"),
        (2, "guarantees", "t > 0 && time >= 0.0 in one.A"),
        (3, "assumes", "t > 0 in one.b"),
        (4, "assumes", "age(t) < 1.0 in one.b"),
        (5, "guarantees", "n == t in one.b"),
    ]
    for p in system.properties[2:]:
        assert p.component is not None
        component = system.components[p.component]
        assert p.scope is component.scope
        assert p.text.endswith(component.name)
    assert [p.component for p in system.properties[:2]] == [None, None]


@pytest.mark.parametrize(
    ("contract", "code"),
    [
        ("assumes n > 0;", "M010"),  # its own output is not there yet
        ("guarantees dt > 0.0;", "T013"),
        ("guarantees in_control;", "T013"),
        ("assumes k > 0;", "T013"),
        ("assumes t;", "T001"),
        ("guarantees other > 0;", "N001"),
    ],
)
def test_what_a_contract_cannot_say(contract: str, code: str) -> None:
    node = f"node C period 10ms {{ subscribes t; publishes n; var k: int; {contract} "
    node += "step { k = t; publish n = k; } }\n"
    assert codes("topic n: int;\ninput topic t: int;\n" + node + "system S { node C; }") == [code]


def test_a_contract_reads_the_mode_of_a_module_beside_it() -> None:
    text = """
topic u: int in [0, 9];
topic n: int;
node Ac period 10ms { publishes u; step { publish u = 9; } }
node Sc period 10ms { publishes u; step { publish u = 0; } }
rta M { ac Ac; sc Sc; period 10ms; safe true; ttf u > 5; safer u < 2; }
node Watch period 10ms {
  subscribes u;
  publishes n;
  guarantees mode(M) == Mode.AC || n >= 0;
  step { publish n = u; }
}
system S { module M; node Watch; until 1s; }
"""
    system = flat(text)
    (contract,) = system.properties
    assert list(contract.scope.modules.values()) == [0]


def test_a_topic_that_only_a_contract_reads_is_read() -> None:
    text = "topic n: int;\ninput topic t: int;\n"
    text += (
        "node C period 10ms { subscribes t; publishes n; assumes t > 0; step { publish n = 1; } }"
    )
    assert codes(text + "\nsystem S { node C; }") == []

"""A test as a flat system: what it adds, overrides and leaves out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.elaborate.explorable import MAX_STEPS
from soter.language.elaborate.tested_system import elaborate_test
from soter.language.front_end import check_file, system_of, system_of_test

if TYPE_CHECKING:
    from soter.language.model.system import System, TestPlan

TEXT = """soter 1;
input topic goal: int in [0, 9];
input topic wind: float in [-1.0, 1.0];
topic u: int in [0, 9];
topic x: int in [0, 99];
topic n: int;
param _LATE: duration = 2ms;
extern node Learned period 10ms { subscribes goal; publishes u; }
node Any period 40ms { publishes u; step { publish u = choose [0, 9]; } }
node Home period 10ms { publishes u; step { publish u = 0; } }
rta Keep { ac Learned; sc Home; period 20ms; safe x < 99; ttf x > 50; safer x < 20; }
node World period 10ms {
  subscribes u, wind;
  publishes x;
  guarantees x >= 0;
  var at: int in [0, 99];
  step { at = wind > 0.0 ? min(at + u, 99) : 0; publish x = at; }
}
node Count period 30ms { subscribes x queue 5; publishes n; step { publish n = x.len; } }
system Inner {
  module Keep; node World; input goal every 1s; input wind every 100ms; always x < 99;
}
system Outer { inner: Inner { x = x }; node Count; until 1s; never n > 5; }
system Flat default { module Keep; node World; input goal every 1s; until 1s; always x < 99; }
"""


def checked_codes(test: str) -> list[str]:
    return [d.code for d in check_file("test.soter", TEXT + test).diagnostics.items]


def system_for(test: str) -> System:
    return system_of_test(check_file("test.soter", TEXT + f"test T {{ {test} }}"), "T")


def plan(system: System) -> TestPlan:
    assert system.test is not None
    return system.test


FLAT = "system Flat; replace Learned by Any; horizon 200ms; "


def test_a_test_has_the_numbers_it_says() -> None:
    test_plan = plan(system_for(FLAT + "skew 3ms; quantum 500us;"))
    assert (test_plan.name, test_plan.skew_ns, test_plan.horizon_ns, test_plan.quantum_ns) == (
        "T",
        3_000_000,
        200_000_000,
        500_000,
    )
    left_out = plan(system_for(FLAT))
    assert (left_out.skew_ns, left_out.quantum_ns, left_out.faults, left_out.timed) == (
        0,
        None,
        (),
        (),
    )


def test_its_properties_follow_those_of_its_system_and_the_contracts() -> None:
    system = system_for(FLAT + "always x < 50; never u > 8;")
    assert [(p.index, p.kind, p.text) for p in system.properties] == [
        (0, "always", "x < 99"),
        (1, "guarantees", "x >= 0 in World"),
        (2, "always", "x < 50"),
        (3, "never", "u > 8"),
    ]
    assert system.properties[2].component is None


def test_what_only_a_test_asks_stands_in_its_plan() -> None:
    system = system_for(
        FLAT + "eventually x == 3 within 100ms; x > 9 leadsto u == 0 within 40ms; "
        "always invariant(Keep); always invariants;"
    )
    timed_properties = [(p.index, p.kind, p.within_ns, p.module) for p in plan(system).timed]
    assert timed_properties == [
        (0, "eventually", 100_000_000, None),
        (1, "leadsto", 40_000_000, None),
        (2, "invariant", 0, 0),
        (3, "invariant", 0, 0),
    ]
    texts = [p.text for p in plan(system).timed]
    assert texts[:2] == ["eventually x == 3 within 100ms", "x > 9 leadsto u == 0 within 40ms"]
    assert texts[2:] == ["invariant(Keep)"] * 2
    assert plan(system).timed[1].premise is not None
    assert plan(system).timed[2].scope is system.modules[0].scope


def test_a_deadline_that_is_never_judged_is_refused_by_parameters_too() -> None:
    eventually = "eventually x == 3 within _LATE;"
    leads = "x > 9 leadsto u == 0 within _LATE;"
    for ask, late, codes in (
        (eventually, 200_000_000, []),
        (eventually, 200_000_001, ["E013"]),
        (leads, 199_999_999, []),
        (leads, 200_000_000, ["E013"]),
    ):
        checked = check_file("test.soter", TEXT + f"test T {{ {FLAT} {ask} }}")
        try:
            system_of_test(checked, "T", {"_LATE": late})
            error_codes = []
        except SoterError as error:
            error_codes = [d.code for d in error.diagnostics]
        assert error_codes == codes, (ask, late)


def test_a_module_of_a_part_is_meant_by_its_path() -> None:
    text = "system Outer; replace inner.Keep.Learned by Any; horizon 1s; "
    system = system_for(text + "always invariant(inner.Keep); late inner.Keep.dm by _LATE;")
    (invariant,) = plan(system).timed
    assert invariant.text == "invariant(inner.Keep)"
    (fault,) = plan(system).faults
    assert system.components[fault.component].name == "inner.Keep.dm"
    assert fault.by_ns == 2_000_000


def test_the_invariants_are_one_of_each_module() -> None:
    two = "system Two { a: Inner; b: Inner; }\n"
    text = f"{two}test T {{ system Two; replace Learned by Any; horizon 1s; "
    checked = check_file("test.soter", TEXT + text + "always invariants; }")
    timed_properties = plan(system_of_test(checked, "T")).timed
    about = [(p.module, p.text) for p in timed_properties]
    assert about == [(0, "invariant(a.Keep)"), (1, "invariant(b.Keep)")]
    checked = check_file("test.soter", TEXT + text + "always invariant(b.Keep); }")
    timed_properties = plan(system_of_test(checked, "T")).timed
    assert [(p.module, p.text) for p in timed_properties] == [(1, "invariant(b.Keep)")]


def test_a_function_called_invariant_is_a_function() -> None:
    text = "fun invariant(n: int): bool { return n < 99; }\n"
    text += f"test T {{ {FLAT} always invariant(x); always invariants; }}"
    system = system_of_test(check_file("test.soter", TEXT + text), "T")
    assert system.properties[-1].text == "invariant(x)"
    assert [p.kind for p in plan(system).timed] == ["invariant"]


@pytest.mark.parametrize(
    ("path", "names"),
    [
        ("Home", ["Keep.Home"]),
        ("Keep.Home", ["Keep.Home"]),
        ("Any", ["Keep.Any"]),
        ("Keep.Any", ["Keep.Any"]),
        ("Learned", ["Keep.Any"]),  # what stands where `Learned` stood
        ("Keep.dm", ["Keep.dm"]),
        ("World", ["World"]),
    ],
)
def test_a_fault_names_a_component_as_replace_does(path: str, names: list[str]) -> None:
    system = system_for(FLAT + f"late {path} by 1ms;")
    assert [system.components[f.component].name for f in plan(system).faults] == names


def test_faults_have_their_numbers() -> None:
    system = system_for(FLAT + "skip World; skip Home at most 3; overrun Any by _LATE;")
    faults = [(f.kind, f.by_ns, f.at_most) for f in plan(system).faults]
    assert faults == [("skip", 0, 1), ("skip", 0, 3), ("overrun", 2_000_000, 0)]


def test_its_inputs_take_the_place_of_the_systems() -> None:
    text = "system Outer; replace inner.Keep.Learned by Any; horizon 1s; "
    system = system_for(text + "input inner.wind in { -1.0, 0.5 } every 10ms;")
    (drive,) = system.inputs
    assert system.topics[drive.topic].name == "inner.wind"
    assert (drive.every_ns, drive.values) == (10_000_000, (-1.0, 0.5))


def test_an_input_that_only_a_replaced_part_read_is_not_explored() -> None:
    everything = system_of(check_file("test.soter", TEXT), "Flat")
    assert [everything.topics[i.topic].name for i in everything.inputs] == ["goal"]
    assert system_for(FLAT).inputs == ()
    assert len(system_for(FLAT + "input goal every 1s;").inputs) == 1


def test_a_replacement_of_a_controller_may_be_slower_than_its_module() -> None:
    assert checked_codes(f"test T {{ {FLAT} }}") == []  # `Any` steps every 40 ms
    slow = "node Slow period 50ms { publishes u; step { publish u = 0; } }\n"
    slow += "rta Bad { ac Any; sc Slow; period 20ms; safe x < 99; }\n"
    slow += "system Late { node World; m: Bad; }\n"
    text = slow + "test T { system Late; horizon 1s; }"
    assert set(checked_codes(text)) == {"P1a"}


def test_a_replacement_offers_the_same_topics() -> None:
    text = "test T { system Flat; replace Learned by Count; horizon 1s; }"
    assert "M014" in checked_codes(text)


def test_a_parameter_of_the_command_line_reaches_the_test() -> None:
    checked = check_file("test.soter", TEXT + f"test T {{ {FLAT} late Home by _LATE; }}")
    system = system_of_test(checked, "T", {"_LATE": 5_000_000})
    assert plan(system).faults[0].by_ns == 5_000_000


def test_an_unknown_test_is_named_with_those_that_there_are() -> None:
    checked = check_file("test.soter", TEXT + f"test T {{ {FLAT} }}")
    with pytest.raises(SoterError) as caught:
        system_of_test(checked, "U")
    (d,) = caught.value.diagnostics
    assert (d.code, d.notes) == ("U010", ("there are: `T`",))
    assert list(checked.tests) == ["T"]


def test_the_longest_horizon_is_the_one_that_is_said_to_be() -> None:
    """`World` and `Home` step every 10 ms, `Keep.dm` every 20 ms, `Any` every 40 ms."""
    per_ns = 2 / 10_000_000 + 1 / 20_000_000 + 1 / 40_000_000
    horizon = int(MAX_STEPS / per_ns) // 1_000_000
    text = "system Flat; replace Learned by Any; "
    assert checked_codes(f"test T {{ {text} horizon {horizon - 100}ms; }}") == []
    assert checked_codes(f"test T {{ {text} horizon {horizon + 100}ms; }}") == ["E008"]


@pytest.mark.parametrize(
    ("items", "found"),
    [
        ("system Flat; replace Learned by Anyy; horizon 1s; late Anyy by 1ms;", ["N001"]),
        ("system Flat; replace Learnedd by Any; horizon 1s; skip Any;", ["M013"]),
        ("system Flat; replace Learned by Any; horizon 1x;", ["L006"]),
        ("system Flat; replace Learned by Any; horizon tt;", ["N001"]),
        ("system Flat; replace Learned by Count; horizon 1s;", ["M014"]),
        ("system Flat; replace Learned by ; horizon 1s;", ["S006"]),
        ("system Flat; replace Learned by Any; horizon 1s; late Home by 1x;", ["L006"]),
        ("system Flat; horizon 1s; always yy < 3;", ["N001"]),
    ],
)
def test_one_mistake_in_a_test_is_one_error(items: str, found: list[str]) -> None:
    codes = checked_codes(f"test T {{ {items} }}")
    assert [c for c in codes if c[0] != "W"] == found


def test_nothing_is_made_of_a_test_with_errors() -> None:
    checked = check_file("test.soter", TEXT + "test T { system Flat; horizon 1s; }")
    assert checked.program is not None
    diagnostics = Diagnostics()
    assert elaborate_test(checked.program, checked.tests["T"], {}, diagnostics) is None
    assert [d.code for d in diagnostics.items] == ["E005"]

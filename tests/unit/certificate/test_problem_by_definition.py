"""What is read off one program with all kinds of inputs, beside what a person reads there."""

from __future__ import annotations

import copy
import dataclasses
import itertools
from typing import TYPE_CHECKING, Any

import pytest

from soter.certificate.case_check import p1c_verdict
from soter.certificate.extras import estimates_and_shield
from soter.certificate.reading import problem
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.module_facts import DiffersError, Facts
from soter.certificate.report import NotRecheckedError
from soter.certificate.scope import assumptions_of, confirmed_facts
from soter.certificate.terms.linear_enclosures import ZERO, exact
from soter.certificate.terms.terms import Linear, Terms
from soter.language.model.types import BoolType, EnumType, FloatType, IntType
from tables import all_rows
from unit.certificate import small_proofs
from unit.certificate.test_reading_by_evaluation import at, holds

if TYPE_CHECKING:
    from pathlib import Path

arb = type(ZERO)
TEXT = """soter 1;
param GAIN: float = 2.0 in [0.5, 9.0];
type Road = enum { DRY, WET, ICE };
type V = { a: float, b: float };
topic x: V max_age 20ms;
topic y: float in [-4.0, 3.0] max_age 20ms;
topic u: float in [-1.0, 2.0] = 0.0;
input topic wish: float in [-0.5, 0.25] = 0.0 max_age 9s;
input topic wind: float in [-0.75, 0.5] = 0.0;
plant P period 10ms {
  reads u, wind;
  drives x = { b: 2.0 * v, a: shown };
  drives y = p - v;
  let shown = p;
  state p: float in [-0.125, 0.375];
  state v: float = 0.25;
  state heavy: bool = true;
  state road: Road = Road.WET;
  state gear: int in [2, 4] = 3;
  disturbance w: float in [-0.25, 0.75];
  der p = v;
  der v = (heavy ? 1.0 : 2.0) * u - 0.5 * v + w + 4.0 * wind + float(gear);
  measured x.a within 0.25, y within 0.125;
}
node Fast period 20ms { subscribes x; publishes u; step { publish u = 1.0; } }
node Slow period 20ms {
  subscribes x, y, wish;
  publishes u;
  step { publish u = clamp(wish - GAIN * x.a - x.b - y, -1.0, 2.0); }
}
rta M {
  ac Fast;
  sc Slow;
  period 40ms;
  safe abs(x.a) < 3.0;
  ttf abs(x.a) > 2.0;
  safer abs(x.a) < 1.0;
  verify { grid x.a in [-3.0, 3.0] / 100; }
}
system S { p: P; module M; }
"""
MAP = (
    ("der p = v;", "next p = p + 0.5 * v;"),
    ("der v = (heavy", "next v = (heavy"),
    ("plant P period 10ms", "plant P period 20ms"),
    ("max_age 20ms;\ntopic y", "max_age 15ms;\ntopic y"),
    ("3.0] max_age 20ms", "3.0] max_age 15ms"),
)


def facts_with(folder: Path, *pairs: tuple[str, str], module: str = "M") -> Facts:
    text = TEXT
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    (folder / "all.soter").write_text(text)
    return small_proofs.facts_of(folder / "all.soter", "S", module)


@pytest.fixture(scope="module")
def facts(tmp_path_factory: pytest.TempPathFactory) -> Facts:
    return facts_with(tmp_path_factory.mktemp("all"))


def rows(inputs: Any) -> list[tuple[Any, ...]]:
    return [(x.kind, x.name, x.low, x.high, x.of_others) for x in inputs]


def test_every_input_has_the_range_that_is_declared(facts: Facts) -> None:
    assert rows(facts.states) == [
        ("state", "p.p", -0.125, 0.375, False),
        ("state", "p.v", 0.25, 0.25, False),
    ]
    assert rows(facts.controls) == [("control", "u", -1.0, 2.0, False)]
    assert rows(facts.disturbances) == [
        ("disturbance", "p.w", -0.25, 0.75, False),
        ("disturbance", "p.wind", -0.75, 0.5, True),
    ]
    assert rows(facts.errors) == [
        ("error", "x.a", -0.25, 0.25, False),
        ("error", "y", -0.125, 0.125, False),
    ]
    assert rows(facts.others) == [("other", "wish", -0.5, 0.25, False)]
    assert [(p.name, p.values, p.begins) for p in facts.parameters] == [
        ("p.heavy", (0, 1), (1, 1)),
        ("p.road", (0, 1, 2), (1, 1)),
        ("p.gear", (2, 3, 4), (3, 3)),
    ]
    assert facts.axes == {0: (-3.0, 3.0)}
    assert (facts.kind, facts.levels, facts.view, facts.unbounded) == ("flow", 3, "", set())
    assert dict(facts.leaves.values()) == {
        next(t.index for t in facts.system.topics if t.name == "x"): ("a",)
    }


def test_errors_are_those_of_what_is_read(tmp_path: Path) -> None:
    no_x = ("wish - GAIN * x.a - x.b - y", "wish - y")
    for pairs, names in (
        ((no_x,), ["x.a", "y"]),  # ttf reads x.a
        ((("- x.b - y", "- x.b"),), ["x.a"]),
        ((no_x, ("ttf abs(x.a)", "ttf abs(y)"), ("safer abs(x.a)", "safer abs(y)")), ["y"]),
    ):
        facts = facts_with(tmp_path, *pairs)
        assert [e.name for e in facts.errors] == names


def test_the_error_of_a_state_is_that_of_its_axis(facts: Facts) -> None:
    assert estimates_and_shield.estimate_error(facts, 0) == 0.25
    with pytest.raises(NotRecheckedError, match=r"no topic carries `p\.v`"):
        estimates_and_shield.estimate_error(facts, 1)
    other = copy.copy(facts)
    (topic,) = (t for t, _ in facts.leaves.values())
    other.leaves = {1: (topic, ("b",))}
    assert estimates_and_shield.estimate_error(other, 1) == 0.0


def test_a_module_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(DiffersError, match="no module `N`"):
        facts_with(tmp_path, module="N")


Z = """topic z: float max_age 20ms;
plant Q period 10ms { drives z = q; state q: float; der q = -q; }
system S { p: P; q: Q;"""
Q = (("system S { p: P;", Z),)


@all_rows(
    ("pair", "there"),
    [
        (("gear: int", "gear: int"), False),
        (("subscribes x, y, wish;", "subscribes x, y, wish, z;"), False),
        (("- x.b - y", "- x.b - y - z"), True),
        (("safe abs(x.a) < 3.0", "safe abs(x.a) < 3.0 && z < 9.0"), True),
        (("ttf abs(x.a) > 2.0", "ttf abs(x.a) > 2.0 || z > 9.0"), True),
        (
            (
                "grid x.a in [-3.0, 3.0] / 100;",
                "grid x.a in [-3.0, 3.0] / 100; grid z in [-9.0, 9.0] / 9;",
            ),
            True,
        ),
        (
            (
                "grid x.a in [-3.0, 3.0] / 100;",
                "grid x.a in [-3.0, 3.0] / 100; grid q.q in [-9.0, 9.0] / 9;",
            ),
            True,
        ),
    ],
)
@all_rows("inner", [False, True])
def test_a_plant_is_part_of_the_problem_where_it_is_read(
    tmp_path: Path, pair: tuple[str, str], there: bool, inner: bool
) -> None:
    """Of the system in which its module stands, whichever holds that."""
    pairs, home = [*Q, pair], ""
    if inner:
        home = "low."
        pairs += [
            ("system S {", "system Inner {"),
            ("module M; }", "module M; }\nsystem S { low: Inner; }"),
        ]
    if "- z" in pair[1] or "grid z" in pair[1]:
        pairs.append(("subscribes x, y, wish;", "subscribes x, y, wish, z;"))
    facts = facts_with(tmp_path, *pairs, module=f"{home}M")
    assert [c.name for c in facts.plants] == [f"{home}p", f"{home}q"][: 1 + there]


def test_flows_and_maps_are_told_apart(tmp_path: Path) -> None:
    (c,) = facts_with(tmp_path).plants
    assert c.plant is not None
    moves, c.plant.der = c.plant.der, {}
    assert problem._plant_kind(c) == "flow"
    c.plant.next = moves
    assert problem._plant_kind(c) == "map"
    c.plant.der = moves
    with pytest.raises(NotRecheckedError, match="flows and maps"):
        problem._plant_kind(c)
    c.plant.next = {}
    assert problem._plant_kind(c) == "flow"
    c.plant.extern = True
    with pytest.raises(NotRecheckedError, match="extern"):
        problem._plant_kind(c)


def test_a_parameter_has_all_values_of_its_type() -> None:
    enum: Any = EnumType.__new__(EnumType)
    object.__setattr__(enum, "members", ("A", "B", "C"))
    assert problem._discrete_values(BoolType(), "x") == (0, 1)
    assert problem._discrete_values(enum, "x") == (0, 1, 2)
    assert problem._discrete_values(IntType(-1, 1), "x") == (-1, 0, 1)
    assert problem._discrete_values(IntType(3, 3), "x") == (3,)
    assert len(problem._discrete_values(IntType(1, 4096), "x")) == 4096
    for of in (IntType(0, 4096), FloatType.__new__(FloatType)):
        with pytest.raises(NotRecheckedError, match="too many values"):
            problem._discrete_values(of, "x")


# ---------------------------------------------------------------- the model

CASES = list(itertools.product((0, 1), (0, 2), (2, 4)))
STATES = [(-2.5, 0.5), (0.75, -1.0), (2.25, 1.25)]


def model_of(facts: Facts, parameter: tuple[int, ...] = (1, 1, 3)) -> CaseModel:
    return CaseModel(facts, parameter, ((-3.0, 3.0), (-1.0, 1.5)))


def point(terms: Terms, values: dict[str, float]) -> dict[int, float]:
    return {k: values[a.name] for k, a in enumerate(terms.atoms) if a.name in values}


def test_states_lie_in_their_ranges_and_as_far_beyond(facts: Facts) -> None:
    other = copy.copy(facts)
    other.unbounded = {1}
    for farthest in (None, exact(100.0)):
        _, states = CaseModel(other, (1, 1, 3), ((-3.0, 3.0), (-1.0, 1.5))).new_terms(farthest)
        ends = [(float(s.low), float(s.high)) for s in states]
        assert ends == [(-9.0, 9.0), (-3.5, 4.0) if farthest is None else (-100.0, 100.0)]


@pytest.mark.parametrize("kind", ["flow", "map"])
def test_rates_are_those_of_the_plant(tmp_path: Path, kind: str) -> None:
    facts = facts_with(tmp_path, *(MAP if kind == "map" else ()))
    assert facts.kind == kind
    for heavy, road, gear in CASES:
        model = model_of(facts, (heavy, road, gear))
        terms, states = model.new_terms()
        u = terms.add_input("box", "u", exact(-1.0), exact(2.0))
        if kind == "flow":
            moved, noise = model.rates(terms, states, [u])
            assert [(float(n.low), float(n.high)) for n in noise] == [(-0.25, 0.75), (-0.75, 0.5)]
            assert all(m.radius.is_zero() for m in moved)
        else:
            moved = model.next_states(terms, states, [u])
            assert all(m.radius > 0 for m in moved)
        for p, v in STATES:
            values = {"p.p": p, "p.v": v, "u": 0.5, "w": 0.25, "p.wind": -0.5}
            found = [at(terms, m, point(terms, values)) for m in moved]
            dv = (1.0 if heavy else 2.0) * 0.5 - 0.5 * v + 0.25 + 4.0 * -0.5 + gear
            dp = v if kind == "flow" else p + 0.5 * v
            assert found == pytest.approx([dp, dv])


@pytest.mark.parametrize("kind", ["flow", "map"])
def test_a_state_without_dynamics_stands_still(tmp_path: Path, kind: str) -> None:
    still = ("der p = v;", "") if kind == "flow" else ("next p = p + 0.5 * v;", "")
    facts = facts_with(tmp_path, *(MAP if kind == "map" else ()), still)
    model = model_of(facts)
    terms, states = model.new_terms()
    u = terms.add_input("box", "u", exact(-1.0), exact(2.0))
    move = model._rates_or_next_states(terms, states, [u], facts.states, rounded=False)[0][0]
    values = point(terms, {"p.p": 0.75, "p.v": 1.0})
    assert at(terms, move, values) == (0.0 if kind == "flow" else 0.75)


def test_topics_show_the_state_and_estimates_their_errors(facts: Facts) -> None:
    index = {t.name: t.index for t in facts.system.topics}
    for errors in (False, True):
        model = model_of(facts)
        terms, states = model.new_terms()
        topics = model.topic_terms(terms, states, errors=errors)
        assert topics.keys() == {index["x"], index["y"], index["wish"]}
        for p, v in STATES:
            values = {"p.p": p, "p.v": v, "x.a": 0.25, "y": -0.125, "wish": 0.125}
            where = point(terms, values)
            a, b = (at(terms, x, where) for x in topics[index["x"]])
            off = (0.25, -0.125) if errors else (0.0, 0.0)
            assert (a, b) == pytest.approx((p + off[0], 2 * v))
            assert at(terms, topics[index["y"]], where) == pytest.approx(p - v + off[1])
            assert at(terms, topics[index["wish"]], where) == 0.125
        ranges = [(float(a.low), float(a.high)) for a in terms.atoms if a.name == "y"]
        assert ranges == [(-0.125, 0.125)] * errors


@pytest.mark.parametrize("name", ["u + v", "w + v", "wind"])
def test_a_name_for_what_no_topic_shows_is_left_alone(tmp_path: Path, name: str) -> None:
    """What a plant is told and what disturbs it is known where it moves."""
    facts = facts_with(
        tmp_path,
        ("let shown = p;", f"let shown = p; let push = {name};"),
        ("der p = v;", "der p = push;"),
    )
    model = model_of(facts)
    terms, states = model.new_terms()
    model.topic_terms(terms, states, errors=True)
    u = terms.add_input("box", "u", exact(-1.0), exact(2.0))
    move = model.rates(terms, states, [u])[0][0]
    values = {"p.p": 9.0, "p.v": 0.5, "u": 0.25, "w": 0.125, "p.wind": -0.5}
    wanted = {"u + v": 0.75, "w + v": 0.625, "wind": -0.5}[name]
    assert at(terms, move, point(terms, values)) == wanted


def test_a_command_is_what_sc_makes_of_an_estimate(facts: Facts) -> None:
    model = model_of(facts)
    terms, states = model.new_terms()
    (command,) = model.sc_commands(terms, states)
    for (p, v), ea, ey, wish in itertools.product(
        STATES, (-0.25, 0.125), (-0.125, 0.0), (0.2, -0.5)
    ):
        where = point(terms, {"p.p": p, "p.v": v, "x.a": ea, "y": ey, "wish": wish})
        wanted = min(max(wish - 2.0 * (p + ea) - 2 * v - (p - v + ey), -1.0), 2.0)
        assert at(terms, command, where) == pytest.approx(wanted)
        assert all(holds(terms, o, where) for o in terms.obligations)


def test_a_command_lies_in_its_set_or_it_is_an_obligation(tmp_path: Path) -> None:
    facts = facts_with(
        tmp_path, ("clamp(wish - GAIN * x.a - x.b - y, -1.0, 2.0)", "x.a + x.b - y - wish")
    )
    model = model_of(facts)
    terms, states = model.new_terms()
    model.sc_commands(terms, states)
    for p, v in itertools.product((-2.5, 0.5, 2.25), (-1.25, 0.5, 1.25)):
        where = point(terms, {"p.p": p, "p.v": v, "x.a": 0.0, "y": 0.0, "wish": 0.0})
        command = p + 2 * v - (p - v)
        assert all(holds(terms, o, where) for o in terms.obligations) is (-1 <= command <= 2)


@pytest.mark.parametrize("errors", [False, True])
def test_a_predicate_is_about_topics_or_estimates(facts: Facts, errors: bool) -> None:
    model = model_of(facts)
    terms, states = model.new_terms()
    truth = model.truth_of(terms, states, facts.symbol.ttf, errors=errors)  # type: ignore[arg-type]
    for p, e in itertools.product((-2.5, -2.1, -1.9, 0.0, 1.9, 2.1), (-0.25, 0.0, 0.25)):
        where = point(terms, {"p.p": p, "p.v": 0.0, "x.a": e, "y": 0.0})
        assert holds(terms, truth, where) is (abs(p + (e if errors else 0.0)) > 2.0)


def test_what_is_published_keeps_to_its_set(facts: Facts) -> None:
    """The value lies so far within the set that with its error, rounded, it still does."""
    index = {t.name: t.index for t in facts.system.topics}
    model = model_of(facts)
    terms, states = model.new_terms()
    assert model.published_limits(terms, states, index["x"]) == []
    ((value, low, high),) = model.published_limits(terms, states, index["y"])
    assert low == pytest.approx(-3.875)
    assert high == pytest.approx(2.875)
    truth = model.topic_in_set(terms, states, index["y"])
    for p, v in itertools.product((-2.75, -2.0, 1.75, 2.5), (-1.0, 0.25, 1.25, 1.0)):
        where = point(terms, {"p.p": p, "p.v": v})
        assert at(terms, value, where) == pytest.approx(p - v)
        assert holds(terms, truth, where) is (-3.875 <= p - v <= 2.875)


# ---------------------------------------------------------------- what is said

ALWAYS = {"wait", "order", "fresh", "binary64", "no dropout"}
OF_FLOWS = {"scheme", "sensors on time"}
UNDECLARED = {f"undeclared {w}" for w in (
    "late dm", "late sc", "response dm", "response sc", "acts within"
)}  # fmt: skip
INPUTS = {
    "disturbance p.w in [-0.25, 0.75]",
    "disturbance p.wind in [-0.75, 0.5]",
    "error x.a 0.25",
    "error y 0.125",
    "exact x.b",
    "set y",
    "other wish",
    "world p",
    *(f"changes p.{n}" for n in ("heavy", "road", "gear")),
}


def keys(facts: Facts) -> set[str]:
    found = [a.key for a in assumptions_of(facts)]
    assert len(found) == len(set(found))
    return set(found)


def test_everything_that_is_taken_for_granted_is_said(facts: Facts) -> None:
    wanted = ALWAYS | OF_FLOWS | UNDECLARED | INPUTS
    assert keys(facts) - {"exact wish"} == wanted
    assert p1c_verdict(facts) == "assumed"


def test_of_a_map_other_things_are_said(tmp_path: Path) -> None:
    wanted = ALWAYS | INPUTS | {"one instant"}
    assert keys(facts_with(tmp_path, *MAP)) - {"exact wish"} == wanted


DECLARED = (
    "verify {",
    "verify { late dm 2ms, sc 1ms; response dm 1ms, sc 1ms; acts within 1ms; dropout 0ms;",
)


def test_times_that_are_declared_are_said(tmp_path: Path) -> None:
    facts = facts_with(tmp_path, DECLARED)
    found = keys(facts) - INPUTS - ALWAYS - OF_FLOWS - {"exact wish"}
    assert found == {
        "declared late dm 2 ms",
        "declared late sc 1 ms",
        "declared response dm 1 ms",
        "declared response sc 1 ms",
        "declared acts within 1 ms",
    }
    assert p1c_verdict(facts) == "proved"
    silent = facts_with(tmp_path, (DECLARED[0], DECLARED[1].replace("dropout 0ms", "dropout 20ms")),
                        ("max_age 20ms", "max_age 90ms"), (" - x.b - y", " - x.b"))  # fmt: skip
    assert "dropout 20 ms" in keys(silent)
    assert "no dropout" not in keys(silent)


def test_only_all_times_make_p1c_proved(tmp_path: Path) -> None:
    facts = facts_with(tmp_path, DECLARED)
    assert p1c_verdict(facts) == "proved"
    facts.ways.undeclared = {"N": None}
    assert p1c_verdict(facts) == "assumed"
    assert "undeclared N" in keys(facts)


def test_what_keeps_to_its_set_is_no_assumption(facts: Facts) -> None:
    own = copy.copy(facts)
    (index,) = (t.index for t in facts.system.topics if t.name == "y")
    inside: tuple[int, ...]
    for inside, said, confirmed in (((), True, False), ((index,), False, True)):
        own.in_sets = inside
        assert ("set y" in keys(own)) is said
        assert [c.key for c in confirmed_facts(own, {})] == ["set y"] * confirmed


@all_rows("function", ["sin", "exp", "clamp", "sign"])
@all_rows("place", ["SC", "safer", "plant"])
def test_bounds_of_functions_are_said(tmp_path: Path, function: str, place: str) -> None:
    of = {"clamp": "clamp({}, -1.0, 1.0)"}.get(function, f"{function}({{}})")
    pair = {
        "SC": ("wish - GAIN * x.a", f"wish - GAIN * {of.format('x.a')}"),
        "safer": ("safer abs(x.a) < 1.0", f"safer abs(x.a) < 1.0 && {of.format('x.a')} < 9.0"),
        "plant": ("der p = v;", f"der p = {of.format('v')};"),
    }[place]
    found = {k for k in keys(facts_with(tmp_path, pair)) if k.startswith("bound")}
    assert found == ({f"bound of {function}"} if function in ("sin", "exp") else set())


def test_an_open_end_is_said(facts: Facts) -> None:
    own = copy.copy(facts)
    own.open_ends = {0}
    assert "open p.p 3.0" in keys(own)


def test_commands_that_act_together_are_said(facts: Facts) -> None:
    own = copy.copy(facts)
    for jitter, count, rest in itertools.product((0, 5), (1, 2), (None, "rest")):
        own.derived = dataclasses.replace(facts.derived, jitter=jitter)
        own.times = {**facts.times, "j_ns": jitter}
        own.controls = facts.controls * count
        own.flying_module = copy.copy(facts.flying_module)
        symbol = copy.copy(facts.symbol)
        object.__setattr__(symbol, "rest", rest)
        own.module = copy.copy(facts.module)
        object.__setattr__(own.module, "symbol", symbol)
        together = [a.key for a in assumptions_of(own) if a.key.startswith("together")]
        assert bool(together) is (jitter > 0 and count > 1 and rest is None)


def test_a_value_may_be_a_number_or_a_form() -> None:
    assert at(Terms(), 2.5, []) == 2.5
    assert isinstance(Terms().constant(1.0), Linear)

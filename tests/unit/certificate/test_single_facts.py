"""Single conditions of how a program is read: what each refuses, finds, or lets through."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.cell_sets import Grid
from soter.certificate.grid.grid_group import GridCheck
from soter.certificate.grid.group_claims import GroupTables
from soter.certificate.grid.sc_chains import uncrossed_ends
from soter.certificate.reading import problem
from soter.certificate.reading.case_model import CaseModel, new_command_terms
from soter.certificate.reading.linear_flows import has_linear_rates, linear_flow
from soter.certificate.reading.module_facts import Input
from soter.certificate.reading.supported_constructs import require_supported
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import ZERO
from soter.language.model.system import InputDrive
from soter.language.model.tree_walk import nodes
from soter.language.model.typed import AgeRead
from unit.certificate.test_single_refusals import OTHER, facts_of

if TYPE_CHECKING:
    from pathlib import Path


arb = type(ZERO)
NO_SPAN: Any = None


# ---------------------------------------------------------------- reading


def test_ages_are_left_out_of_ttf(tmp_path: Path) -> None:
    plain = facts_of(tmp_path)
    assert plain.ttf is plain.symbol.ttf
    aged = facts_of(tmp_path, ("ttf abs(x) > 2.0", "ttf abs(x) > 2.0 || age(x) > seconds(15ms)"))
    for of, known in ((aged.symbol.ttf, True), (aged.ttf, False)):
        assert any(isinstance(n, AgeRead) for n in nodes([of])) is known


MAP = (
    ("der p = u;", "next p = 0.5 * p + 0.0 * u;"),
    ("der q = -q;", "next q = -q;"),
    ("plant P period 10ms", "plant P period 20ms"),
    ("plant Q period 10ms", "plant Q period 20ms"),
    ("topic x: float max_age 20ms", "topic x: float max_age 15ms"),
    ("topic y: float max_age 20ms", "topic y: float max_age 15ms"),
)


def test_of_a_map_no_end_is_known_not_to_be_crossed(tmp_path: Path) -> None:
    """A map jumps: the sign of a number at an end says nothing of it."""
    model = CaseModel(facts_of(tmp_path, *MAP), (), ((-3.0, 3.0), (-1.0, 1.0)))
    assert model.facts.kind == "map"
    assert uncrossed_ends(model, [0, 1]) == [(False, False)] * 2


def test_what_is_no_part_that_is_known_is_refused(tmp_path: Path) -> None:
    facts = facts_of(tmp_path)
    require_supported(facts)
    plant = next(c for c in facts.flying.components if c.plant)
    plant.role = "oracle"
    with pytest.raises(NotRecheckedError, match="is a oracle"):
        require_supported(facts)


def test_a_module_that_is_followed_in_flight_has_no_cells(tmp_path: Path) -> None:
    facts = facts_of(tmp_path)
    facts.symbol.rest = facts.symbol.safe  # type: ignore[assignment]
    with pytest.raises(NotRecheckedError, match=r"rest|follow"):
        require_supported(facts)


def test_a_module_that_never_decides_is_refused(tmp_path: Path) -> None:
    facts = facts_of(tmp_path)
    require_supported(facts)
    facts.flying_module.forced = "ac"
    with pytest.raises(NotRecheckedError, match="forced"):
        require_supported(facts)


def test_a_plant_that_reads_what_nobody_commands(tmp_path: Path) -> None:
    """Nor does it move the plant: else it is a disturbance."""
    wind = ("topic u:", "input topic wind: float in [0.0, 1.0] = 0.0;\ntopic u:")
    reads = ("plant Q period 10ms {", "plant Q period 10ms { reads wind;")
    for moved, fine in (("-q + wind", True), ("-q", False)):
        facts = facts_of(tmp_path, wind, reads, ("der q = -q;", f"der q = {moved};"))
        model = CaseModel(facts, (), ((-3.0, 3.0), (-1.0, 1.0)))
        terms, states = model.new_terms()
        controls = new_command_terms(facts, terms)
        if fine:
            model.rates(terms, states, controls)
        else:
            with pytest.raises(NotRecheckedError, match="`wind`, which is no output of the module"):
                model.rates(terms, states, controls)


def test_an_axis_names_one_state_or_none(tmp_path: Path) -> None:
    facts = facts_of(tmp_path, ("grid x in", "grid p.p in"))
    axis = facts.symbol.verify.groups[0].axes[0]
    assert axis.topic is None
    for names, found in (
        (["p.p", "p.q"], 0), (["p.q", "a.p.p"], 1), (["a.p"], None), (["ap.p"], None),
        (["a.p.p", "b.p.p"], None),
    ):  # fmt: skip
        facts.states = [Input("state", name, 0, 0, 0.0, 1.0) for name in names]
        assert problem._state_of_axis(facts, axis) == found


BRAKES = "(p > -3.0 ? -1.0 : 0.0)"
"""What stands at the lower end stays there."""


@pytest.mark.parametrize(
    ("rate", "ends"),
    [
        ("-p * p * p", (True, True)),
        ("p * p * p", (False, False)),
        ("p * p", (True, False)),
        (BRAKES, (True, True)),
        ("(p <= -3.0 ? 0.0 : -1.0)", (True, True)),
        ("(p < -3.0 ? 0.0 : -1.0)", (False, True)),
        ("-sign(p + 3.0)", (True, True)),
        ("-sign(3.0 - p)", (False, False)),
        ("(p >= 3.0 ? -1.0 : 1.0)", (True, True)),
        ("clamp(u, -(p + 3.0), p + 3.0)", (True, False)),
        # no solution feels what a rate is at one point
        ("(p == -3.0 ? 1.0 : -1.0)", (False, True)),
        ("(p != -3.0 ? -1.0 : 1.0)", (False, True)),
        ("(p <= -3.0 && p >= -3.0 ? 1.0 : -1.0)", (False, True)),
        ("(p > -3.0 ? -1.0 : p < -3.0 ? -1.0 : 1.0)", (False, True)),
        ("(2.0 * p + 6.0 == 0.0 ? 1.0 : -1.0)", (False, True)),
        ("(p * p == 9.0 ? p : -p)", (False, False)),
        ("(p * p == 9.0 ? -p : p)", (False, False)),
        ("floor(p) + floor(-p)", (False, True)),
        ("(int(p + 3.5) == 0 && p == -3.0 ? 1.0 : -1.0)", (False, True)),
        ("(1.0 - 2.0 * sign((p + 3.0) * (p + 3.0)))", (False, True)),
    ],
)
def test_an_end_is_not_crossed_where_the_flow_leads_in(
    tmp_path: Path, rate: str, ends: tuple[bool, bool]
) -> None:
    """Where it is not linear: by its rates on the side."""
    facts = facts_of(tmp_path, ("der p = u", f"der p = 0.0 * u + {rate}"))
    model = CaseModel(facts, (), ((-3.0, 3.0), (-1.0, 1.0)))
    (index,) = (i for i, s in enumerate(facts.states) if s.name.endswith("p.p"))
    assert uncrossed_ends(model, [index]) == [ends]


@pytest.mark.parametrize(
    ("rate", "shows"), [("-q", False), ("q", False), ("-q * q * q", False), ("q * q * q", True)]
)
def test_a_chain_sees_the_rates_of_what_it_follows(tmp_path: Path, rate: str, shows: bool) -> None:
    """It follows a flow that is not linear, where a run may leave the grid."""
    facts = facts_of(tmp_path, ("der q = -q;", f"der q = {rate};"))
    model = CaseModel(facts, (), ((-3.0, 3.0), (-1.0, 1.0)))
    (index,) = (i for i, s in enumerate(facts.states) if s.name == "q.q")
    group = GroupTables((index,), Grid(((-1.0, 1.0),)), np.ones(1, dtype=np.uint8))
    assert GridCheck(model, group, None).shows_rates_defined is shows


def test_what_others_publish_has_a_value_set(tmp_path: Path) -> None:
    for values, fine in ((" in [-0.5, 0.5]", True), ("", False)):
        pairs = (
            ("topic u:", f"input topic wish: float{values} = 0.0 max_age 9s;\ntopic u:"),
            ("subscribes x, y;", "subscribes x, y, wish;"),
            ("clamp(-x,", "clamp(wish - x,"),
        )
        if fine:
            facts_of(tmp_path, *pairs)
        else:
            with pytest.raises(NotRecheckedError, match="`wish` has no value set"):
                facts_of(tmp_path, *pairs)


def test_a_flow_that_is_not_linear_is_not_solved_at_once(tmp_path: Path) -> None:
    for rate, linear in (("-q", True), ("-q * q", False)):
        model = CaseModel(
            facts_of(tmp_path, ("der q = -q", f"der q = {rate}")), (), ((-3.0, 3.0), (-1.0, 1.0))
        )
        (index,) = (i for i, s in enumerate(model.facts.states) if s.name.endswith("q.q"))
        assert has_linear_rates(model, [index]) is linear
        if linear:
            linear_flow(model, [index])
        else:
            with pytest.raises(NotRecheckedError, match="not linear"):
                linear_flow(model, [index])


@pytest.mark.parametrize("who", ["plant", "node", "input", "nobody"])
def test_nobody_beside_the_module_publishes_its_outputs(tmp_path: Path, who: str) -> None:
    """No program that is checked has such a component: each is turned to the output here."""
    node = "node Z period 20ms { subscribes y; publishes z; step { publish z = 1.0; } }"
    beside = ("topic u:", f"topic z: float;\n{node}\ntopic u:"), ("module M;", "z: Z; module M;")
    facts = facts_of(tmp_path, *beside)
    (output,) = facts.flying_module.outputs
    if who == "input":
        facts.flying.inputs = (InputDrive(output, 20_000_000),)
    elif who != "nobody":
        name = {"plant": "q", "node": "z"}[who]
        (component,) = (c for c in facts.flying.components if c.name == name)
        component.scope.topics[component.published[0]] = output
    if who == "nobody":
        require_supported(facts)
    else:
        with pytest.raises(NotRecheckedError, match=r"alone|input"):
            require_supported(facts)


def test_an_axis_goes_as_far_as_it_is_open(tmp_path: Path) -> None:
    for more, high in (("", 3.0), (" open to 4.5", 4.5)):
        facts = facts_of(tmp_path, ("/ 100;", f"/ 100{more};"))
        (index,) = (i for i, s in enumerate(facts.states) if s.name == "p.p")
        assert facts.axes[index] == (-3.0, high)
        assert facts.open_ends == ({index} if more else set())


RECORDS = """type In = { a: float, b: float };
type Out = { one: In, two: In };
topic whole: Out;
"""
WHOLE = "drives whole = { two: { b: p, a: 1.0 }, one: { a: 2.0, b: 3.0 } };"


def test_a_field_within_a_field_is_the_state_that_it_is(tmp_path: Path) -> None:
    pairs = ("topic x:", f"{RECORDS}topic x:"), ("drives x = p;", f"drives x = p; {WHOLE}")
    facts = facts_of(tmp_path, *pairs)
    (plant,) = (c for c in facts.plants if c.name == "p")
    assert plant.plant is not None
    (value,) = (e for t, e in plant.plant.drives if t.name == "whole")
    (index,) = (i for i, s in enumerate(facts.states) if s.name.endswith("p.p"))
    for path, found in ((("two", "b"), index), (("two", "a"), None), (("one", "b"), None)):
        assert problem.state_published(facts, plant, value, path) == found


def test_what_is_read_and_no_plant_drives_is_an_input(tmp_path: Path) -> None:
    assert not facts_of(tmp_path).others
    sets = {"wish": (-0.5, 0.5), "more": (2.0, 3.0)}
    lines = [
        f"input topic {n}: float in [{a}, {b}] = {b} max_age 9s;\n" for n, (a, b) in sets.items()
    ]
    facts = facts_of(
        tmp_path,
        ("topic u:", f"{''.join(lines)}topic u:"),
        ("subscribes x, y;", "subscribes x, y, wish, more;"),
        ("clamp(-x,", "clamp(wish - more - x,"),
    )
    assert [(i.low, i.high) for i in facts.others] == list(sets.values())
    model = CaseModel(facts, (), ((-3.0, 3.0), (-1.0, 1.0)))
    terms, states = model.new_terms()
    values = model.topic_terms(terms, states, errors=False)
    for i in facts.others:
        value = values[i.owner]
        assert (float(value.low), float(value.high)) == sets[facts.system.topics[i.owner].name]


KEPT = "var k: int in [1, 3] = 2; var far: bool = false;"
SLOW = "node Slow period 20ms { subscribes x, y; publishes u;"


@pytest.mark.parametrize(
    ("kept", "law", "ends"),
    [
        ("", "0.5", (0.5, 0.5)),
        (KEPT, "0.125 * float(k)", (0.125, 0.375)),
        (KEPT, "far ? -0.25 : 0.25 * float(k)", (-0.25, 0.75)),
        ("", "mode(N) == Mode.AC ? 0.5 : -0.25", (-0.25, 0.5)),
        (KEPT, "mode(N) == Mode.AC ? 0.25 * float(k) : (far ? -0.5 : 0.0)", (-0.5, 0.75)),
    ],
)
def test_a_command_is_any_of_those_of_all_locals_and_modes(
    tmp_path: Path, kept: str, law: str, ends: tuple[float, float]
) -> None:
    """Without any of them it is the one that the step publishes."""
    facts = facts_of(
        tmp_path,
        (
            f"{SLOW} step {{ publish u = clamp(-x,",
            f"{SLOW} {kept} step {{ publish u = clamp({law},",
        ),
        ("topic u:", f"{OTHER}topic u:"),
        ("module M; }", "module M; module N; }"),
    )
    model = CaseModel(facts, (), ((-3.0, 3.0), (-1.0, 1.0)))
    terms, states = model.new_terms()
    (command,) = model.sc_commands(terms, states)
    assert (float(command.low), float(command.high)) == pytest.approx(ends)


@pytest.mark.parametrize("real", [None, (-1.0, 0.25), (3.0, 2.0)])
def test_a_run_starts_as_is_declared_and_where_what_flies_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real: tuple[float, float] | None
) -> None:
    """A state that is drawn, and one that begins at a number; whether each moves is the plant's."""
    states = "state q: float in [-0.25, 0.75]; state b: float = 1.0; state c: int in [1, 3] = 3;"
    facts = facts_of(tmp_path, ("state q: float;", states))
    c = next(c for c in facts.plants if c.name == "q")
    assert c.plant is not None
    if real is not None:
        monkeypatch.setattr("soter.certificate.extras.views.states_at_start", lambda *_: (*real, 2))
        facts.symbol.verify.abstracts = facts.symbol.verify.groups  # type: ignore[assignment]
        facts.states, facts.parameters = [], []
        problem._read_states(facts, c)
    ends = [(-0.25, 0.75), (1.0, 1.0)]
    if real is not None:
        ends = [(min(a, x), max(b, x)) for (a, b), x in zip(ends, real, strict=True)]
    assert [(s.low, s.high) for s in facts.states if s.name.startswith("q.")] == ends
    (parameter,) = facts.parameters
    assert (parameter.values, parameter.begins) == ((1, 2, 3), (3, 3 if real is None else 2))
    for moves in ("der", "next"):
        c.plant.der, c.plant.next = {}, {}
        setattr(c.plant, moves, {c.plant.states[2]: c.plant.drives[0][1]})
        with pytest.raises(NotRecheckedError, match=r"the state `q\.c` moves and is no float"):
            problem._read_states(facts, c)


def test_a_list_is_no_state_that_is_followed(tmp_path: Path) -> None:
    few = "type Few = { few: float[<=3], x: float };\ntopic u:"
    started = "state q: float; state few: Few = { few: [], x: 1.0 };"
    with pytest.raises(NotRecheckedError, match="a list in the state `few`"):
        facts_of(tmp_path, ("topic u:", few), ("state q: float;", started))

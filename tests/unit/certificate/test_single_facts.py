"""Single conditions of how a program is read: what each refuses, finds, or lets through."""

from __future__ import annotations

import dataclasses
import itertools
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.cell_sets import Grid
from soter.certificate.extras.estimates_and_shield import compare_table
from soter.certificate.grid.grid_group import GridCheck, GridGroup
from soter.certificate.grid.sc_chains import uncrossed_ends
from soter.certificate.reading import case_model, problem, supported_constructs
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.linear_flows import has_linear_rates, linear_flow
from soter.certificate.reading.supported_constructs import require_supported
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.linear_enclosures import ZERO
from soter.language.model.tree_walk import nodes
from soter.language.model.typed import AgeRead, Variable
from soter.language.model.types import FLOAT, IntType, ListType, RecordType
from unit.certificate.test_single_refusals import facts_of

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


def test_of_a_map_no_end_is_known_not_to_be_crossed() -> None:
    model: Any = SimpleNamespace(facts=SimpleNamespace(kind="map"))
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


def test_a_plant_that_reads_what_nobody_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(case_model, "topics_of_others", lambda *_: [])
    topic = SimpleNamespace(name="u", type=None)
    model: Any = SimpleNamespace(facts=SimpleNamespace(module=None, controls=[]))
    plant = SimpleNamespace(reads=[topic])
    c: Any = SimpleNamespace(name="P", plant=plant, scope=SimpleNamespace(topics={}))
    with pytest.raises(NotRecheckedError, match="no output of the module"):
        CaseModel._commands_to_plant(model, c, [])


def test_an_axis_names_one_state_or_none() -> None:
    axis: Any = SimpleNamespace(topic=None, instance="c", path=("x",))
    for names, found in ((["c.x", "c.y"], 0), (["a.x"], None), (["a.c.x", "b.c.x"], None)):
        facts: Any = SimpleNamespace(states=[SimpleNamespace(name=n) for n in names])
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


def test_a_chain_sees_the_rates_of_what_it_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "soter.certificate.grid.grid_group.has_linear_rates", lambda model, _: model
    )
    for kept, linear in itertools.product((True, False), repeat=2):
        check: Any = SimpleNamespace(kept=kept, model=linear, tables=SimpleNamespace(states=(0,)))
        assert GridCheck.shows_rates_defined.fget(check) == (not kept and not linear)  # type: ignore[attr-defined]


def test_what_others_publish_has_a_value_set(tmp_path: Path) -> None:
    facts: Any = facts_of(tmp_path)
    (index,) = facts.module.outputs
    assert list(problem._leaves_of(facts, index, "other"))
    topics = list(facts.system.topics)
    topics[index] = dataclasses.replace(topics[index], bounds=(None,))
    facts = SimpleNamespace(system=SimpleNamespace(topics=topics))
    with pytest.raises(NotRecheckedError, match="no value set"):
        list(problem._leaves_of(facts, index, "other"))


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


@pytest.mark.parametrize("there", ["", "R", "Q", "W", "S", "RQWS"])
def test_a_group_has_the_tables_that_its_entry_names(there: str) -> None:
    core = np.ones(1, dtype=np.uint8)
    certificate: Any = SimpleNamespace(
        count_cells=lambda _: None,
        number_table=lambda name, *_: core if name == "K" else f"numbers {name}",
        set_of_cells=lambda name, _: f"bits {name}",
    )
    named: Any = {"S": ["S"], "W_N": "W_N"} | {n: n for n in "KRQW"}
    entry = {n: named[n] for n in ("K", *there, *(("W_N",) if "W" in there else ()))}
    axes: Any = SimpleNamespace(states=(0,), grid=Grid(((0.0, 1.0),)))
    facts: Any = SimpleNamespace(at_rest=False)
    tables: Any = GridGroup.read(certificate, facts, entry, axes).tables
    assert tables.core is core
    assert (tables.free, tables.home, tables.rank, tables.rank_holds) == (
        "bits R" if "R" in there else None,
        "numbers Q" if "Q" in there else None,
        "numbers W" if "W" in there else None,
        "numbers W_N" if "W" in there else None,
    )
    assert tables.levels == (["bits S"] if "S" in there else [])


@pytest.mark.parametrize("state", ["p.p", "q.q"])
def test_a_table_of_the_dm_has_the_axes_of_its_group(tmp_path: Path, state: str) -> None:
    facts = facts_of(tmp_path)
    (index,) = (i for i, s in enumerate(facts.states) if s.name == "p.p")
    group = SimpleNamespace(states=(index,), grid=Grid(((0.0, 1.0),)))
    check: Any = SimpleNamespace(tables=group)
    axis = {"state": state, "edges": [0.0, 2.0]}
    certificate: Any = SimpleNamespace(breakpoints=tuple)
    why = "elsewhere" if state == "p.p" else "other axes"
    with pytest.raises(RejectedError, match=why):
        compare_table(certificate, facts, [check.tables], {"axes": [axis], "levels": None})


@dataclasses.dataclass(frozen=True)
class Named:
    name: str


@pytest.mark.parametrize("who", ["plant", "node", "input", "nobody"])
def test_nobody_beside_the_module_publishes_its_outputs(who: str) -> None:
    index = {"u": 0, "x": 1}
    drives = [(Named("u" if who == "plant" else "x"), None)]
    plant = SimpleNamespace(drives=drives)
    node = SimpleNamespace(publishes=[Named("u" if who == "node" else "x")])

    def component(name: str, **of: Any) -> Any:
        topics = {t: index[t.name] for t in (drives[0][0], *node.publishes)}
        parts = {"plant": None, "node": None, **of}
        return SimpleNamespace(name=name, scope=SimpleNamespace(topics=topics), **parts)

    sc = component("sc", node=node)
    beside = [component("p", plant=plant), component("n", node=node), component("m")]
    inputs = [SimpleNamespace(topic=0 if who == "input" else 1)]
    topics = [SimpleNamespace(name=n, queue_of=None) for n in index]
    facts: Any = SimpleNamespace(
        flying=SimpleNamespace(components=[sc, *beside], inputs=inputs, topics=topics),
        flying_module=SimpleNamespace(outputs=(0,), sc=0),
        controllers=[sc],
    )
    if who == "nobody":
        supported_constructs._require_own_topics(facts)
    else:
        with pytest.raises(NotRecheckedError, match=r"alone|input"):
            supported_constructs._require_own_topics(facts)


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
    values = model.topics(terms, states, errors=False)
    for i in facts.others:
        value = values[i.owner]
        assert (float(value.low), float(value.high)) == sets[facts.system.topics[i.owner].name]


KEPT = "var k: int in [1, 3] = 2; var far: bool = false;"
SLOW = "node Slow period 20ms { subscribes x, y; publishes u;"
OTHER = """topic w: float in [-1.0, 1.0];
node Quick period 20ms { subscribes x; publishes w; step { publish w = 1.0; } }
node Calm period 20ms { subscribes x; publishes w; step { publish w = 0.0; } }
rta N { ac Quick; sc Calm; period 20ms; safe x < 3.0; ttf x > 2.0; safer x < 1.0; }
"""


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
    monkeypatch: pytest.MonkeyPatch, real: tuple[float, float] | None
) -> None:
    """A state that is drawn, and one that begins at a number; whether each moves is the plant's."""
    pairs = zip("abc", (FLOAT, FLOAT, IntType(1, 3)), strict=True)
    states = [Variable(n, of, "state", NO_SPAN) for n, of in pairs]
    begun = None if real is None else (*real, 2)
    monkeypatch.setattr("soter.certificate.extras.views.states_at_start", lambda *_: begun)
    plant = SimpleNamespace(states=states, der={states[0]: 1}, next={})
    c: Any = SimpleNamespace(
        name="p", index=4, plant=plant, initial=(0.875, 1.0, 3),
        initial_range=((-0.25, 0.75), None, None),
    )  # fmt: skip
    abstracts = None if real is None else "Vehicle"
    symbol = SimpleNamespace(verify=SimpleNamespace(abstracts=abstracts))
    facts: Any = SimpleNamespace(states=[], parameters=[], symbol=symbol)
    problem._read_states(facts, c)
    ends = [(-0.25, 0.75), (1.0, 1.0)]
    if real is not None:
        ends = [(min(a, x), max(b, x)) for (a, b), x in zip(ends, real, strict=True)]
    assert [(s.low, s.high) for s in facts.states] == ends
    (parameter,) = facts.parameters
    assert (parameter.values, parameter.begins) == ((1, 2, 3), (3, 3 if real is None else 2))
    for moves in ("der", "next"):
        plant.der, plant.next = {}, {}
        setattr(plant, moves, {states[2]: 1})
        with pytest.raises(NotRecheckedError, match=r"the state `p\.c` moves and is no float"):
            problem._read_states(facts, c)


def test_a_list_is_no_state_that_is_followed() -> None:
    of = RecordType((("few", ListType(FLOAT, 3)), ("x", FLOAT)))
    state = Variable("s", of, "state", NO_SPAN)
    plant = SimpleNamespace(states=[state], der={}, next={})
    c: Any = SimpleNamespace(
        name="p", index=0, plant=plant, initial=(((), 1.0),), initial_range=(None,)
    )
    facts: Any = SimpleNamespace(
        states=[], parameters=[], symbol=SimpleNamespace(verify=SimpleNamespace(abstracts=()))
    )
    with pytest.raises(NotRecheckedError, match="a list in the state `s`"):
        problem._read_states(facts, c)

"""What is claimed, declared and understood: each refusal alone, and what it lets through."""

from __future__ import annotations

import copy
import itertools
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from soter.certificate import case_check
from soter.certificate.case_check import CLAIMS, VERDICTS, check_module_claims, proved_claims
from soter.certificate.extras import maps
from soter.certificate.reading import (
    case_model,
    derived_times,
    module_facts,
    module_times,
    supported_constructs,
)
from soter.certificate.reading.case_model import command_term
from soter.certificate.reading.derived_times import Clock, Effect, TopicPath
from soter.certificate.reading.module_times import DECLARED_KEYS, TIME_KEYS, compare_times
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.terms import Terms
from soter.language.model import typed as t
from tables import all_rows
from unit.certificate.test_problem_by_definition import facts_with, model_of
from unit.certificate.test_reading_by_evaluation import holds
from unit.certificate.test_single_refusals import claimed, controllers

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.reading.module_facts import Facts


# ---------------------------------------------------------------- claims


@pytest.mark.parametrize("verdict", [*VERDICTS, "shown", True])
def test_only_what_is_proved_is_claimed(verdict: Any) -> None:
    for name in (*CLAIMS, "DM", "P4"):
        given = {"P2a": "proved", name: verdict}
        if name == "P4" or verdict not in VERDICTS:
            with pytest.raises(RejectedError, match="is unknown"):
                proved_claims(given)
        elif name == "P2a" and verdict != "proved":
            with pytest.raises(RejectedError, match="nothing is claimed"):
                proved_claims(given)
        else:
            more = {name} if verdict == "proved" and name != "DM" else set()
            assert proved_claims(given) == {"P2a"} | more
    for empty in ({}, {"DM": "proved"}, {"P2a": "assumed", "P3": "refuted"}):
        with pytest.raises(RejectedError, match="nothing is claimed"):
            proved_claims(empty)
    for wrong in (None, ["P2a"], "P2a"):
        with pytest.raises(RejectedError, match="not as it should be"):
            proved_claims(wrong)


@pytest.mark.parametrize("latch", [None, "never", "acknowledged"])
def test_a_dm_that_never_gives_back_does_not_return(latch: str | None) -> None:
    topic = None if latch == "never" else "topic"
    system, module = controllers()
    module.symbol = SimpleNamespace(latch=None if latch is None else SimpleNamespace(topic=topic))
    check_module_claims(system, module, {"P2b": "assumed"})
    if latch == "never":
        with pytest.raises(RejectedError, match="P2b"):
            check_module_claims(system, module, {"P2b": "proved"})
    else:
        check_module_claims(system, module, {"P2b": "proved"})


@pytest.mark.parametrize("rests", ["proved", "assumed"])
def test_p1c_is_what_its_times_are(monkeypatch: pytest.MonkeyPatch, rests: str) -> None:
    monkeypatch.setattr(case_check, "check_module_claims", lambda *_: None)
    monkeypatch.setattr(case_check, "p1c_verdict", lambda _: rests)
    facts: Any = SimpleNamespace(
        times={"H_ns": 5, "H_star_ns": 5},
        setting=SimpleNamespace(by_dm=[], by_sc=[]),
        start_ns=9,
        flying=None,
        flying_module=None,
    )
    for given, back in itertools.product(VERDICTS, VERDICTS):
        said = {"P1c": given, "P2b": back}
        if given == "proved" and rests == "assumed":
            with pytest.raises(RejectedError, match="it is assumed"):
                case_check.check_static_claims(facts, said)
        else:
            case_check.check_static_claims(facts, said)


def test_what_comes_after_the_horizon_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RejectedError, match="`x`"):
        claimed(monkeypatch, "assumed", 5, 5, start=6, seen="")
    claimed(monkeypatch, "assumed", 6, 5, start=6, seen="")


# ---------------------------------------------------------------- times


def timed(horizon: object = None) -> tuple[Any, dict[str, int]]:
    times = {key: 10 * (k + 1) for k, key in enumerate(TIME_KEYS)}
    reads = [SimpleNamespace(max_age=7)]
    facts = SimpleNamespace(
        times=dict(times),
        setting=SimpleNamespace(by_dm=reads, by_sc=reads * 2),
        symbol=SimpleNamespace(verify=SimpleNamespace(horizon=horizon)),
    )
    return facts, times


@all_rows("key", TIME_KEYS)
@all_rows("horizon", [None, "declared"])
def test_times_are_those_of_the_program_or_longer(key: str, horizon: str | None) -> None:
    fixed = key in DECLARED_KEYS or (key == "H_ns" and horizon is not None)
    _, own = timed()
    together = sum(own.values()) + 3 * 7
    most = 4 * own[key] + together + module_times.BEYOND_NS
    for value in (own[key] - 1, own[key], own[key] + 1, most, most + 1):
        facts, _ = timed(horizon)
        given = {**own, key: value}
        if value < own[key] or (fixed and value != own[key]):
            with pytest.raises(RejectedError, match=f"{key} is {value}"):
                compare_times(facts, given)
        elif value > most:
            with pytest.raises(NotRecheckedError, match="no program needs"):
                compare_times(facts, given)
        else:
            compare_times(facts, given)
            assert facts.times == given
    for wrong in (True, 10.0, "10", None):
        facts, _ = timed()
        with pytest.raises(RejectedError, match="is no time"):
            compare_times(facts, {**own, key: wrong})
    for keys in (set(own) - {key}, {*own, "X_ns"}):
        facts, _ = timed()
        with pytest.raises(RejectedError, match="`times` has"):
            compare_times(facts, dict.fromkeys(keys, 10))


def test_no_window_is_claimed_that_takes_another_argument() -> None:
    """Up to half a period, as the program's own, and beyond where that is beyond."""
    for own_jitter, claimed_jitter, fine in ((5, 10, True), (5, 11, False), (11, 15, True)):
        facts, _ = timed()
        facts.times["j_ns"] = own_jitter
        given = {**facts.times, "j_ns": claimed_jitter}
        assert facts.times["delta_ns"] == 20
        if fine:
            compare_times(facts, given)
        else:
            with pytest.raises(NotRecheckedError, match="more than half a period"):
                compare_times(facts, given)


# ---------------------------------------------------------------- ways


def part(
    name: str,
    *,
    drives: str = "",
    reads: str = "",
    queue: bool = False,
    role: str = "",
    bare: bool = False,
) -> Any:
    """A plant, or a node where it has a role; topics by letters."""
    scope = SimpleNamespace(topics={c: ord(c) for c in "abcdef"})
    plant = node = None
    if not role and not bare:
        plant = SimpleNamespace(drives=[(c, None) for c in drives], reads=list(reads))
    elif not bare:
        subscribed = [SimpleNamespace(topic=c, queue=1 if queue else None) for c in reads]
        node = SimpleNamespace(publishes=list(drives), subscribes=subscribed)
    made = {"name": name, "plant": plant, "node": node, "scope": scope, "role": role}
    writes, written = [[ord(c) for c in names] for names in (drives, reads)]
    return SimpleNamespace(**made, period_ns=5, phase_ns=1, writes=writes, reads=written)


def system_of(*parts: Any, queues: str = "") -> Any:
    topics = [
        SimpleNamespace(name=chr(k), index=k, queue_of=1 if chr(k) in queues else None)
        for k in range(128)
    ]
    return SimpleNamespace(name="S", components=list(parts), topics=topics)


def test_ways_go_straight_from_a_plant_and_to_one() -> None:
    parts = (part("p", drives="a"), part("q", drives="ab", reads="c"), part("r"))
    module: Any = SimpleNamespace(outputs=[ord("c")])
    ways = derived_times.Ways(system_of(*parts), module)
    of = [TopicPath(Clock(n, 5, 1)) for n in "pq"]
    assert ways.ways_to(ord("a")) == tuple(of)
    assert ways.ways_to(ord("b")) == (of[1],)
    with pytest.raises(NotRecheckedError, match="behind `d`"):
        ways.ways_to(ord("d"))
    assert ways.find_effects(2, 3) == (Effect(2, 3),)
    for outputs in ("cd", "d"):
        module.outputs = [ord(c) for c in outputs]
        with pytest.raises(NotRecheckedError, match="feels `d`"):
            ways.find_effects(0, 0)
    module.outputs = [ord("c")]
    node_alone = derived_times.Ways(system_of(part("n", reads="c", role="node")), module)
    with pytest.raises(NotRecheckedError, match="feels `c`"):
        node_alone.find_effects(0, 0)


@pytest.mark.parametrize(
    ("of", "queues", "between"),
    [
        ({"drives": "a", "reads": "c"}, "", False),  # a plant
        ({"reads": "c", "role": "node"}, "", True),  # reads what the module publishes
        ({"reads": "d", "role": "node"}, "", False),
        ({"reads": "d", "role": "node"}, "d", True),  # a queue of something
        ({"reads": "d", "role": "node", "queue": True}, "", True),
        ({"reads": "c", "role": "sc"}, "", False),
        ({"reads": "c", "role": "sc", "queue": True}, "", False),
        ({"drives": "a", "role": "node"}, "", True),  # publishes what is read
        ({"drives": "a", "role": "sc"}, "", True),
        ({"drives": "b", "role": "node"}, "", False),
        ({"bare": True, "role": "node"}, "", False),
    ],
)
def test_a_node_between_is_seen(of: dict[str, Any], queues: str, between: bool) -> None:
    module: Any = SimpleNamespace(outputs=[ord("c")])
    first = part("first", drives="e", role="dm")
    for parts in ((first, part("p", **of)), (part("p", **of), first)):
        system = system_of(*parts, queues=queues)
        assert derived_times.has_nodes_between(system, module, [ord("a")]) is between


# ---------------------------------------------------------------- what is understood


def test_an_sc_is_nothing_but_its_step() -> None:
    plain: dict[str, Any] = {
        "extern": False,
        "takeover": None,
        "subscribes": [],
        "bursts": {},
        "step": [],
    }
    topic = SimpleNamespace(name="x")
    queued, latest = (SimpleNamespace(queue=q, topic=topic) for q in (3, None))
    for change, words in (
        ({}, ""),
        ({"subscribes": [latest, latest]}, ""),
        ({"extern": True}, "not Soter source"),
        ({"takeover": ["s"]}, "on takeover"),
        ({"subscribes": [latest, queued]}, "queue of `x`"),
        ({"bursts": {"u": 2}}, "several messages"),
        ({"step": [t.TypedPush.__new__(t.TypedPush)]}, "`push` in SC"),
    ):
        sc: Any = SimpleNamespace(**{**plain, **change})
        if words:
            with pytest.raises(NotRecheckedError, match=words):
                supported_constructs._require_supported_sc(sc)
        else:
            supported_constructs._require_supported_sc(sc)


def test_a_plant_is_source_and_publishes_from_the_start() -> None:
    def plant(phase: int = 0, **more: Any) -> Any:
        code = {"drives": (), "lets": (), "der": {}, "next": {}, "extern": False}
        return SimpleNamespace(name="P", phase_ns=phase, plant=SimpleNamespace(**{**code, **more}))

    wrong = t.TruthRead.__new__(t.TruthRead)
    supported_constructs._require_known_plant(plant())
    for made, words in (
        (plant(1), "at the start"),
        (plant(extern=True), "extern"),
        (plant(drives=[("x", wrong)]), "`truth`"),
        (plant(lets=[("x", wrong)]), "`truth`"),
        (plant(der={"x": wrong}), "`truth`"),
        (plant(next={"x": wrong}), "`truth`"),
    ):
        with pytest.raises(NotRecheckedError, match=words):
            supported_constructs._require_known_plant(made)


@pytest.mark.parametrize(("extern", "body"), [(False, ()), (True, ()), (False, None), (True, None)])
def test_a_function_without_a_body_is_unknown(extern: bool, body: Any) -> None:
    fun = t.FunSymbol.__new__(t.FunSymbol)
    for name, value in (
        ("name", "f"),
        ("parameters", ()),
        ("extern", extern),
        ("body", body),
        ("source", None),
        ("prelude", False),
        ("result", None),
    ):
        object.__setattr__(fun, name, value)
    call: Any = t.TypedCall.__new__(t.TypedCall)
    for name, value in (("fun", fun), ("arguments", ())):
        object.__setattr__(call, name, value)
    assert list(supported_constructs.code_parts([call, call])) == [call, fun]
    if extern or body is None:
        with pytest.raises(NotRecheckedError, match="extern function"):
            supported_constructs._require_known_code(call, "SC")
    else:
        supported_constructs._require_known_code(call, "SC")


def test_a_queue_is_not_what_a_module_reads() -> None:
    for queued in (None, 0, 1):
        topics = [SimpleNamespace(name=n, queue_of=1 if k == queued else None)
                  for k, n in enumerate("abc")]  # fmt: skip
        sc = SimpleNamespace(scope=SimpleNamespace(topics={"b": 1, "c": 2}))
        flying = SimpleNamespace(components=[sc], inputs=[], topics=topics)
        module = SimpleNamespace(outputs=(0,), sc=0)
        facts: Any = SimpleNamespace(flying=flying, flying_module=module, controllers=[sc])
        if queued == 1:
            with pytest.raises(NotRecheckedError, match="`b` is a queue"):
                supported_constructs._require_own_topics(facts)
        else:
            supported_constructs._require_own_topics(facts)


# ---------------------------------------------------------------- questions about a problem


@pytest.fixture(scope="module")
def facts(tmp_path_factory: pytest.TempPathFactory) -> Facts:
    return facts_with(tmp_path_factory.mktemp("all"))


def test_times_that_follow_from_times(facts: Facts) -> None:
    own = copy.copy(facts)
    own.times = {k: 10**i for i, k in enumerate(("A_ns", "Delta_ns", "J_dm_ns", "R_dm_ns"))}
    own.times |= {"d_ns": 5, "j_ns": 6, "h0_ns": 7}
    assert (own.decide_ns, own.between_ns) == (1111, 111)
    assert (own.delay_ns, own.jitter_ns) == (5, 6)
    for start in (6, 7, 8):
        own.own = SimpleNamespace(start=start)  # type: ignore[assignment]
        assert own.start_ns == max(start, 7)


def test_predicates_are_computed_where_both_are_left_out() -> None:
    for ttf, safer in itertools.product((None, "e"), repeat=2):
        own = SimpleNamespace(symbol=SimpleNamespace(ttf=ttf, safer=safer))
        computed: Any = module_facts.Facts.computed
        assert computed.fget(own) is (ttf is None and safer is None)


def test_what_is_read_is_told_apart_by_who_reads_it(tmp_path: Path) -> None:
    def names(facts: Facts) -> list[list[str]]:
        return [[facts.system.topics[i].name for i in of] for of in module_facts.topics_read(facts)]

    by_dm, by_sc = names(facts_with(tmp_path))
    assert (by_dm, sorted(by_sc)) == (["x"], ["x", "y"])
    own = facts_with(tmp_path, ("ttf abs(x.a)", "ttf abs(y)"), ("wish - GAIN * x.a - x.b - y", "y"))
    by_dm, by_sc = names(own)
    assert (sorted(by_dm), by_sc) == (["x", "y"], ["y"])
    without = ("  ttf abs(x.a) > 2.0;\n  safer abs(x.a) < 1.0;\n", "")
    assert names(facts_with(tmp_path, without))[0] == ["x"]
    bounded = [own.system.topics[i].name for i in module_facts.bounded_topics(own)]
    assert bounded == ["y"]


def test_controllers_that_command_are_those_of_the_module() -> None:
    roles = ["ac", "sc", "dm", "node"]
    components = [SimpleNamespace(module=m, role=r) for m in (0, 1, None) for r in roles]
    own = SimpleNamespace(
        flying_module=SimpleNamespace(index=1), flying=SimpleNamespace(components=components)
    )
    commanding: Any = module_facts.Facts.controllers
    assert [(c.module, c.role) for c in commanding.fget(own)] == [(1, "ac"), (1, "sc")]


def test_an_sc_that_is_no_source_reads_nothing_that_is_known() -> None:
    for node in (None, SimpleNamespace(extern=True, step=())):
        with pytest.raises(NotRecheckedError, match="not Soter source"):
            module_facts.topics_read_by_sc(SimpleNamespace(node=node))  # type: ignore[arg-type]
    plain: Any = SimpleNamespace(node=SimpleNamespace(extern=False, takeover=None, step=()))
    assert module_facts.topics_read_by_sc(plain) == []


def test_numbers_of_a_module(facts: Facts) -> None:
    assert module_facts.const_value(facts, None) == 0
    assert list(facts.cases()) == list(itertools.product((0, 1), (0, 1, 2), (2, 3, 4)))


# ---------------------------------------------------------------- commands and maps


@pytest.mark.parametrize(("low", "high"), [(-1.0, 2.0), (0.0, 0.0)])
def test_a_command_of_each_step_lies_in_its_set(low: float, high: float) -> None:
    control: Any = SimpleNamespace(owner=3, leaf=1, low=low, high=high, name="u")
    for value in (-1.5, -1.0, 0.0, 2.0, 2.5):
        terms = Terms()
        command = command_term(terms, control, [{3: (9.0, value)}])
        assert float(command.low) == float(command.high) == value
        assert all(holds(terms, o, []) for o in terms.obligations) is (low <= value <= high)
    terms = Terms()
    two = command_term(terms, control, [{3: (9.0, low)}, {3: (9.0, high)}])
    assert (float(two.low), float(two.high)) == (low, high)
    with pytest.raises(NotRecheckedError, match="does not publish `u`"):
        command_term(terms, control, [{3: (9.0, low)}, {2: (9.0, low)}])


MAP = (
    ("der p = v;", "next p = p + 0.5 * v;"),
    ("der v = (heavy", "next v = (heavy"),
    ("max_age 20ms;\ntopic y", "max_age 5ms;\ntopic y"),
    ("3.0] max_age 20ms", "3.0] max_age 5ms"),
)


def test_a_map_is_stepped_as_often_as_it_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    facts = facts_with(tmp_path, *MAP)
    model = model_of(facts)
    _, states = model.new_terms()
    for members in ([0], [1], [0, 1], []):
        boxes = case_model.other_ends(model, states, members)
        wanted = [k for k in range(2) if k not in members]
        assert list(boxes) == [states[k].atom for k in wanted]
        for k in wanted:
            ends = boxes[states[k].atom]
            assert tuple(map(float, ends)) == model.extents[k]
    period = facts.plants[0].period_ns
    for time, steps in ((0, 0), (1, 1), (period, 1), (period + 1, 2), (3 * period, 3)):
        assert len(maps.map_phase(model, [0, 1], time)) == steps
    for most in (1, 2, 3):
        monkeypatch.setattr(maps, "PHASE_MAX", most)
        monkeypatch.setattr(maps, "STEPS_MAX", most)
        if most >= 2:
            maps.map_phase(model, [0, 1], 2 * period)
            maps.map_steps_in_period(model, [0, 1])  # two steps of the map in a period of SC
        else:
            for of in (lambda: maps.map_phase(model, [0, 1], 2 * period),
                       lambda: maps.map_steps_in_period(model, [0, 1])):  # fmt: skip
                with pytest.raises(NotRecheckedError, match="steps of the map"):
                    of()


@pytest.mark.parametrize(
    ("rate", "seen", "fine"),
    [
        ("v", [], True),
        ("1.0 / (v + 10.0)", [], True),
        ("1.0 / v", [], False),
        ("1.0 / v", [(0,)], False),
        ("1.0 / v", [(1,)], True),
        ("1.0 / v", [(0,), (1,)], True),
        ("1.0 / (p + v)", [(0,)], True),
        ("1.0 / wind", [], False),
        ("1.0 / wind", [(0,)], True),
        ("v + 1.0 / (wind + 9.0)", [], True),
    ],
)
def test_rates_are_defined_or_somebody_looks(
    tmp_path: Path, rate: str, seen: list[tuple[int, ...]], fine: bool
) -> None:
    model = model_of(facts_with(tmp_path, ("der p = v;", f"der p = {rate};")))
    if fine:
        case_check.require_rates(model, seen)
    else:
        with pytest.raises(NotRecheckedError, match="not defined everywhere"):
            case_check.require_rates(model, seen)


def test_of_a_map_every_cell_is_asked(tmp_path: Path) -> None:
    pairs = (*MAP[1:], ("der p = v;", "next p = 1.0 / v;"))
    case_check.require_rates(model_of(facts_with(tmp_path, *pairs)), [])

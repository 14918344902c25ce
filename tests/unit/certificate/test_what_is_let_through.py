"""What is claimed, declared and understood: each refusal alone, and what it lets through."""

from __future__ import annotations

import copy
import dataclasses
import itertools
from typing import TYPE_CHECKING, Any

import pytest

from soter.certificate import case_check
from soter.certificate.case_check import (
    CLAIMS,
    VERDICTS,
    check_module_claims,
    check_static_claims,
    proved_claims,
)
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
from soter.certificate.reading.supported_constructs import require_supported
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.terms import Terms
from soter.language.front_end import check_file, system_to_prove
from soter.language.model import typed as t
from tables import all_rows
from unit.certificate.test_one_instant import TEXT as TWO
from unit.certificate.test_problem_by_definition import facts_with, model_of
from unit.certificate.test_reading_by_evaluation import holds
from unit.certificate.test_single_refusals import DECLARED, OTHER, READS_Y, facts_of

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.reading.module_facts import Facts
    from soter.language.model.system import System


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


@pytest.mark.parametrize("returns", ["", "returns never;", "returns after button;"])
def test_a_dm_that_never_gives_back_does_not_return(tmp_path: Path, returns: str) -> None:
    button = ("topic u:", "input topic button: bool = false max_age 9s;\ntopic u:")
    facts = facts_of(tmp_path, button, ("safer abs(x) < 1.0;", f"safer abs(x) < 1.0; {returns}"))
    system, module = facts.flying, facts.flying_module
    check_module_claims(system, module, {"P2b": "assumed"})
    if "never" in returns:
        with pytest.raises(RejectedError, match="P2b"):
            check_module_claims(system, module, {"P2b": "proved"})
    else:
        check_module_claims(system, module, {"P2b": "proved"})


@pytest.mark.parametrize("rests", ["proved", "assumed"])
def test_p1c_is_what_its_times_are(tmp_path: Path, rests: str) -> None:
    facts = facts_of(tmp_path, *([DECLARED] if rests == "proved" else []))
    for given, back in itertools.product(VERDICTS, VERDICTS):
        said = {"P1c": given, "P2b": back}
        if given == "proved" and rests == "assumed":
            with pytest.raises(RejectedError, match="it is assumed"):
                check_static_claims(facts, said)
        else:
            check_static_claims(facts, said)


# ---------------------------------------------------------------- times


HORIZON = ("verify { ", "verify { horizon 100ms; ")


@pytest.fixture(scope="module")
def clocked(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, Facts]:
    """Facts without and with a declared horizon: the DM reads one topic, and SC two."""
    folder = tmp_path_factory.mktemp("clocked")
    return {
        declared: facts_of(folder, READS_Y, *[HORIZON] * declared) for declared in (False, True)
    }


def timed(facts: Facts) -> tuple[Facts, dict[str, int]]:
    """A copy of these facts with small times."""
    facts = copy.copy(facts)
    facts.times = {key: 10 * (k + 1) for k, key in enumerate(TIME_KEYS)}
    return facts, dict(facts.times)


@all_rows("key", TIME_KEYS)
@all_rows("horizon", [False, True])
def test_times_are_those_of_the_program_or_longer(
    clocked: dict[bool, Facts], key: str, horizon: bool
) -> None:
    fixed = key in DECLARED_KEYS or (key == "H_ns" and horizon)
    _, own = timed(clocked[horizon])
    together = sum(own.values()) + 3 * 20_000_000
    most = 4 * own[key] + together + module_times.BEYOND_NS
    for value in (own[key] - 1, own[key], own[key] + 1, most, most + 1):
        facts, _ = timed(clocked[horizon])
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
        facts, _ = timed(clocked[horizon])
        with pytest.raises(RejectedError, match="is no time"):
            compare_times(facts, {**own, key: wrong})
    for keys in (set(own) - {key}, {*own, "X_ns"}):
        facts, _ = timed(clocked[horizon])
        with pytest.raises(RejectedError, match="`times` has"):
            compare_times(facts, dict.fromkeys(keys, 10))


def test_no_window_is_claimed_that_takes_another_argument(clocked: dict[bool, Facts]) -> None:
    """Up to half a period, as the program's own, and beyond where that is beyond."""
    for own_jitter, claimed_jitter, fine in ((5, 10, True), (5, 11, False), (11, 15, True)):
        facts, _ = timed(clocked[False])
        facts.times["j_ns"] = own_jitter
        given = {**facts.times, "j_ns": claimed_jitter}
        assert facts.times["delta_ns"] == 20
        if fine:
            compare_times(facts, given)
        else:
            with pytest.raises(NotRecheckedError, match="more than half a period"):
                compare_times(facts, given)


# ---------------------------------------------------------------- ways


def system_of(folder: Path, *pairs: tuple[str, str]) -> System:
    text = TWO
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = folder / "two.soter"
    path.write_text(text)
    checked = check_file(str(path))
    assert checked.ok, checked.diagnostics
    return system_to_prove(checked, "S")


def test_ways_go_straight_from_a_plant_and_to_one(tmp_path: Path) -> None:
    system = system_of(tmp_path)
    (module,) = system.modules
    index = {topic.name: topic.index for topic in system.topics}
    ways = derived_times.Ways(system, module)
    p, q = (TopicPath(Clock(name, 10_000_000, 0)) for name in "pq")
    assert ways.ways_to(index["y"]) == (q,)
    of_q = next(c for c in system.components if c.name == "q").scope.topics
    of_q[next(of for of in of_q if of.name == "y")] = index["x"]  # two plants drive it now
    assert ways.ways_to(index["x"]) == (p, q)
    with pytest.raises(NotRecheckedError, match="behind `y`"):
        ways.ways_to(index["y"])
    assert ways.find_effects(2, 3) == (Effect(2, 3),)
    for outputs in ("uy", "y"):
        module.outputs = tuple(index[name] for name in outputs)
        with pytest.raises(NotRecheckedError, match="feels `y`"):
            ways.find_effects(0, 0)
    module.outputs = (index["x"],)  # which nodes read alone
    with pytest.raises(NotRecheckedError, match="feels `x`"):
        ways.find_effects(0, 0)


@pytest.mark.parametrize(
    ("node", "read", "between"),
    [
        ("", "x", False),  # plants and controllers alone
        ("subscribes u; step { }", "x", True),  # reads what the module publishes
        ("subscribes y; step { }", "x", False),
        ("subscribes y queue 2; step { }", "x", True),
        ("subscribes x; publishes z; step { publish z = 1.0; }", "z", True),
        ("subscribes x; publishes z; step { publish z = 1.0; }", "x", False),
        ("", "u", True),  # SC and AC publish what is read
    ],
)
def test_a_node_between_is_seen(tmp_path: Path, node: str, read: str, between: bool) -> None:
    pairs = [
        ("plant P", f"topic z: float;\nnode N period 10ms {{ {node} }}\nplant P"),
        ("module M;", "n: N; module M;"),
    ]
    system = system_of(tmp_path, *pairs[: 2 if node else 0])
    (index,) = (topic.index for topic in system.topics if topic.name == read)
    assert derived_times.has_nodes_between(system, system.modules[0], [index]) is between


def test_a_queue_counts_as_a_node_between_by_either_sign_of_it(tmp_path: Path) -> None:
    """By the topic that a node reads, and by its subscription; SC's own queue is none."""
    node = "node N period 10ms { subscribes y queue 2; step { } }"
    queue = ("plant P", f"{node}\nplant P"), ("module M;", "n: N; module M;")
    for topic_alone in (True, False):
        system = system_of(tmp_path, *queue)
        if topic_alone:
            (n,) = (c.node for c in system.components if c.name == "n")
            assert n is not None
            n.subscribes[0].queue = None
        else:
            for topic in system.topics:
                topic.queue_of = None
        assert derived_times.has_nodes_between(system, system.modules[0], [])
    of_sc = system_of(tmp_path, ("subscribes x, y;", "subscribes x, y queue 2;"))
    assert not derived_times.has_nodes_between(of_sc, of_sc.modules[0], [])


# ---------------------------------------------------------------- what is understood


SLOW = "node Slow period 20ms { subscribes x, y; publishes u;"


@pytest.mark.parametrize(
    ("pair", "change", "words"),
    [
        ((), {}, ""),
        ((), {"extern": True}, "not Soter source"),
        ((SLOW, f"{SLOW} var a: float = 0.0; on takeover {{ a = 1.0; }}"), {}, "on takeover"),
        (("subscribes x, y;", "subscribes x, y queue 2;"), {}, "queue of `y`"),
        ((), {"bursts": {"u": 2}}, "several messages"),
        ((), {"step": (t.TypedPush.__new__(t.TypedPush),)}, "`push` in SC"),
    ],
)
def test_an_sc_is_nothing_but_its_step(
    tmp_path: Path, pair: tuple[str, str] | tuple[()], change: dict[str, Any], words: str
) -> None:
    facts = facts_of(tmp_path, *([pair] if pair else []))
    for name, value in change.items():
        setattr(facts.sc.node, name, value)
    if words:
        with pytest.raises(NotRecheckedError, match=words):
            require_supported(facts)
    else:
        require_supported(facts)


WRONG = t.TruthRead.__new__(t.TruthRead)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"phase_ns": 1}, "at the start"),
        ({"extern": True}, "extern"),
        ({"drives": WRONG}, "`truth`"),
        ({"lets": WRONG}, "`truth`"),
        ({"der": WRONG}, "`truth`"),
        ({"next": WRONG}, "`truth`"),
    ],
)
def test_a_plant_is_source_and_publishes_from_the_start(
    tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    facts = facts_of(tmp_path, ("der q = -q;", "let twice = 2.0 * q; der q = -q;"))
    require_supported(facts)
    component = facts.plants[-1]
    assert component.plant is not None
    ((name, value),) = change.items()
    if name in ("drives", "lets"):
        ((of, _),) = getattr(component.plant, name)
        value = ((of, value),)
    elif name in ("der", "next"):
        value = dict.fromkeys(component.plant.states, value)
    setattr(component if name == "phase_ns" else component.plant, name, value)
    with pytest.raises(NotRecheckedError, match=words):
        require_supported(facts)


@pytest.mark.parametrize(
    ("extern", "body"), [(False, True), (True, True), (False, False), (True, False)]
)
def test_a_function_without_a_body_is_unknown(tmp_path: Path, extern: bool, body: bool) -> None:
    own = ("topic u:", "fun f(a: float): float { return a; }\ntopic u:")
    facts = facts_of(tmp_path, own, ("clamp(-x,", "clamp(f(f(-x)),"))
    assert facts.sc.node is not None
    parts = supported_constructs.code_parts([*facts.sc.node.step] * 2)
    (fun,) = (part for part in parts if isinstance(part, t.FunSymbol) and part.name == "f")
    fun.extern = extern
    if not body:
        fun.body = None
    if extern or not body:
        with pytest.raises(NotRecheckedError, match="extern function"):
            require_supported(facts)
    else:
        require_supported(facts)


def test_a_queue_is_not_what_a_module_reads(tmp_path: Path) -> None:
    """Nor is there one among its outputs."""
    for queued in ("", "z", "y", "u"):
        beside = (
            ("topic u:", "topic z: float;\ntopic u:"),
            ("drives y = q;", "drives y = q; drives z = q;"),
        )
        facts = facts_of(tmp_path, *beside)
        assert queued in {"", *(topic.name for topic in facts.flying.topics)}
        for topic in facts.flying.topics:
            if topic.name == queued:
                topic.queue_of = 1
        if queued in ("y", "u"):
            with pytest.raises(NotRecheckedError, match=f"`{queued}` is a queue"):
                require_supported(facts)
        else:
            require_supported(facts)


# ---------------------------------------------------------------- questions about a problem


@pytest.fixture(scope="module")
def facts(tmp_path_factory: pytest.TempPathFactory) -> Facts:
    return facts_with(tmp_path_factory.mktemp("all"))


def test_times_that_follow_from_times(facts: Facts) -> None:
    own = copy.copy(facts)
    own.times = {k: 10**i for i, k in enumerate(("A_ns", "Delta_ns", "J_dm_ns", "R_dm_ns"))}
    own.times |= {"d_ns": 5, "j_ns": 6, "h0_ns": 7}
    assert (own.verdict_delay_ns, own.ns_between_verdicts) == (1111, 111)
    assert (own.delay_ns, own.jitter_ns) == (5, 6)
    for start in (6, 7, 8):
        own.derived = dataclasses.replace(facts.derived, start=start)
        assert own.start_ns == max(start, 7)


def test_predicates_are_computed_where_both_are_left_out(tmp_path: Path) -> None:
    own = facts_of(tmp_path)
    for ttf, safer in itertools.product((None, own.symbol.ttf), (None, own.symbol.safer)):
        own.symbol.ttf, own.symbol.safer = ttf, safer
        assert own.is_computed is (ttf is None and safer is None)


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


def test_controllers_that_command_are_those_of_the_module(tmp_path: Path) -> None:
    node = "topic z: float;\nnode Z period 20ms { subscribes y; publishes z; step { } }"
    pairs = ("topic u:", f"{OTHER}{node}\ntopic u:"), ("module M;", "n: Z; module M; module N;")
    own = facts_of(tmp_path, *pairs)
    assert sorted((c.name, c.role) for c in own.controllers) == [("M.Fast", "ac"), ("M.Slow", "sc")]


def test_an_sc_that_is_no_source_reads_nothing_that_is_known(tmp_path: Path) -> None:
    own = facts_of(tmp_path)
    node = own.sc.node
    assert node is not None
    assert [topic.name for topic in module_facts.topics_read_by_sc(own.sc)] == ["x"]
    node.step = ()
    assert module_facts.topics_read_by_sc(own.sc) == []
    node.extern = True
    for there in (node, None):
        own.sc.node = there
        with pytest.raises(NotRecheckedError, match="not Soter source"):
            module_facts.topics_read_by_sc(own.sc)


def test_numbers_of_a_module(facts: Facts) -> None:
    assert module_facts.const_value(facts, None) == 0
    assert list(facts.parameter_combinations()) == list(
        itertools.product((0, 1), (0, 1, 2), (2, 3, 4))
    )


# ---------------------------------------------------------------- commands and maps


@pytest.mark.parametrize(("low", "high"), [(-1.0, 2.0), (0.0, 0.0)])
def test_a_command_of_each_step_lies_in_its_set(low: float, high: float) -> None:
    control = module_facts.Input("control", "u", 3, 1, low, high)
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
        boxes = case_model.ends_of_other_states(model, states, members)
        wanted = [k for k in range(2) if k not in members]
        assert list(boxes) == [states[k].atom for k in wanted]
        for k in wanted:
            ends = boxes[states[k].atom]
            assert tuple(map(float, ends)) == model.extents[k]
    period = facts.plants[0].period_ns
    for time, steps in ((0, 0), (1, 1), (period, 1), (period + 1, 2), (3 * period, 3)):
        assert len(maps.map_steps_in_time(model, [0, 1], time)) == steps
    for most in (1, 2, 3):
        monkeypatch.setattr(maps, "PHASE_MAX", most)
        monkeypatch.setattr(maps, "STEPS_MAX", most)
        if most >= 2:
            maps.map_steps_in_time(model, [0, 1], 2 * period)
            maps.map_steps_in_period(model, [0, 1])  # two steps of the map in a period of SC
        else:
            for of in (lambda: maps.map_steps_in_time(model, [0, 1], 2 * period),
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
        case_check.require_defined_rates(model, seen)
    else:
        with pytest.raises(NotRecheckedError, match="not defined everywhere"):
            case_check.require_defined_rates(model, seen)


def test_of_a_map_every_cell_is_asked(tmp_path: Path) -> None:
    pairs = (*MAP[1:], ("der p = v;", "next p = 1.0 / v;"))
    case_check.require_defined_rates(model_of(facts_with(tmp_path, *pairs)), [])

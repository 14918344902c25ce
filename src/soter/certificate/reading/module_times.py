"""The times of one module, read again off the program, and compared with those of a manifest.

Purpose: `read_times` makes a `TimingSetting` of the declared delays, what DM and SC read with its
`max_age`, and the nodes on the way, and has all times derived; `compare_times` compares those of a
manifest with them.
Non-goals: the derivation (`derived_times.py`), the nodes on the way (`node_paths.py`), whether the
trusted thread keeps these times (`thread_times.py`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from soter.certificate.extras import extras
from soter.certificate.folder import only_keys
from soter.certificate.reading.derived_times import (
    NOW,
    Clock,
    DerivedTimes,
    TimingSetting,
    TopicReading,
    Ways,
    derive,
    nodes_between,
)
from soter.certificate.reading.module_facts import (
    DiffersError,
    Facts,
    driven_topics,
    number_of,
    topics_read,
)
from soter.certificate.reading.supported_constructs import parts_of
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.language.model import typed
from soter.language.model.types import leaves, show_ns

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from soter.language.model.system import Component

DELAYS = {
    "J_dm_ns": ("late dm", "late_dm"),
    "J_sc_ns": ("late sc", "late_sc"),
    "R_dm_ns": ("response dm", "response_dm"),
    "R_sc_ns": ("response sc", "response_sc"),
    "L_ns": ("acts within", "acts"),
}
"""Name in the manifest -> how the program says it, and where the `verify` block has it."""


def _check_instants(facts: Facts, reads: tuple[list[int], list[int]]) -> None:
    driven = driven_topics(facts)
    for together in reads:
        if len({(driven[t][0].period_ns, driven[t][0].phase_ns) for t in together}) > 1:
            raise DiffersError("what is read together is published at different times")


def _check_ways(facts: Facts, setting: TimingSetting, reads: tuple[list[int], list[int]]) -> None:
    """Check that an estimate shows one instant, and that SC's reads may have an age for each topic.

    The DM compares the stamps of what plants publish to it. The stamp of a node does not show what
    the node has read: that has to come by one way to all numbers of the estimate, and from one
    topic where sensors may be silent. Of what SC reads each state has an age of its own in chains
    and tubes, so that no state may come by two topics of different ages, nor by two numbers of one
    topic that is made of several reads.
    DiffersError where this is not so.
    """
    by_dm, by_sc = (
        {w for r in of for w in _sampled(facts, r)} for of in (setting.by_dm, setting.by_sc)
    )
    numbers = sum(1 for i in reads[0] for _ in leaves(facts.system.topics[i].type))
    apart = len({clocks for clocks, _ in by_dm}) > 1 < numbers
    if setting.silent and any(clocks[1:] for clocks, _ in by_dm):
        apart |= len({name for _, name in by_dm}) > 1
    if apart:
        raise DiffersError("what the DM reads may show several instants, and no stamp tells")
    if _instants(by_sc, setting) < 2:
        return
    shown = []
    for read, index in zip(setting.by_sc, reads[1], strict=True):
        plant, published = driven_topics(facts)[index]
        apart = _instants(_sampled(facts, read), setting) > 1
        parts = _numbers(published) if apart else [published]
        shown += [_states_behind(plant, part) for part in parts]
    twice = sum(map(len, shown)) > len(set[object]().union(*shown))
    if twice:
        raise DiffersError("what SC reads may show several instants, and counts as one")


def _instants(ways: Iterable[tuple[tuple[Clock, ...], str]], setting: TimingSetting) -> int:
    """How many instants ways show: as many as differ, or as the topics that may be silent."""
    every = set(ways)
    heard = {name for _, name in every} if setting.silent else set()
    return max(len({clocks for clocks, _ in every}), len(heard))


def _numbers(published: typed.TypedExpr) -> list[typed.TypedExpr]:
    """What each number of a value is made of; the whole of what is not written out by parts."""
    if isinstance(published, typed.Aggregate):
        return [x for e in published.elements for x in _numbers(e)]
    return [published for _ in leaves(published.type)]


def _sampled(facts: Facts, read: TopicReading) -> Iterator[tuple[tuple[Clock, ...], str]]:
    """Each way of a topic from a plant, as clocks, with a topic of the plant at its beginning.

    Plants of one period and phase have one clock.
    """
    for path in read.paths:
        clocks = (replace(path.clocks[0], name=""), *path.clocks[1:])
        if path.sensor is NOW:
            continue
        if len(clocks) == 1:
            yield clocks, read.name
            continue
        plant, first = (facts.flying.component(c.name) for c in path.clocks[:2])
        for index in {*plant.writes} & {*first.reads}:
            yield clocks, facts.flying.topics[index].name


def _states_behind(plant: Component, published: typed.TypedExpr) -> set[tuple[int, object]]:
    """The states and disturbances of which a plant makes what it publishes."""
    assert plant.plant is not None
    lets: dict[object, object] = dict(plant.plant.lets)
    todo: list[object] = [published]
    found: set[tuple[int, object]] = set()
    while todo:
        for part in parts_of([todo.pop()]):
            if isinstance(part, typed.VarRead) and (plant.index, part.variable) not in found:
                found.add((plant.index, part.variable))
                todo += [lets[part.variable]] if part.variable in lets else []
    return found


def _check_max_ages(setting: TimingSetting, own: DerivedTimes) -> None:
    for read in setting.by_sc:
        oldest = own.stamps.get(read.name, 0)
        if oldest > read.max_age:
            raise DiffersError(
                f"R011: what SC reads of `{read.name}` may be {show_ns(oldest)} old, "
                f"and `max_age` or `age` says {show_ns(read.max_age)}"
            )


def read_times(facts: Facts) -> None:
    """Enters into `facts` every time in ns, by its name in the manifest: declared or derived.

    DiffersError where what is declared contradicts the program, NotRecheckedError where times are
    none that are read here.
    """
    verify = facts.symbol.verify
    time_by_name = {"Delta_ns": facts.module.period_ns, "delta_ns": facts.sc.period_ns}
    for key, (_, name) in DELAYS.items():
        time_by_name[key] = number_of(facts, getattr(verify, name))
    by_dm, by_sc = topics_read(facts)
    if not verify.abstracts:
        _check_instants(facts, (by_dm, by_sc))
    running = {facts.running[i] for i in (*by_dm, *by_sc)}
    if verify.abstracts or nodes_between(facts.flying, facts.flying_module, running):
        number = partial(number_of, facts)
        facts.ways = extras.node_paths.NodeWays(facts.flying, facts.flying_module, number)
    else:
        facts.ways = Ways(facts.flying, facts.flying_module)
    setting = _timing_setting(facts, by_dm, by_sc, time_by_name)
    _check_ways(facts, setting, (by_dm, by_sc))
    if verify.abstracts:
        extras.views.check_abstracted_sensors(facts, {*by_dm, *by_sc})
    if facts.kind == "map":
        _check_map(facts, setting)
    own = derive(setting)
    # With nodes R015 holds; and so none of them skips an output (R018): let one step before it sees
    # output k, and next when k + 1 is there. Then k may not act before k + 1 may, by the same step
    # and the same nodes behind it, so that j would be delta or more.
    if 2 * own.jitter > setting.sc.period:
        _check_late_commands(facts, setting)
    _check_max_ages(setting, own)
    time_by_name |= {"A_ns": own.age, "A_sc_ns": own.age_sc, "d_ns": own.delay, "j_ns": own.jitter}
    time_by_name |= {"h0_ns": own.h_0, "H_star_ns": own.h_star, "H_ns": own.h_star}
    if verify.horizon is not None:
        time_by_name["H_ns"] = int(number_of(facts, verify.horizon))
    in_step = [name for kind, name in facts.ways.notes if kind == "in step"]
    if facts.flying.timed:
        facts.thread = extras.thread_times.check_thread(
            facts.flying, facts.flying_module, setting, in_step
        )
    facts.times, facts.own, facts.setting = time_by_name, own, setting


def _timing_setting(
    facts: Facts, by_dm: list[int], by_sc: list[int], times: dict[str, int]
) -> TimingSetting:
    """Everything that the times depend on; topics are those of the system that runs."""
    system, module = facts.flying, facts.flying_module
    dm, sc = system.components[module.dm], system.components[module.sc]

    def reads(topics: list[int]) -> tuple[TopicReading, ...]:
        found = []
        for index in topics:
            age, running = facts.system.topics[index].max_age_ns, facts.running[index]
            if age is None:
                raise NotRecheckedError("a topic that the module reads has no `max_age`")
            name = system.topics[running].name
            found.append(TopicReading(name, facts.ways.ways_to(running), age))
        return tuple(found)

    found_dm, found_sc = reads(by_dm), reads(by_sc)  # before effects: they say what is vehicle
    if facts.symbol.verify.age is not None:
        most = number_of(facts, facts.symbol.verify.age)
        found_sc = tuple(replace(r, max_age=min(r.max_age, most)) for r in found_sc)
    return TimingSetting(
        Clock("the DM", module.period_ns, dm.phase_ns, times["J_dm_ns"], times["R_dm_ns"]),
        Clock("SC", sc.period_ns, sc.phase_ns, times["J_sc_ns"], times["R_sc_ns"]),
        found_dm,
        found_sc,
        facts.ways.effects(number_of(facts, facts.symbol.verify.acts_least), times["L_ns"]),
        number_of(facts, facts.symbol.verify.dropout),
        facts.kind == "map",
    )


def _check_late_commands(facts: Facts, setting: TimingSetting) -> None:
    """NotRecheckedError where no argument is known of an SC whose jitter exceeds half its period.

    Chains of grids have one (`flow_chains.py`).
    """
    symbol = facts.symbol
    beside = {
        "nodes behind it": any(e.clocks for e in setting.effects),
        "an abstraction": bool(symbol.verify.abstracts),
        "`rest`": symbol.rest is not None,
        "`failsafe`": bool(symbol.failsafe),
        "`shield`": symbol.shield is not None,
        "views": bool(facts.view or symbol.verify.views),
    }
    for what, is_there in beside.items():
        if is_there:
            raise NotRecheckedError(f"an SC whose jitter exceeds half its period, with {what}")


def _check_map(facts: Facts, setting: TimingSetting) -> None:
    """Check that all that is read and all that acts is of one instant, in which the map steps.

    Else `NotRecheckedError`: ages and delays are not counted beside a map.
    """
    step, dm, sc = facts.plants[0].period_ns, setting.dm, setting.sc
    paths = [(r, p) for r in (*setting.by_dm, *setting.by_sc) for p in r.paths]
    late = [dm.slow, sc.slow, *(e.least | e.most for e in setting.effects)]
    between = [*(p.clocks[1:] for _, p in paths), *(e.clocks for e in setting.effects)]
    together = (dm.period, sc.period, dm.phase, sc.phase)
    beside = {
        "maps with different periods": {c.period_ns for c in facts.plants} != {step},
        "a module that does not step together with its map": any(ns % step for ns in together),
        "delays beside a map": any(late),
        "`dropout` beside a map": setting.silent,
        "nodes between a map and its module": any(between),
    }
    for what in (what for what, is_there in beside.items() if is_there):
        raise NotRecheckedError(what)
    for read, path in paths:
        sensor = path.sensor
        if sensor.phase or step % sensor.period:
            raise NotRecheckedError(f"`{sensor.name}` does not publish whenever the map steps")
        if read.max_age >= sensor.period:
            raise NotRecheckedError("beside a map `max_age` must be shorter than its period")


def acted_ns(facts: Facts) -> int:
    """W, of a shield: a command replaced longer before a release acts on no state read there.

    The state is A old at most. A command acts up to L after the next one was published; of that its
    release alone is known, so a period of SC and the latest end of its step are added.
    """
    setting = facts.setting
    out = max(setting.starts_by(t) + setting.sc.response - t for t in setting.steady_releases())
    return facts.own.age + max(e.most for e in setting.effects) + setting.sc.period + out


DECLARED_KEYS = ("Delta_ns", "delta_ns", "J_dm_ns", "J_sc_ns", "R_dm_ns", "R_sc_ns", "L_ns")
"""Times that the program declares: a manifest has them unchanged."""
DERIVED_KEYS = ("A_ns", "A_sc_ns", "H_star_ns", "d_ns", "j_ns", "h0_ns")
"""Times that follow: a manifest may claim more schedules than there are, never fewer."""
TIME_KEYS = (*DECLARED_KEYS, *DERIVED_KEYS, "H_ns")
ACTED_KEY = "W_ns"
"""Beside these, of a module with a shield over a flow: what its DM remembers commands for."""
BEYOND, BEYOND_NS = 4, 1_000_000_000
"""A time beyond this multiple of ours, plus all times and so many ns, would only cost work."""


def compare_times(facts: Facts, given: dict[str, Any]) -> None:
    """Declared times are those of the program, derived ones no shorter; the longer ones count.

    Older reads, wider windows, a longer horizon: a claim about more schedules implies ours.
    RejectedError where they are shorter, NotRecheckedError where nobody needs such long ones.
    """
    keys: tuple[str, ...] = TIME_KEYS
    if ACTED_KEY in given and facts.symbol.shield is not None and facts.kind == "flow":
        keys, facts.times[ACTED_KEY] = (*keys, ACTED_KEY), acted_ns(facts)
    only_keys(given, " ".join(keys), "`times`")
    ages = [r.max_age for r in (*facts.setting.by_dm, *facts.setting.by_sc)]
    own_jitter = facts.times["j_ns"]
    together = sum(facts.times[k] for k in keys) + sum(ages)
    for key in keys:
        value, own = given[key], facts.times[key]
        if not isinstance(value, int) or isinstance(value, bool):
            raise RejectedError(f"{key} is no time in the manifest")
        fixed = key in DECLARED_KEYS or (key == "H_ns" and facts.symbol.verify.horizon is not None)
        if value < own or (fixed and value != own):
            raise RejectedError(f"{key} is {value} in the manifest, {own} by the program")
        if value > BEYOND * own + together + BEYOND_NS:
            raise NotRecheckedError(f"{key} is {value} in the manifest, which no program needs")
        facts.times[key] = value
    if 2 * own_jitter <= facts.times["delta_ns"] < 2 * facts.times["j_ns"]:
        raise NotRecheckedError("a j in the manifest of more than half a period, and less is there")

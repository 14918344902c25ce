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
from typing import Any

from soter.certificate.extras import extras
from soter.certificate.reading.derived_times import (
    Clock,
    DerivedTimes,
    TimingSetting,
    TopicReading,
    Ways,
    derive_times,
    has_nodes_between,
)
from soter.certificate.reading.folder import require_keys
from soter.certificate.reading.module_facts import (
    DiffersError,
    Facts,
    const_value,
    driven_topics,
    topics_read,
)
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.language.model.types import show_ns

DELAYS = {
    "J_dm_ns": ("late dm", "late_dm"),
    "J_sc_ns": ("late sc", "late_sc"),
    "R_dm_ns": ("response dm", "response_dm"),
    "R_sc_ns": ("response sc", "response_sc"),
    "L_ns": ("acts within", "acts"),
}
"""Name in the manifest -> how the program says it, and where the `verify` block has it."""
DECLARED_KEYS = ("Delta_ns", "delta_ns", "J_dm_ns", "J_sc_ns", "R_dm_ns", "R_sc_ns", "L_ns")
"""Times that the program declares: a manifest has them unchanged."""
DERIVED_KEYS = ("A_ns", "A_sc_ns", "H_star_ns", "d_ns", "j_ns", "h0_ns")
"""Times that follow: a manifest may claim more schedules than there are, never fewer."""
TIME_KEYS = (*DECLARED_KEYS, *DERIVED_KEYS, "H_ns")
ACTED_KEY = "W_ns"
"""Beside these, of a module with a shield over a flow: what its DM remembers commands for."""
BEYOND, BEYOND_NS = 4, 1_000_000_000
"""A time beyond this multiple of ours, plus all times and so many ns, would only cost work."""


def _check_published_together(facts: Facts, reads: tuple[list[int], list[int]]) -> None:
    driven = driven_topics(facts)
    for together in reads:
        if len({(driven[t][0].period_ns, driven[t][0].phase_ns) for t in together}) > 1:
            raise DiffersError("what is read together is published at different times")


def _check_max_ages(setting: TimingSetting, times: DerivedTimes) -> None:
    for read in setting.by_sc:
        oldest = times.stamps.get(read.name, 0)
        if oldest > read.max_age:
            raise DiffersError(
                f"R011: what SC reads of `{read.name}` may be {show_ns(oldest)} old, "
                f"and `max_age` or `age` says {show_ns(read.max_age)}"
            )


def read_times(facts: Facts) -> None:
    """Enters into `facts` every time in ns, declared or derived, by its name in the manifest.

    Raises DiffersError if declared times contradict the program, NotRecheckedError if a case is not
    understood.
    """
    verify = facts.symbol.verify
    time_by_name = {"Delta_ns": facts.module.period_ns, "delta_ns": facts.sc.period_ns}
    for key, (_, name) in DELAYS.items():
        time_by_name[key] = const_value(facts, getattr(verify, name))
    by_dm, by_sc = topics_read(facts)
    if not verify.abstracts:
        _check_published_together(facts, (by_dm, by_sc))
    running = {facts.running[i] for i in (*by_dm, *by_sc)}
    if verify.abstracts or has_nodes_between(facts.flying, facts.flying_module, running):
        number = partial(const_value, facts)
        facts.ways = extras.node_paths.NodeWays(facts.flying, facts.flying_module, number)
    else:
        facts.ways = Ways(facts.flying, facts.flying_module)
    setting = _timing_setting(facts, by_dm, by_sc, time_by_name)
    if setting.silent or type(facts.ways) is not Ways:  # else one clock shows all that is read
        extras.node_paths.check_ways(facts, setting, (by_dm, by_sc))
    if verify.abstracts:
        extras.views.require_abstracted_sensors(facts, {*by_dm, *by_sc})
    if facts.kind == "map":
        extras.maps.require_instants_of_map(facts, setting)
    derived = derive_times(setting)
    # With nodes R015 holds; and so none of them skips an output (R018): let one step before it sees
    # output k, and next when k + 1 is there. Then k may not act before k + 1 may, by the same step
    # and the same nodes behind it, so that j would be delta or more.
    if 2 * derived.jitter > setting.sc.period:
        _check_late_commands(facts, setting)
    _check_max_ages(setting, derived)
    time_by_name |= {"A_ns": derived.age, "A_sc_ns": derived.age_sc, "d_ns": derived.delay}
    time_by_name |= {"j_ns": derived.jitter, "h0_ns": derived.h_0}
    time_by_name |= {"H_star_ns": derived.h_star, "H_ns": derived.h_star}
    if verify.horizon is not None:
        time_by_name["H_ns"] = int(const_value(facts, verify.horizon))
    in_step = [name for kind, name in facts.ways.notes if kind == "in step"]
    if facts.flying.timed:
        facts.thread = extras.thread_times.thread_time_assumption(
            facts.flying, facts.flying_module, setting, in_step
        )
    facts.times, facts.derived, facts.setting = time_by_name, derived, setting


def _timing_setting(
    facts: Facts, by_dm: list[int], by_sc: list[int], times: dict[str, int]
) -> TimingSetting:
    """Collects the facts that times depend on; the topics are those of the running system."""
    system, module = facts.flying, facts.flying_module
    dm, sc = system.components[module.dm], system.components[module.sc]

    def readings_of(topics: list[int]) -> tuple[TopicReading, ...]:
        found = []
        for index in topics:
            age, running = facts.system.topics[index].max_age_ns, facts.running[index]
            if age is None:
                raise NotRecheckedError("a topic that the module reads has no `max_age`")
            name = system.topics[running].name
            found.append(TopicReading(name, facts.ways.ways_to(running), age))
        return tuple(found)

    # before effects: these say what is vehicle
    found_dm, found_sc = readings_of(by_dm), readings_of(by_sc)
    if facts.symbol.verify.age is not None:
        most = const_value(facts, facts.symbol.verify.age)
        found_sc = tuple(replace(r, max_age=min(r.max_age, most)) for r in found_sc)
    return TimingSetting(
        Clock("the DM", module.period_ns, dm.phase_ns, times["J_dm_ns"], times["R_dm_ns"]),
        Clock("SC", sc.period_ns, sc.phase_ns, times["J_sc_ns"], times["R_sc_ns"]),
        found_dm,
        found_sc,
        facts.ways.find_effects(const_value(facts, facts.symbol.verify.acts_least), times["L_ns"]),
        const_value(facts, facts.symbol.verify.dropout),
        facts.kind == "map",
    )


def _check_late_commands(facts: Facts, setting: TimingSetting) -> None:
    """Raises NotRecheckedError if SC's jitter exceeds half its period and no argument covers that.

    Chains of grids have such an argument (`flow_chains.py`).
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
    for reason, is_there in beside.items():
        if is_there:
            raise NotRecheckedError(f"an SC whose jitter exceeds half its period, with {reason}")


def compare_times(facts: Facts, entry: dict[str, Any]) -> None:
    """Requires declared times as in the program, and derived times no shorter; enters the longer.

    With older reads, wider windows or a longer horizon a claim covers more schedules, and implies
    ours. Raises RejectedError for shorter times, NotRecheckedError for needlessly long ones.
    """
    keys: tuple[str, ...] = TIME_KEYS
    if ACTED_KEY in entry and facts.symbol.shield is not None and facts.kind == "flow":
        keys = *keys, ACTED_KEY
        facts.times[ACTED_KEY] = extras.estimates_and_shield.command_memory_ns(facts)
    require_keys(entry, " ".join(keys), "`times`")
    ages = [r.max_age for r in (*facts.setting.by_dm, *facts.setting.by_sc)]
    own_jitter = facts.times["j_ns"]
    together = sum(facts.times[k] for k in keys) + sum(ages)
    for key in keys:
        value, by_program = entry[key], facts.times[key]
        if not isinstance(value, int) or isinstance(value, bool):
            raise RejectedError(f"{key} is no time in the manifest")
        fixed = key in DECLARED_KEYS or (key == "H_ns" and facts.symbol.verify.horizon is not None)
        if value < by_program or (fixed and value != by_program):
            raise RejectedError(f"{key} is {value} in the manifest, {by_program} by the program")
        if value > BEYOND * by_program + together + BEYOND_NS:
            raise NotRecheckedError(f"{key} is {value} in the manifest, which no program needs")
        facts.times[key] = value
    if 2 * own_jitter <= facts.times["delta_ns"] < 2 * facts.times["j_ns"]:
        raise NotRecheckedError("a j in the manifest of more than half a period, and less is there")

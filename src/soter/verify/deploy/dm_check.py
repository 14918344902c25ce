"""Checks the generated C of decision modules.

Purpose: `check_decisions` compares the C of every DM with the switching logic of the paper:
- its switch, on every mode and every truth value of the facts: exhaustively;
- its latch, where it has one, with every memory that it may have, and presses of every age;
- its facts and its answer, on states of every class of input: NaN, infinities, the ends of the
  range and just beyond, breakpoints of a table, in between; fresh, at `max_age`, stale, never
  published, of different instants; with and without a gate fault and clean outputs owed; in both
  modes.
The expected answers are written here anew from docs/semantics.md. The reference interpreter gives
the truth of predicates; a predicate that faults is unknown, which counts as unsafe.
Non-goals: whether the predicates are right (`verify_module.py`); the kernel, which calls the DM.
"""

from __future__ import annotations

import itertools
import random
import struct
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.codegen.unit import generate
from soter.core.layout import MODULE, placed_leaves, state_dtype
from soter.core.steps import lower
from soter.language.elaborate import derived_systems
from soter.language.elaborate.passes.memory_topics import NEVER_HELD
from soter.language.model.read_together import allowed_stamp_differences
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.typed import AgeRead
from soter.language.model.types import leaves
from soter.native.c_interface import interface, open_library
from soter.native.shared_library import library
from soter.verify.deploy.dm_test_cases import (
    AC,
    NOW_NS,
    SC,
    WRAPPER,
    ExpectedFacts,
    LatchBytes,
    gate_states,
    topic_values,
)
from soter.verify.deploy.level_tables import GroupTable, pairs_of, tables_of_groups
from soter.verify.deploy.missing_predicates import install_predicates
from soter.verify.deploy.shield_tables import command_edges

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from soter.codegen.unit import Unit
    from soter.core.core import CoreSystem
    from soter.core.layout import StateLayout
    from soter.language.model.system import Module, System, Topic
    from soter.verify.claims.results import ModuleResult
    from soter.verify.deploy.dm_test_cases import Points
    from soter.verify.deploy.level_tables import EstimateSamples
    from soter.verify.problem.problem import Problem

    Place = tuple[int, float]
    ActingCommands = tuple[Place, Place, NDArray[np.bool_]]


NEVER = -(2**62)
WHOLE = 24
"""For so many values each age is tried with each state of the gate; for others `SOME` pairs."""
SOME = 5
LATCHES = 2
"""For so many values with each pair (ttf, safer) every state of the latch is tried."""
ASKED_NS = tuple(10**k for k in range(6, 11))
"""The ages that are tried for topics whose age a predicate reads: 1 ms to 10 s."""
FAILURES_MAX = 10


@dataclass(eq=False)
class DMCheck:
    """The result of the check of one DM, with each difference in `failures`.

    `facts`: the number of combinations of facts that were tried (all of them). `states`: the number
    of tried states of the input classes. `cells`: the number of tried table cells (all of them).
    """

    module: str
    facts: int = 0
    states: int = 0
    cells: int = 0
    failures: list[str] = field(default_factory=list)

    @property
    def verdict(self) -> str:
        """The verdict `proved` if nothing differed, else `refuted`."""
        return "refuted" if self.failures else "proved"

    @property
    def summary(self) -> str:
        """A sentence on the number of trials, or on the first difference."""
        if self.failures:
            return f"the C of the DM differs from the switching logic: {self.failures[0]}"
        return (
            f"the compiled DM switches as it should: all {self.facts} combinations of facts"
            + (f" and all {self.cells:,} cells" if self.cells else "")
            + f"; {self.states:,} inputs tried"
        )

    def add_failure(self, text: str) -> None:
        """Adds the text of a difference, unless `FAILURES_MAX` texts are known already."""
        if len(self.failures) < FAILURES_MAX:
            self.failures.append(text)


def expected_mode(
    mode: int, *, stale: bool, ttf: bool, safer: bool, gate_fault: bool, clean: bool
) -> int:
    """The mode after a DM step, as docs/semantics.md defines it; in doubt SC has control."""
    if mode == AC:
        return SC if ttf or stale or gate_fault else AC
    return AC if safer and not stale and clean else SC


def check_decisions(
    system: System,
    core: CoreSystem | None = None,
    level_tables: Sequence[GroupTable] = (),
    leaves_of: Mapping[int, tuple[int, int]] | None = None,
    change: Callable[[str], str] | None = None,
    acted_ns: int | None = 0,
) -> list[DMCheck]:
    """Checks the C of every decision module of a system.

    `level_tables`: the tables of computed predicates (of one module); every cell of them is tried.
    `leaves_of`: the (topic, leaf) that shows each state. `change` edits the C first (for tests).
    `acted_ns`: W, for how long a replaced command of a shield still counts; None means not at all.
    """
    at = leaves_of or {}
    points = {at[s]: e for t in level_tables for s, e in zip(t.states, t.ends, strict=True)}
    c = CompiledDM(generate(system, core), change or str)
    checks = []
    for module in system.modules:
        check = DMCheck(module.name)
        _try_all_facts(c, check)
        inputs = _Inputs(c, system, module, check)
        inputs.try_values(points)
        for table in level_tables:
            others = [t for t in level_tables if t is not table]
            inputs.try_level_table(table, others, at, acted_ns)
        checks.append(check)
    return checks


def check_module(result: ModuleResult) -> DMCheck:
    """Checks the DM of a verified module, with its computed predicates if it has any."""
    problem = result.problem
    sets = [pairs_of(case) for case in result.cases]
    if problem.computed and all(len(pairs) == len(problem.groups) for pairs in sets):
        return check_problem(problem, tables_of_groups(problem, sets))
    return check_problem(problem, [])


def check_problem(problem: Problem, level_tables: Sequence[GroupTable]) -> DMCheck:
    """Checks the DM of a module, whose computed predicates, if any, have these tables."""
    system = derived_systems.without_bindings(problem.whole or problem.system)
    module = system.modules[problem.module.index]
    if level_tables:
        install_predicates(system, module, problem, list(level_tables))
    core = lower(system)
    for function in core.functions:
        function.source = None  # predicates call no extern functions (R003)
    leaves_of = problem.topic_leaf_of_state
    acted_ns = None if problem.kind == "map" else problem.times.replaced_window
    return check_decisions(system, core, level_tables, leaves_of, acted_ns=acted_ns)[0]


class CompiledDM:
    """The compiled C of a system, with functions that call parts of a DM.

    `change` edits the C first (for tests).
    """

    def __init__(self, unit: Unit, change: Callable[[str], str] = str) -> None:
        text = change(unit.source) + WRAPPER.format(prefix=unit.prefix)
        self.unit = unit = replace(unit, source=text)
        self.ffi = interface(
            "unsigned soter_check_decide(unsigned module, void *state);"
            "unsigned soter_check_switch(unsigned mode, unsigned facts);"
            "void soter_check_cells(unsigned module, unsigned char *state, const size_t *facts,"
            " size_t axes, const size_t *at, const double *points, size_t count,"
            " unsigned char *found);"
        )
        self.lib: Any = open_library(self.ffi, library(unit))

    def mode_after_switch(self, mode: int, facts: Sequence[bool]) -> int:
        """The mode after the switch; facts in the order stale, ttf, safer, gate fault, clean."""
        bits = sum(1 << i for i, fact in enumerate(facts) if fact)
        return int(self.lib.soter_check_switch(mode, bits))

    def levels_of_points(
        self,
        module: int,
        state: bytearray,
        facts: tuple[int, int],
        at: NDArray[np.uintp],
        points: NDArray[np.float64],
    ) -> NDArray[np.uint8]:
        """Levels (0: ttf, 2: safer, 1: neither) of points (n, axes), put at the offsets `at`."""
        levels = np.zeros(len(points), dtype=np.uint8)
        self.lib.soter_check_cells(
            module,
            self.ffi.from_buffer(state),
            self.ffi.new("size_t[2]", facts),
            len(at),
            self.ffi.cast("size_t *", at.ctypes.data),
            self.ffi.cast("double *", points.ctypes.data),
            len(points),
            self.ffi.cast("unsigned char *", levels.ctypes.data),
        )
        return levels

    def offsets_by_name(self, module: Module) -> dict[str, int]:
        """The byte offset, within a state, of each number that a module keeps, by name."""
        layout = self.unit.layout
        fields = state_dtype(layout)["modules"].base.fields
        assert fields is not None
        begin = layout.module_offset + module.index * MODULE.size
        return {name: begin + int(where[1]) for name, where in fields.items()}

    def decide_when_fresh(self, module: Module, state: bytearray) -> int:
        """The DM's answer when AC has control and every topic has just been published."""
        struct.pack_into("<q", state, 0, NOW_NS)
        for i in range(self.unit.layout.topics):
            struct.pack_into("<q", state, self.unit.layout.stamp_offset + 8 * i, NOW_NS)
        at = self.offsets_by_name(module)
        struct.pack_into("<I", state, at["clean_needed"], 0)
        state[at["mode"]], state[at["gate_fault"]] = AC, 0
        return self.decide(module.index, state)

    def decide(self, module: int, state: bytearray) -> int:
        """The DM's answer in a state; the DM writes the facts into `state`."""
        return int(self.lib.soter_check_decide(module, self.ffi.from_buffer(state)))


def _try_all_facts(c: CompiledDM, check: DMCheck) -> None:
    """Tries all 64 combinations of two modes and five facts on the C of the switch."""
    names = ("stale", "ttf", "safer", "gate_fault", "clean")
    for mode in (SC, AC):
        for facts in itertools.product((False, True), repeat=5):
            fact_by_name = dict(zip(names, facts, strict=True))
            wanted, got = expected_mode(mode, **fact_by_name), c.mode_after_switch(mode, facts)
            check.facts += 1
            if wanted != got:
                true = ", ".join(n for n, fact in fact_by_name.items() if fact) or "no fact"
                check.add_failure(
                    f"in {_mode_name(mode)} with {true}: "
                    f"{_mode_name(got)}, not {_mode_name(wanted)}"
                )


def _mode_name(mode: int) -> str:
    return "AC" if mode == AC else "SC"


class _Inputs:
    """Tries a DM on all classes of states: topic values, ages of topics, and gate states."""

    def __init__(self, c: CompiledDM, system: System, module: Module, check: DMCheck) -> None:
        self.c, self.system, self.module, self.check = c, system, module, check
        self.chance = random.Random(1)  # noqa: S311 - test points
        layout = c.unit.layout
        self.at = c.offsets_by_name(module)
        self.stamps = layout.stamp_offset
        self.limits = [
            (i, a) for i in module.inputs if (a := system.topics[i].max_age_ns) is not None
        ]
        self.together = allowed_stamp_differences(system, module.inputs)
        self.latch = LatchBytes.of_module(system, layout, module)
        self.tried = Counter[tuple[bool, bool]]()  # (ttf, safer) with which all latches were
        symbol, scope = module.symbol, module.scope.topics
        asked = [n.topic for n in nodes([symbol.ttf, symbol.safer]) if isinstance(n, AgeRead)]
        self.asked = sorted({scope[topic] for topic in asked})

    def try_values(self, points: Points) -> None:
        """Tries the DM on values of the topics that its predicates read, at all ages and gates."""
        system, symbol = self.system, self.module.symbol
        predicates = [e for e in (symbol.ttf, symbol.safer) if e is not None]
        scope = {**system.components[self.module.sc].scope.topics, **self.module.scope.topics}
        read = [scope[t] for t in topic_reads(*predicates)]
        expected = ExpectedFacts(system, self.module)
        every = list(itertools.product(self._ages_to_try(), gate_states(self.module)))
        for k, chosen_values in enumerate(topic_values(system, read, points, self.chance)):
            topics = [t.default for t in system.topics]
            for index, value in zip(read, chosen_values, strict=True):
                topics[index] = value
            state = expected.state_bytes(self.c.unit, tuple(topics))
            chosen = every if k < WHOLE else self.chance.sample(every, min(SOME, len(every)))
            fresh = truths = expected.expected_ttf_and_safer(tuple(topics), {})
            for ages, gate in chosen:
                if expected.reads_ages:
                    truths = expected.expected_ttf_and_safer(tuple(topics), ages)
                self._try_state(state, ages, gate, ttf=truths[0], safer=truths[1])
            if k < WHOLE or fresh[1]:
                self._try_latch(state, ttf=fresh[0], safer=fresh[1])

    def _fresh_state(
        self,
        table: GroupTable,
        others: Sequence[GroupTable],
        leaves_of: Mapping[int, tuple[int, int]],
    ) -> tuple[bytearray, NDArray[np.uintp]] | None:
        """A fresh state, with `others` in S_(m-2), and the offsets of `table`'s states; or None."""
        layout, topics = self.c.unit.layout, self.system.topics
        state = ExpectedFacts(self.system, self.module).state_bytes(
            self.c.unit, tuple(t.default for t in topics)
        )
        struct.pack_into("<q", state, 0, NOW_NS)
        for i in range(len(topics)):
            struct.pack_into("<q", state, self.stamps + 8 * i, NOW_NS)

        def offset(of: int) -> int:
            topic, leaf = leaves_of[of]
            return _offset_of_leaf(layout, topics[topic], leaf)

        for other in others:
            full = other.point_inside
            if full is None:
                return None  # then safer is false everywhere, and no cell can be told from another
            for s, value in zip(other.states, full, strict=True):
                struct.pack_into("<d", state, offset(s), value)
        return state, np.array([offset(s) for s in table.states], dtype=np.uintp)

    def try_level_table(
        self,
        table: GroupTable,
        others: Sequence[GroupTable],
        leaves_of: Mapping[int, tuple[int, int]],
        acted_ns: int | None,
    ) -> None:
        """Tries the samples of a table, while the other groups stay inside S_(m-2)."""
        samples, fresh = table.samples, self._fresh_state(table, others, leaves_of)
        if samples is None or fresh is None:
            return
        state, at = fresh
        judged = list(self._acting_commands(table, acted_ns))
        if not judged:
            self._try_samples(state, at, samples)
        else:
            for held, acting, permitted in judged:
                for place, value in (held, acting):
                    struct.pack_into("<d", state, place, value)
                levels = np.where(permitted, np.maximum(samples.levels, 1), 0).astype(np.uint8)
                self._try_samples(state, at, replace(samples, levels=levels))
                struct.pack_into("<d", state, acting[0], NEVER_HELD)

    def _try_samples(
        self, state: bytearray, at: NDArray[np.uintp], samples: EstimateSamples
    ) -> None:
        """Compares the levels of samples with those from the C; `state` has the other topics."""
        points, levels = samples.points, samples.levels
        facts = (self.at["ttf"], self.at["safer"])
        got = self.c.levels_of_points(self.module.index, state, facts, at, points)
        self.check.cells += len(points)
        for k in np.flatnonzero(got != levels)[:1]:
            where = points[k].tolist()
            self.check.add_failure(f"at {where} its level is {got[k]}, not {levels[k]}")

    def _acting_commands(self, table: GroupTable, acted_ns: int | None) -> Iterator[ActingCommands]:
        """Each pair of a cell of the held command and a cell of a command that may still act.

        A pair has offset and value of both, and the samples at which both are permitted. With
        `acted_ns` None only the held command acts.
        """
        shield = self.module.shield
        if shield is None or table.commands is None:
            return
        if table.commands.control is None:
            return
        layout, topics, n = self.c.unit.layout, self.system.topics, shield.cells
        numbers = [
            (i, leaf, bound)
            for i in self.module.outputs
            for leaf, bound in enumerate(topics[i].bounds)
        ]
        topic, leaf, bound = numbers[table.commands.control]
        assert bound is not None
        edges = command_edges(bound.low, bound.high, n)
        place = _offset_of_leaf(layout, topics[topic], leaf)
        times = layout.topic_offset(shield.topic) + 8 * table.commands.control * n
        tops = table.commands.tops.reshape(-1, n)[table.has_double_inside]
        for held in range(n):
            ends = (np.nextafter(edges[held], np.inf), np.nextafter(edges[held + 1], -np.inf))
            for acting in range(n):
                value = float(ends[acting % 2])
                other = held if acted_ns is None else acting
                low, high = min(held, other), max(held, other)
                when = (times + 8 * acting, (NOW_NS - (acted_ns or 0)) / 1e9)
                yield (place, value), when, tops[:, low] > high

    def _ages_to_try(self) -> Iterator[dict[int, int]]:
        """Yields ages by topic: fresh, at a limit, beyond it, never published, `ASKED_NS`."""
        yield {}
        for index, limit in self.limits:
            for age in (limit, limit + 1, NOW_NS - NEVER):
                yield {index: age}
        if self.limits:
            yield {i: self.chance.randrange(2 * a + 2) for i, a in self.limits}
            yield dict.fromkeys((i for i, _ in self.limits), min(a for _, a in self.limits))
        for i, j, most in self.together:
            yield from ({i: most}, {j: most + 1})
        for index in self.asked:
            for age in ASKED_NS:
                yield {index: age}

    def _try_state(
        self,
        state: bytearray,
        ages: dict[int, int],
        gate: tuple[int, int, int],
        *,
        ttf: bool,
        safer: bool,
    ) -> None:
        mode, gate_fault, clean = gate
        struct.pack_into("<q", state, 0, NOW_NS)
        for i in range(len(self.system.topics)):
            struct.pack_into("<q", state, self.stamps + 8 * i, NOW_NS - ages.get(i, 0))
        struct.pack_into("<I", state, self.at["clean_needed"], clean)
        state[self.at["mode"]], state[self.at["gate_fault"]] = mode, gate_fault
        stale = any(ages.get(i, 0) > limit for i, limit in self.limits)
        stale |= any(abs(ages.get(i, 0) - ages.get(j, 0)) > k for i, j, k in self.together)
        if self.latch is not None:
            self.latch.release(state)
        got = self.c.decide(self.module.index, state)
        facts = {"stale": stale, "ttf": ttf, "safer": safer}
        wanted = expected_mode(mode, **facts, gate_fault=gate_fault != 0, clean=clean == 0)
        self.check.states += 1
        wrong = [n for n, fact in facts.items() if state[self.at[n]] != fact]
        for name in wrong[:1]:
            self.check.add_failure(f"in {_mode_name(mode)} it finds `{name}` {not facts[name]}")
        if got != wanted:
            self.check.add_failure(
                f"in {_mode_name(mode)} on {facts}: {_mode_name(got)}, not {_mode_name(wanted)}"
            )

    def _try_latch(self, state: bytearray, *, ttf: bool, safer: bool) -> None:
        """Tries the latch in every state; all topics are fresh and AC owes no clean outputs."""
        if self.latch is None or self.tried[ttf, safer] >= LATCHES:
            return
        self.tried[ttf, safer] += 1
        struct.pack_into("<q", state, 0, NOW_NS)
        for i in range(len(self.system.topics)):
            struct.pack_into("<q", state, self.stamps + 8 * i, NOW_NS)
        struct.pack_into("<I", state, self.at["clean_needed"], 0)
        state[self.at["gate_fault"]] = 0
        for mode, seen in itertools.product((SC, AC), self.latch.all_looks(NOW_NS)):
            state[self.at["mode"]] = mode
            self.latch.write_look(state, seen)
            held, lets = (
                self.latch.memory_after_look(seen, NOW_NS) if mode == SC else (seen.held, True)
            )
            wanted = expected_mode(
                mode, stale=False, ttf=ttf, safer=safer, gate_fault=False, clean=lets
            )
            after = self.latch.memory_after_switch(wanted, NOW_NS) if wanted != mode else held
            self.check.states += 1
            if (got := self.c.decide(self.module.index, state)) != wanted:
                self.check.add_failure(
                    f"in {_mode_name(mode)} on {seen}: {_mode_name(got)}, not {_mode_name(wanted)}"
                )
            elif (kept := self.latch.read_memory(state)) != after:
                self.check.add_failure(
                    f"in {_mode_name(mode)} on {seen}: it keeps {kept}, not {after}"
                )


def _offset_of_leaf(layout: StateLayout, topic: Topic, leaf: int) -> int:
    """The byte offset, within a state, of a topic's leaf that is not inside a list."""
    path = list(leaves(topic.type))[leaf][0]
    every = placed_leaves(topic.type, layout.topic_offset(topic.index))
    return next(at for p, _, at in every if p == path)

"""The check that comes with a generated decision module.

Purpose: the emitted C of every DM against the switching logic of the paper's Figure:
- its switch, on every mode and every truth value of the facts: exhaustively;
- its facts and its answer, on states of every class of input: NaN, infinities, the ends of the
  range and just beyond, breakpoints of a table, in between; fresh, at `max_age`, stale, never
  published; with and without a gate fault and clean outputs owed; in both modes.
The expected answers are written down here anew, from docs/semantics.md; the truth of predicates is
the reference interpreter's, and one that faults is unknown, which counts as unsafe.
Non-goals: whether the predicates are right (`verify.py`); the kernel, which calls the DM.
"""

from __future__ import annotations

import itertools
import random
import struct
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.codegen.unit import generate
from soter.lower.layout import encode_into, state_dtype
from soter.lower.steps import lower
from soter.native.build import library
from soter.program.arith import StepFault
from soter.program.environment import Environment
from soter.program.evaluate import Evaluator
from soter.program.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    leaves,
)
from soter.program.walk import topic_reads
from soter.reach.complete import put
from soter.reach.tables import tables

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from soter.codegen.unit import Unit
    from soter.lower.core import CoreSystem
    from soter.lower.layout import StateLayout
    from soter.program.system import Bound, Module, System
    from soter.program.types import Type, Value
    from soter.reach.results import ModuleResult

    Points = Mapping[tuple[int, int], Sequence[float]]

SC, AC = 0, 1
NEVER = -(2**62)
NOW_NS = 10**15
RANDOM_POINTS = 400
WHOLE = 24
"""For so many values every age is tried with every state of the gate; for the others some."""
SOME = 5
FAILURES_MAX = 10
SPECIAL = (float("nan"), float("inf"), float("-inf"), 1e308, -1e308, 0.0, -0.0, 5e-324)
WRAPPER = """
unsigned soter_check_decide(unsigned module, void *state);
unsigned soter_check_switch(unsigned mode, unsigned facts);
unsigned soter_check_decide(unsigned module, void *state) {{
  return (unsigned){prefix}_program.module[module].decide(state);
}}
unsigned soter_check_switch(unsigned mode, unsigned facts) {{
  return (unsigned){prefix}_switch((soter_mode)mode, (facts & 1U) != 0U, (facts & 2U) != 0U,
      (facts & 4U) != 0U, (facts & 8U) != 0U, (facts & 16U) != 0U);
}}
"""


@dataclass(eq=False)
class DMCheck:
    """What was tried, and where the C differed; `verdict` is proved or refuted.

    `facts`: combinations of facts, all there are; `states`: states of the classes of input.
    """

    module: str
    facts: int = 0
    states: int = 0
    failures: list[str] = field(default_factory=list)

    @property
    def verdict(self) -> str:
        """`proved` where nothing differed."""
        return "refuted" if self.failures else "proved"

    @property
    def text(self) -> str:
        """One sentence."""
        if self.failures:
            return f"the C of the DM differs from the switching logic: {self.failures[0]}"
        return (
            f"the compiled DM switches as it should: all {self.facts} combinations of facts, "
            f"{self.states:,} inputs"
        )

    def differs(self, what: str) -> None:
        """Enter a difference."""
        if len(self.failures) < FAILURES_MAX:
            self.failures.append(what)


def decided(
    mode: int, *, stale: bool, ttf: bool, safer: bool, gate_fault: bool, clean: bool
) -> int:
    """The mode after a DM step (docs/semantics.md): AC is left for any doubt."""
    if mode == AC:
        return SC if ttf or stale or gate_fault else AC
    return AC if safer and not stale and clean else SC


def check_decisions(
    system: System,
    core: CoreSystem | None = None,
    points: Points | None = None,
    change: Callable[[str], str] | None = None,
) -> list[DMCheck]:
    """Check the C of every decision module of a system.

    `points`: (topic, leaf) -> values worth trying besides, such as breakpoints of tables; `change`
    edits the C first (for tests).
    """
    unit = generate(system, core)
    source = unit.source if change is None else change(unit.source)
    text = source + WRAPPER.format(prefix=unit.prefix)
    c = _Compiled(replace(unit, source=text))
    found = []
    for module in system.modules:
        check = DMCheck(module.name)
        _all_facts(c, check)
        _Inputs(c, system, module, check).run(points or {})
        found.append(check)
    return found


def check_module(result: ModuleResult) -> DMCheck:
    """The DM of a verified module; with the predicates that were computed, where they were."""
    problem = result.problem
    module = replace(problem.module)
    components = tuple(replace(x, binding=None) for x in problem.system.components)
    system = replace(problem.system, components=components, modules=(module,))
    points: dict[tuple[int, int], tuple[float, ...]] = {}
    whole = all(len(case.groups) == len(problem.groups) for case in result.cases)
    if problem.computed and whole and all(g.levels for c in result.cases for g in c.groups):
        sets = [[(g.levels[0], g.levels[-1]) for g in case.groups] for case in result.cases]
        found = tables(problem, sets)
        put(system, module, problem, found)
        for table in found:
            for state, edges in zip(table.states, table.edges, strict=True):
                points[problem.topic_leaf_of_state[state]] = edges
    core = lower(system)
    for function in core.functions:
        function.source = None  # predicates call no extern functions (R003)
    return check_decisions(system, core, points)[0]


class _Compiled:
    """The compiled unit with its wrapper."""

    def __init__(self, unit: Unit) -> None:
        from cffi import FFI  # noqa: PLC0415 - as in `native/`

        self.unit = unit
        self.ffi: Any = FFI()
        self.ffi.cdef(
            "unsigned soter_check_decide(unsigned module, void *state);"
            "unsigned soter_check_switch(unsigned mode, unsigned facts);"
        )
        self.lib: Any = self.ffi.dlopen(str(library(unit)))

    def switch(self, mode: int, facts: Sequence[bool]) -> int:
        """Facts in the order stale, ttf, safer, gate fault, clean."""
        bits = sum(1 << i for i, fact in enumerate(facts) if fact)
        return int(self.lib.soter_check_switch(mode, bits))

    def decide(self, module: int, state: bytearray) -> int:
        """The DM's answer; it notes the facts in `state`."""
        return int(self.lib.soter_check_decide(module, self.ffi.from_buffer(state)))


def _all_facts(c: _Compiled, check: DMCheck) -> None:
    """Two modes and five facts: 64 combinations, all there are."""
    names = ("stale", "ttf", "safer", "gate_fault", "clean")
    for mode in (SC, AC):
        for facts in itertools.product((False, True), repeat=5):
            said = dict(zip(names, facts, strict=True))
            wanted, got = decided(mode, **said), c.switch(mode, facts)
            check.facts += 1
            if wanted != got:
                true = ", ".join(n for n, fact in said.items() if fact) or "no fact"
                check.differs(f"in {_name(mode)} with {true}: {_name(got)}, not {_name(wanted)}")


def _name(mode: int) -> str:
    return "AC" if mode == AC else "SC"


# ---------------------------------------------------------------- states


class _Inputs:
    """States of every class: values of topics, times their ages, times what the gate says."""

    def __init__(self, c: _Compiled, system: System, module: Module, check: DMCheck) -> None:
        self.c, self.system, self.module, self.check = c, system, module, check
        self.chance = random.Random(1)  # noqa: S311 - test points
        layout = c.unit.layout
        fields = state_dtype(system, layout)["modules"].base.fields
        assert fields is not None
        own = layout.module_offset + module.index * fields_size(system, layout)
        self.at = {name: own + int(where[1]) for name, where in fields.items()}
        self.stamps = layout.stamp_offset
        self.limits = [
            (i, a) for i in module.inputs if (a := system.topics[i].max_age_ns) is not None
        ]

    def run(self, points: Points) -> None:
        """Try them all."""
        system, symbol = self.system, self.module.symbol
        predicates = [e for e in (symbol.ttf, symbol.safer) if e is not None]
        scope = {**system.components[self.module.sc].scope.topics, **self.module.scope.topics}
        read = [scope[t] for t in topic_reads(*predicates)]
        expected = _Expected(system, self.module)
        ages, gates = list(self._ages()), list(_gates(self.module))
        every = list(itertools.product(ages, gates))
        for k, values in enumerate(_values(system, read, points, self.chance)):
            topics = [t.default for t in system.topics]
            for index, value in zip(read, values, strict=True):
                topics[index] = value
            ttf, safer = expected.truths(tuple(topics))
            state = expected.state(self.c.unit, tuple(topics))
            chosen = every if k < WHOLE else self.chance.sample(every, min(SOME, len(every)))
            for stamps, gate in chosen:
                self._one(state, stamps, gate, ttf=ttf, safer=safer)

    def _ages(self) -> Iterator[dict[int, int]]:
        """Ages: all fresh; then each input at its limit, beyond it, never published."""
        yield {}
        for index, limit in self.limits:
            for age in (limit, limit + 1, NOW_NS - NEVER):
                yield {index: age}
        if self.limits:
            yield {i: self.chance.randrange(2 * a + 2) for i, a in self.limits}

    def _one(
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
        got = self.c.decide(self.module.index, state)
        facts = {"stale": stale, "ttf": ttf, "safer": safer}
        wanted = decided(mode, **facts, gate_fault=gate_fault != 0, clean=clean == 0)
        self.check.states += 1
        wrong = [n for n, fact in facts.items() if state[self.at[n]] != fact]
        for name in wrong[:1]:
            self.check.differs(f"in {_name(mode)} it finds `{name}` {not facts[name]}")
        if got != wanted:
            self.check.differs(f"in {_name(mode)} on {facts}: {_name(got)}, not {_name(wanted)}")


def fields_size(system: System, layout: StateLayout) -> int:
    """Bytes of one module's record in a state."""
    return int(state_dtype(system, layout)["modules"].base.itemsize)


class _Expected:
    """What the reference interpreter says about a module's predicates."""

    def __init__(self, system: System, module: Module) -> None:
        self.system = system
        evaluator = Evaluator.of(module.scope, {})
        symbol = module.symbol
        self._ttf = None if symbol.ttf is None else evaluator.expression(symbol.ttf)
        self._safer = None if symbol.safer is None else evaluator.expression(symbol.safer)
        self.period_ns = module.period_ns

    def truths(self, topics: tuple[Value, ...]) -> tuple[bool, bool]:
        """(ttf, safer); unknown is unsafe."""
        env = Environment(
            topics=topics,
            stamps=tuple(NOW_NS for _ in topics),
            time_ns=NOW_NS,
            period_ns=self.period_ns,
            in_control=True,
            mode=lambda _: SC,
            truth=lambda _: (),
        )
        found = []
        for predicate, unknown in ((self._ttf, True), (self._safer, False)):
            try:
                found.append(unknown if predicate is None else bool(predicate(env)))
            except StepFault:
                found.append(unknown)
        return found[0], found[1]

    def state(self, unit: Unit, topics: tuple[Value, ...]) -> bytearray:
        """A state that holds these values."""
        out = bytearray(unit.layout.size)
        for group in unit.layout.groups:
            if group.owner < 0:
                for member in group.struct.members:
                    at = group.offset + member.offset
                    encode_into(out, at, member.type, topics[member.index])
        return out


# ---------------------------------------------------------------- classes of input


def _gates(module: Module) -> Iterator[tuple[int, int, int]]:
    """(mode, gate fault, clean outputs owed)."""
    owed = (0, 1, module.clean, 2**31, 2**32 - 1)
    for mode in (SC, AC):
        for gate_fault in (0, 1):
            for clean in dict.fromkeys(owed):
                yield mode, gate_fault, clean


def _values(
    system: System,
    read: Sequence[int],
    points: Points,
    chance: random.Random,
) -> Iterator[tuple[Value, ...]]:
    """Values of the topics that are read: each leaf in each class, and points drawn at random."""
    flat = []
    for index in read:
        topic = system.topics[index]
        kinds = [kind for _, kind in leaves(topic.type)]
        for k, (kind, bound) in enumerate(zip(kinds, topic.bounds, strict=True)):
            flat.append(_Leaf(kind, bound, points.get((index, k), ())))

    def built(chosen: list[Value]) -> tuple[Value, ...]:
        it = iter(chosen)
        return tuple(_build(system.topics[i].type, it) for i in read)

    for at, leaf in enumerate(flat):
        for value in leaf.classes():
            drawn = [x.draw(chance) for x in flat]
            drawn[at] = value
            yield built(drawn)
    for _ in range(RANDOM_POINTS if flat else 1):
        yield built([x.draw(chance) for x in flat])


@dataclass(frozen=True)
class _Leaf:
    """One scalar of a topic: which values are tried."""

    type: Type
    bound: Bound | None
    points: Sequence[float] = ()

    def classes(self) -> Iterator[Value]:
        """Every class once."""
        if isinstance(self.type, FloatType):
            yield from SPECIAL
            ends = () if self.bound is None else (self.bound.low, self.bound.high)
            for end in (*ends, *self.points):
                yield float(end)
                yield float(np.nextafter(end, np.inf))
                yield float(np.nextafter(end, -np.inf))
        elif isinstance(self.type, BoolType):
            yield from (False, True)
        elif isinstance(self.type, EnumType):
            yield from range(len(self.type.members))
        else:
            yield from self._ints()

    def _ints(self) -> tuple[int, int]:
        assert isinstance(self.type, IntType)
        return self.type.low, self.type.high

    def draw(self, chance: random.Random) -> Value:
        """Some value: of the range where there is one."""
        if isinstance(self.type, FloatType):
            if self.points:
                low, high = min(self.points), max(self.points)
                return chance.uniform(low - 0.1 * (high - low), high + 0.1 * (high - low))
            if self.bound is not None:
                return chance.uniform(self.bound.low, self.bound.high)
            return chance.choice((-1, 1)) * 10.0 ** chance.uniform(-3, 3)
        if isinstance(self.type, BoolType):
            return chance.random() < 0.5
        if isinstance(self.type, EnumType):
            return chance.randrange(len(self.type.members))
        return chance.randint(*self._ints())


def _build(t: Type, values: Iterator[Value]) -> Value:
    """A value from its leaves in order."""
    if isinstance(t, RecordType):
        return tuple(_build(f, values) for _, f in t.fields)
    if isinstance(t, ArrayType):
        return tuple(_build(t.element, values) for _ in range(t.size))
    if isinstance(t, ListType):
        return (_build(t.element, values),) * t.capacity
    return next(values)

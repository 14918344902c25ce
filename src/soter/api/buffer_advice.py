"""How far from the fence a decision module gives control to SC, by speed (`soter advise --buffer`).

Purpose: `buffers` puts a number of an estimate, the position, nearer and nearer to where `safe`
ends, and asks the compiled DM at each speed where it takes control from AC; from there SC is flown
in the model.
Non-goals: proofs; the worst run: in that flight nothing disturbs and nothing is measured wrongly;
other advice (`Program.advise`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.api.arguments import chosen_modules
from soter.api.computed_ttf import compute_ttf
from soter.codegen.unit import generate
from soter.diagnostics.current_phase import whole_shares_to
from soter.diagnostics.diagnostic import mistake
from soter.diagnostics.similar_names import did_you_mean
from soter.language.elaborate import derived_systems
from soter.language.elaborate.derived_systems import faultless, without_held_topics
from soter.language.model import typed
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.types import leaf_name, leaves, positions
from soter.simulate.explain_decision import value_with_number
from soter.simulate.run import NativeProgram
from soter.verify.deploy.dm_check import CompiledDM
from soter.verify.deploy.dm_test_cases import AC, ExpectedFacts
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import FARTHEST
from soter.verify.tubes.expression_graph import middle

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from soter.api.arguments import Progress
    from soter.api.program import Program
    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Value
    from soter.verify.problem.problem import Problem

STEPS, HALVINGS = 256, 24
"""Into how many steps the way to the fence is cut, and how often the last one is halved."""
FARTHEST_2 = 20
"""Where a position has no declared end the fence is looked for up to 2 to this power away."""
SPEEDS = 8
NAME_THEM = "name two numbers of the estimate: `--buffer POSITION,SPEED`, as `motion.x,motion.v`"
UNTIL_NS = 60 * 10**9
"""For how long SC is flown."""


@dataclass(frozen=True)
class BufferRow:
    """The place where SC takes over at a speed, its `room` to the fence, and how much SC `used`."""

    speed: float
    taken_at: float
    room: float
    used: float


@dataclass(frozen=True)
class Buffers:
    """A module's rows, for speeds up to `fastest`, above which AC has no control at the start.

    `position`, `speed`: the numbers varied, as `topic.field`; `fence`: where `safe` ends.
    """

    module: str
    position: str
    speed: str
    units: tuple[str, str]
    fence: float
    fastest: float
    rows: tuple[BufferRow, ...]


def buffers(
    program: Program,
    named: tuple[str, str] | None = None,
    *,
    module: str | None = None,
    system: str | None = None,
    params: Mapping[str, object] | None = None,
    progress: Progress | None = None,
) -> tuple[Buffers, ...]:
    """For each module and speed, how far from the fence SC takes over.

    `system` is by default the program's choice; `named`: position and speed as `topic.field`, found
    automatically if None. Raises SoterError R... for a module that poses no problem, U001 for an
    unknown module, or if no position, speed or end of `safe` is found.
    """
    with whole_shares_to(progress):
        flying = program.declared(system, params)
        proved = faultless(without_held_topics(flying))
        problems = {m.name: extract(proved, m) for m in proved.modules if m.forced is None}
        compute_ttf(flying)
        chosen = [m for m in chosen_modules(flying, module) if m.name in problems]
        return tuple(_buffers_of_module(flying, m, problems[m.name], named) for m in chosen)


def _buffers_of_module(
    flat: System, module: Module, problem: Problem, named: tuple[str, str] | None
) -> Buffers:
    """Finds the buffers of a module by asking its DM; the system's predicates must be known.

    `named`: position and speed as `topic.field`, found automatically if None. Raises SoterError
    U001 if a name shows no state, if nothing is found, or if `safe` has no end in that direction.
    """
    names = {
        leaf_name(problem.system.topics[t].name, _leaf_path(problem, t, k)): s
        for s, (t, k) in problem.topic_leaf_of_state.items()
    }
    pairs = [*_position_speed_pairs(problem, names)] if named is None else [named]
    for name in pairs[0] if named else ():
        if name not in names:
            raise mistake("U001", f"`{name}` shows no state", *did_you_mean(name, names), NAME_THEM)
    for position, speed in pairs:
        asked = _Probe(flat, module, problem, names[position], names[speed])
        fence = asked.find_fence()
        if fence is not None:
            units = [problem.quantities.states[names[n]].unit for n in (position, speed)]
            fastest = asked.fastest_in_ac()
            rows = tuple(asked.buffer_rows(fence, fastest))
            pair = units[0], units[1]
            return Buffers(module.name, position, speed, pair, fence, fastest, rows)
    problem_text = (
        "`safe` has no end in the direction of the speed" if named else "no position was found"
    )
    raise mistake("U001", f"{module.name}: {problem_text}", NAME_THEM)


def _leaf_path(problem: Problem, topic: int, leaf: int) -> tuple[str, ...]:
    return tuple(list(leaves(problem.system.topics[topic].type))[leaf][0])


def _position_speed_pairs(problem: Problem, names: Mapping[str, int]) -> Iterator[tuple[str, str]]:
    """Yields each number that `safe` reads with a number that its derivative depends on."""
    read = {problem.module.scope.topics[t] for t in topic_reads(problem.module.symbol.safe)}
    of_state = {s: n for n, s in names.items()}
    states = problem.quantities.states
    for name, s in names.items():
        plant = problem.system.components[states[s].owner].plant
        if problem.topic_leaf_of_state[s][0] not in read or plant is None:
            continue
        rate = next((e for v, e in plant.der.items() if v.name == states[s].member), None)
        moved_by = {n.variable.name for n in nodes([rate]) if isinstance(n, typed.VarRead)}
        for other, shown in of_state.items():
            if other != s and states[other].member in moved_by:
                yield name, shown


class _Probe:
    """Asks a DM and a model about estimates that differ from the start in position and speed."""

    def __init__(
        self, flat: System, module: Module, problem: Problem, position: int, speed: int
    ) -> None:
        self.flat, self.module, self.problem = flat, module, problem
        self.position, self.speed = position, speed
        self.unit = generate(flat)
        self.dm = CompiledDM(self.unit)
        self.facts = ExpectedFacts(flat, module)
        by_name = {t.name: t.index for t in flat.topics}
        topics = problem.system.topics
        self.at = {
            s: (by_name[topics[t].name], positions(topics[t].type, _leaf_path(problem, t, k)))
            for s, (t, k) in problem.topic_leaf_of_state.items()
        }
        self.fastest: float | None = None
        self.way = 1.0
        self.initial = {s: middle(problem.initial[s]) for s in self.at}

    def topic_values(self, x: float, v: float) -> tuple[Value, ...]:
        """The values of all topics for an estimate with this position and speed."""
        values: list[Any] = [t.default for t in self.flat.topics]
        for state, number in {**self.initial, self.position: x, self.speed: v}.items():
            topic, where = self.at[state]
            values[topic] = value_with_number(values[topic], where, number) if where else number
        return tuple(values)

    def keeps_ac(self, x: float, v: float) -> bool:
        """Whether the DM leaves AC in control at this position and speed."""
        state = self.facts.state_bytes(self.unit, self.topic_values(x, v))
        return self.dm.decide_when_fresh(self.module, state) == AC

    def find_fence(self) -> float | None:
        """The position where `safe` ends in the way, at rest or else at speed; None if unknown."""
        self.fastest = self._range_end_toward_fence(self.speed)
        if self.fastest is None:
            return None
        self.way = math.copysign(
            1.0, self.sc_distance(self.initial[self.position], self.fastest, 0.0)
        )
        start, last = self.initial[self.position], self._range_end_toward_fence(self.position)
        ends = [start + self.way * 2.0**k for k in range(FARTHEST_2)] if last is None else [last]
        for v, end in product((0.0, self.fastest), ends):
            at = _last_number_holding(
                start, end, partial(lambda v, x: self.facts.safe(self.topic_values(x, v)), v)
            )
            if at is None or at != end:
                return at
        return None

    def buffer_rows(self, fence: float, fastest: float) -> Iterator[BufferRow]:
        """Yields a row for each of `SPEEDS` speeds up to `fastest` at which AC ever has control."""
        for k in range(1, SPEEDS + 1):
            v = fastest * k / SPEEDS
            at = _last_number_holding(
                self.initial[self.position], fence, partial(self.keeps_ac, v=v)
            )
            if at is not None:
                yield BufferRow(v, at, abs(fence - at), self.sc_distance(at, v, self.way))

    def fastest_in_ac(self) -> float:
        """The highest speed at which AC is in control at the initial position."""
        assert self.fastest is not None
        v = _last_number_holding(
            0.0, self.fastest, lambda v: self.keeps_ac(self.initial[self.position], v)
        )
        return 0.0 if v is None else v

    def _range_end_toward_fence(self, state: int) -> float | None:
        """The end of a state's range toward the fence; None if it is too far away."""
        topic, leaf = self.problem.topic_leaf_of_state[state]
        bound, of = self.problem.system.topics[topic].bounds[leaf], self.problem.states[state]
        low, high = (of.low, of.high) if bound is None else (bound.low, bound.high)
        end = high if state == self.speed or self.way > 0.0 else low
        return end if abs(end) < FARTHEST else None

    def sc_distance(self, x: float, v: float, way: float) -> float:
        """The distance that SC moves on in the model, or its first move if `way` is 0."""
        states = self.problem.quantities.states
        changed = [self._exact_plant(c, x, v) for c in self.flat.components if c.plant is not None]
        system = derived_systems.with_components(self.flat, changed)
        system = derived_systems.with_forced_mode(system, self.module.index, "sc")
        leaf = states[self.position]
        name = self.problem.system.components[leaf.owner].name
        run = NativeProgram(system).run(UNTIL_NS, 1, keep_trace=(f"{name}.truth",))
        path = ".".join((f"{name}.truth", leaf.member, *leaf.path))
        moves = run.array(path) - x
        if way == 0.0:
            return float(moves[np.flatnonzero(moves)[:1]].sum())
        return max(0.0, float((way * moves).max()))

    def _exact_plant(self, c: Component, x: float, v: float) -> Component:
        """A plant without disturbances and errors that begins at this position and speed."""
        assert c.plant is not None
        initial: list[Any] = list(c.initial)
        names = [d.name for d in c.plant.states]
        for s, number in ((self.position, x), (self.speed, v)):
            leaf = self.problem.quantities.states[s]
            if self.problem.system.components[leaf.owner].name == c.name:
                k = names.index(leaf.member)
                where = positions(c.plant.states[k].type, leaf.path)
                initial[k] = value_with_number(initial[k], where, number) if where else number
        middles = [0.5 * (d.low + d.high) for d in c.disturbances]
        pairs = zip(c.disturbances, middles, strict=True)
        return replace(
            c,
            initial=tuple(initial),
            initial_range=(None,) * len(initial),
            disturbances=tuple(replace(d, low=m, high=m) for d, m in pairs),
            measured=tuple(replace(m, bound=0.0) for m in c.measured),
        )


def _last_number_holding(start: float, end: float, holds: Callable[[float], bool]) -> float | None:
    """The last number from `start` to `end` up to which `holds` is true; None if none is."""
    if not holds(start):
        return None
    for k in range(STEPS):
        a, b = (start + (end - start) * i / STEPS for i in (k, k + 1))
        if not holds(b):
            break
    else:
        return end
    for _ in range(HALVINGS):
        middle = 0.5 * (a + b)
        a, b = (middle, b) if holds(middle) else (a, middle)
    return a

"""Every execution of a test, enumerated the plain way: docs/testing.md over the interpreter.

Purpose: the judge of the explorer. A search over (configuration, schedule) in which every step is
a step of the reference interpreter; all orders, times, faults and choices. It is written from the
page alone and imports nothing of `explore/`, `core/` or `codegen/`.
Non-goals: speed, reductions, large systems (`TooLargeError`), externs.

Readings of the page: a configuration before the first step is not judged; a step whose outputs are
held back by an overrun is judged by its contracts as if they took effect at once; of several
violations in one configuration the first counts, `always` and `never` before those with deadlines.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from soter.language.elaborate.time_grid import quantum_of
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import BoolType, EnumType, FloatType, IntType
from soter.semantics.configuration import AC, NEVER, SC, DecisionVerdict, StepOutcome
from soter.semantics.draws import chosen_value
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import environment_input

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.language.evaluate.environment import Environment
    from soter.language.model.system import Bound, Component, Module, Scope, System, TestPlan
    from soter.language.model.types import Type, Value
    from soter.semantics.configuration import Configuration

PASSED = "passed"
"""In place of a deadline or bound that is over: by how much does not matter."""

Broken = tuple[str, int]
"""What is violated: "property", "contract" or "timed" and its index, or "fault" and a component."""

Canonical = tuple[Any, ...]
"""A configuration as docs/testing.md has it, comparable with others of the same test."""


class TooLargeError(Exception):
    """More configurations or transitions than were allowed."""


# ---------------------------------------------------------------- who answers


@dataclass
class Answers:
    """Answers what a step leaves open: first the given picks, then alternative 0.

    `counts` collects how many alternatives each question had; `next_picks` counts on.
    """

    picks: list[int] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)

    def choice(self, stream: str, index: int, count: int) -> int:
        """The pick for one question with `count` alternatives."""
        del stream, index
        if count == 1:
            return 0
        asked = len(self.counts)
        self.counts.append(count)
        if asked == len(self.picks):
            self.picks.append(0)
        return self.picks[asked]

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """One of: the middle, low, high."""
        if low == high:
            return low
        middle = 0.0 if low <= 0.0 <= high else low + (high - low) / 2
        return (middle, low, high)[self.choice(stream, index, 3)]

    def leaf_value(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """Any value of a bool, an enum or an int; of a float as above."""
        if isinstance(t, BoolType):
            return bool(self.choice(stream, index, 2))
        if isinstance(t, EnumType):
            return self.choice(stream, index, len(t.members))
        if isinstance(t, FloatType):
            assert bound is not None, stream
            return self.uniform(stream, index, bound.low, bound.high)
        assert isinstance(t, IntType), stream
        low, high = (t.low, t.high) if bound is None else (int(bound.low), int(bound.high))
        return low + self.choice(stream, index, high - low + 1)

    def all_ways(self, run: Callable[[], Any]) -> Iterator[Any]:
        """`run()` under every sequence of answers, in lexicographic order."""
        picks: list[int] | None = []
        while picks is not None:
            self.picks, self.counts = picks, []
            yield run()
            picks = self._next()

    def _next(self) -> list[int] | None:
        for i in reversed(range(len(self.counts))):
            if self.picks[i] + 1 < self.counts[i]:
                return [*self.picks[:i], self.picks[i] + 1]
        return None


# ---------------------------------------------------------------- actors and worlds


@dataclass(frozen=True)
class Actor:
    """A component or an input with its calendar; times in ns. `index` counts among its kind."""

    kind: str
    index: int
    period: int
    phase: int
    window: int = 0
    skips: int = 0
    overrun: int = 0
    least: int = 0
    """Of an overrun: so long each of them takes at least."""


@dataclass(frozen=True)
class Held:
    """Publications that wait to take effect, and when the step that made them began."""

    since: int
    published: tuple[tuple[int, Value], ...]


@dataclass(frozen=True)
class World:
    """A configuration and its schedule; per actor, per timed property, per module."""

    c: Configuration
    done: tuple[int, ...]
    lost: tuple[int, ...]
    held: tuple[Held | None, ...]
    due: tuple[int | None, ...]
    verdict: tuple[int, ...]
    acted: tuple[bool, ...]


@dataclass(frozen=True)
class Move:
    """One step of one actor at a time: kind "step", "lost", "begins" or "effect"."""

    actor: int
    kind: str
    time: int


@dataclass
class Found:
    """What the enumeration found.

    `least`: per violation the moves of the shortest execution that ends in it. `together`: moves,
    and all that is violated where these end. `observed`: what the properties read, over all
    observable configurations, which are `ends`.
    """

    configurations: set[Canonical] = field(default_factory=set)
    ends: set[Canonical] = field(default_factory=set)
    observed: set[Canonical] = field(default_factory=set)
    transitions: int = 0
    least: dict[Broken, int] = field(default_factory=dict)
    together: set[tuple[int, frozenset[Broken]]] = field(default_factory=set)

    @property
    def verdict(self) -> str:
        """ "clean" or "violated"."""
        return "violated" if self.least else "clean"

    @property
    def shortest(self) -> int | None:
        """Moves of the shortest violating execution."""
        return min(self.least.values(), default=None)

    def shortest_to(self) -> dict[Broken, int]:
        """The same as `least`, also of what is violated together with what counts."""
        moves_by_violation: dict[Broken, int] = {}
        for moves, some in sorted(self.together, key=lambda both: both[0]):
            for broken in some:
                moves_by_violation.setdefault(broken, moves)
        return moves_by_violation

    def blame(self, broken: list[Broken], moves: int) -> None:
        """Remember what is violated at once, of which the first counts.

        The search is breadth first, so the first one met is the shortest.
        """
        self.least.setdefault(broken[0], moves)
        self.together.add((moves, frozenset(broken)))


# ---------------------------------------------------------------- the test, made ready


class BruteForce:
    """The enumeration of one test. `system.test` says which.

    With `whole`, worlds are told apart by everything the interpreter knows of them, so that the
    claim that the canonical part determines the future is not used.
    """

    def __init__(self, system: System, *, whole: bool = False) -> None:
        assert system.test is not None, "flattened for a test"
        self.system = system
        self.plan: TestPlan = system.test
        self.whole = whole
        self.answers = Answers()
        self.interpreter = Interpreter(system, draws=self.answers)
        self.machine = self.interpreter.machine
        self.actors = actors_of(system)
        self.quantum = quantum_of(system)
        self.sees = _Sight(system)
        self.timely = self._is_timely()
        self.instants = [p for p in system.properties if p.component is None]
        self.conditions = {p.index: _condition(p.scope, p.condition) for p in system.properties}
        self.premises = [_condition(t.scope, t.premise) for t in self.plan.timed]
        self.wanted = [_condition(*self._timed_condition(t)) for t in self.plan.timed]

    def _timed_condition(self, t: Any) -> tuple[Scope, typed.TypedExpr | None]:
        if t.kind == "invariant":
            module = self.system.modules[t.module]
            return module.scope, module.symbol.safe
        return t.scope, t.condition

    def _is_timely(self) -> bool:
        """Whether when a step happens can matter, so that its time is a choice."""
        if any(a.overrun for a in self.actors):
            return True
        return self.sees.time and any(a.window for a in self.actors)

    # ------------------------------------------------------------ the search

    def run(self, most: int = 100_000, *, first: bool = False) -> Found:
        """All reachable configurations, at most `most` transitions (`TooLargeError`).

        With `first`, no further than to the first violation.
        """
        exploration = Found()
        seen: set[Canonical] = set()
        todo: deque[tuple[World, int]] = deque()

        def reach(w: World, moves: int) -> None:
            key = (w,) if self.whole else self.canonical(w)
            if key in seen:
                return
            seen.add(key)
            exploration.configurations.add(self.canonical(w))
            if self.observable(w):
                exploration.ends.add(self.canonical(w))
            broken = self._judged(w, exploration)
            if broken:
                exploration.blame(broken, moves)
            else:
                todo.append((w, moves))

        for w in self._births():
            reach(w, 0)
        while todo and not (first and exploration.least):
            world, moves = todo.popleft()
            for move in self.moves(world):
                for after, broken in self.made(world, move):
                    exploration.transitions += 1
                    if exploration.transitions > most:
                        raise TooLargeError
                    if after is None:
                        assert broken is not None
                        exploration.blame([broken], moves + 1)
                    else:
                        reach(after, moves + 1)
        return exploration

    def _births(self) -> Iterator[World]:
        none = (0,) * len(self.actors)
        due = tuple(
            t.within_ns if t.kind == "eventually" and t.within_ns <= self.plan.horizon_ns else None
            for t in self.plan.timed
        )
        modules = len(self.system.modules)
        for c in self.answers.all_ways(self.interpreter.initial):
            yield World(c, none, none, (None,) * len(none), due, (0,) * modules, (False,) * modules)

    # ------------------------------------------------------------ windows and order

    def window(self, w: World, i: int) -> tuple[int, int] | None:
        """When the next step of actor `i` may happen; None where it has none left."""
        a, held = self.actors[i], w.held[i]
        if held is not None:
            return held.since + a.least, held.since + a.overrun
        release = a.phase + w.done[i] * a.period
        return None if release > self.plan.horizon_ns else (release, release + a.window)

    def moves(self, w: World) -> Iterator[Move]:
        """Every move that the order and the windows allow."""
        windows = [self.window(w, i) for i in range(len(self.actors))]
        limit = min((high for _, high in filter(None, windows)), default=None)
        if limit is None:
            return
        may = [i for i, w in enumerate(windows) if w is not None and w[0] <= limit]
        if self.plan.ordered:  # inputs, then components as the system has them
            inputs = [i for i in may if self.actors[i].kind == "input"]
            may = (inputs or may)[:1]
        for i, window in enumerate(windows):
            if window is None or i not in may:  # somebody's hi is before this one's lo
                continue
            first = max(w.c.ct, window[0])
            kind = self._kind(w, i)
            if kind != "effect" and w.lost[i] < self.actors[i].skips:
                yield Move(i, "lost", first)
            for time in self._times(first, limit):
                yield Move(i, kind, time)

    def _kind(self, w: World, i: int) -> str:
        if self.actors[i].overrun == 0:
            return "step"
        return "begins" if w.held[i] is None else "effect"

    def _times(self, first: int, limit: int) -> list[int]:
        """As early as possible, or later at a multiple of the quantum."""
        if not self.timely:
            return [first]
        q = self.quantum
        return [first, *range(first // q * q + q, limit + 1, q)]

    def observable(self, w: World) -> bool:
        """Whether time may pass: everything that has to have happened by now has."""
        if w.c.ct < 0:
            return False
        windows = [self.window(w, i) for i in range(len(self.actors))]
        return all(window is None or window[1] > w.c.ct for window in windows)

    def is_last(self, w: World) -> bool:
        """Whether no step is left."""
        return all(self.window(w, i) is None for i in range(len(self.actors)))

    # ------------------------------------------------------------ one move

    def made(self, w: World, move: Move) -> Iterator[tuple[World | None, Broken | None]]:
        """What the move can lead to, one for each way to answer; None where a step violates."""
        i, a = move.actor, self.actors[move.actor]
        c = replace(w.c, ct=move.time)
        if move.kind == "effect":
            yield self._passed(self._effect(w, c, i)), None
            return
        w = replace(w, c=c, done=_put(w.done, i, w.done[i] + 1))
        if move.kind == "lost":
            yield self._passed(replace(w, lost=_put(w.lost, i, w.lost[i] + 1))), None
            return
        w = replace(w, lost=_put(w.lost, i, 0))
        step = self._input if a.kind == "input" else self._component
        for after, broken in self.answers.all_ways(lambda: step(w, move)):
            yield (None, broken) if broken else (self._passed(after), None)

    def _input(self, w: World, move: Move) -> tuple[World, Broken | None]:
        drive = self.system.inputs[self.actors[move.actor].index]
        topic = self.system.topics[drive.topic]
        if drive.values:
            value = drive.values[self.answers.choice(topic.name, 0, len(drive.values))]
        else:
            value = chosen_value(topic.type, topic.bounds, self.answers, topic.name, 0)
        return replace(w, c=environment_input(self.machine, w.c, drive.topic, value)), None

    def _component(self, w: World, move: Move) -> tuple[World, Broken | None]:
        n = self.actors[move.actor].index
        before = replace(w.c, FN=(n,))
        after, event = self.interpreter.fire(before, n)
        broken = self._step_violates(before, after, n, event)
        if broken is not None:
            return w, broken
        w = replace(w, c=after)
        if isinstance(event, DecisionVerdict):
            return self._note_verdict(w, event), None
        published = dict(event.published) if before.OE[n] else {}
        if move.kind == "begins":
            return self._hold_back(w, before, move, published), None
        return self._note_sc(w, n, bool(published)), None

    def _step_violates(
        self,
        before: Configuration,
        after: Configuration,
        n: int,
        event: DecisionVerdict | StepOutcome,
    ) -> Broken | None:
        component = self.system.components[n]
        contracts = [p for p in self.system.properties if p.component == n]
        assumed = [p for p in contracts if p.kind == "assumes"]
        for p in assumed:
            if not self._holds(self.conditions[p.index], before, component):
                return "contract", p.index
        if isinstance(event, DecisionVerdict):
            return None
        if event.fault is not None:
            return None if component.role == "ac" else ("fault", n)
        for p in contracts:
            if p.kind != "guarantees" or not before.OE[n]:
                continue
            if not self._holds(self.conditions[p.index], after, component):
                return "contract", p.index
        return None

    def _hold_back(
        self, w: World, before: Configuration, move: Move, published: dict[int, Value]
    ) -> World:
        c = w.c
        for topic in self._reached(published):
            c = replace(
                c,
                Topics=_put(c.Topics, topic, before.Topics[topic]),
                stamps=_put(c.stamps, topic, before.stamps[topic]),
            )
        held = Held(move.time, tuple(sorted(published.items())))
        return replace(w, c=c, held=_put(w.held, move.actor, held))

    def _reached(self, published: dict[int, Value]) -> set[int]:
        """The topics that a publication changes: themselves and the queues behind them."""
        topics = self.system.topics
        return {*published, *(q for t in published for q in topics[t].queues)}

    def _effect(self, w: World, c: Configuration, i: int) -> World:
        """Held publications take effect; releases up to now are lost."""
        a, held = self.actors[i], w.held[i]
        assert held is not None
        done = w.done[i]
        ready = c.ct - 1 if a.least > 0 else c.ct  # a release as it ends is not lost
        while a.phase + done * a.period <= min(ready, self.plan.horizon_ns):
            done += 1
        effective = c.OE[a.index] and bool(held.published)
        if effective:
            for topic, value in held.published:
                c = environment_input(self.machine, c, topic, value)
        w = replace(w, c=c, done=_put(w.done, i, done), held=_put(w.held, i, None))
        return self._note_sc(w, a.index, effective)

    # ------------------------------------------------------------ properties

    def _note_verdict(self, w: World, verdict: DecisionVerdict) -> World:
        """The latest time that the DM said AC; SC has not published since."""
        if verdict.after != AC:
            return w
        m = verdict.module
        return replace(w, verdict=_put(w.verdict, m, w.c.ct), acted=_put(w.acted, m, False))

    def _note_sc(self, w: World, n: int, published: bool) -> World:
        component = self.system.components[n]
        if component.role != "sc" or not published:
            return w
        module = self._module_of(component)
        if w.c.L[module.dm] != SC:
            return w
        return replace(w, acted=_put(w.acted, module.index, True))

    def _module_of(self, component: Component) -> Module:
        assert component.module is not None, component.name
        return self.system.modules[component.module]

    def _passed(self, w: World) -> World:
        """The deadlines after a move: kept, missed for ever, or new."""
        if not self.observable(w):
            return w
        due = list(w.due)
        for i, t in enumerate(self.plan.timed):
            owed = due[i]
            if t.kind == "invariant" or (owed is not None and owed < w.c.ct):
                continue
            if t.kind == "eventually" and owed is None:
                continue
            if self._holds(self.wanted[i], w.c):
                due[i] = None
            elif owed is None and self._holds(self.premises[i], w.c):
                deadline = w.c.ct + t.within_ns
                due[i] = deadline if deadline <= self.plan.horizon_ns else None
        return replace(w, due=tuple(due))

    def _judged(self, w: World, exploration: Found) -> list[Broken]:
        """All violations in a configuration, the one that counts first."""
        observable = self.observable(w)
        broken: list[Broken] = []
        if observable:
            exploration.observed.add(self.sees.projection(w))
            broken += [
                ("property", p.index)
                for p in self.instants
                if not self._kept(self.conditions[p.index], w.c, p.kind == "always")
            ]
        for i, t in enumerate(self.plan.timed):
            owed = w.due[i]
            if t.kind == "invariant":
                fails = observable and self._invariant_fails(w, i)
            else:
                fails = owed is not None and (owed < w.c.ct or self.is_last(w))
            if fails:
                broken.append(("timed", i))
        return broken

    def _invariant_fails(self, w: World, i: int) -> bool:
        number = self.plan.timed[i].module
        assert number is not None
        module = self.system.modules[number]
        if not self._holds(self.wanted[i], w.c):
            return True
        in_time = w.c.ct <= w.verdict[number] + 2 * module.period_ns
        return not in_time and not (w.acted[number] and w.c.L[module.dm] == SC)

    def _holds(
        self,
        condition: Callable[[Environment], Value],
        c: Configuration,
        component: Component | None = None,
    ) -> bool:
        """Whether it is true; what cannot be evaluated is not."""
        return self._kept(condition, c, True, component)

    def _kept(
        self,
        condition: Callable[[Environment], Value],
        c: Configuration,
        wanted: bool,
        component: Component | None = None,
    ) -> bool:
        try:
            return bool(condition(self.machine.environment(c, component))) == wanted
        except StepFault:
            return False

    # ------------------------------------------------------------ canonical configurations

    def canonical(self, w: World) -> Canonical:
        """What determines the future, in a form that an explorer's world can be brought into."""
        c, system = w.c, self.system
        nodes_with_takeover = [
            n.index for n in system.components if n.node is not None and n.node.takeover is not None
        ]
        invariant = sorted({t.module for t in self.plan.timed if t.module is not None})
        return (
            c.ct,
            c.L,
            c.OE,
            tuple(c.Topics[t] for t in sorted(self.sees.read)),
            tuple(c.stamps[t] != NEVER for t in self.sees.lossy),
            c.latched,
            tuple(c.had_control[n] for n in nodes_with_takeover),
            c.gate_fault,
            c.clean_needed,
            w.done,
            tuple(n for n, a in zip(w.lost, self.actors, strict=True) if a.skips),
            tuple(self.sees.stamp(c, t) for t in sorted(self.sees.stamps)),
            tuple(
                None if h is None else (h.since, h.published)
                for h, a in zip(w.held, self.actors, strict=True)
                if a.overrun
            ),
            tuple(PASSED if d is not None and d < c.ct else d for d in w.due),
            tuple((self._verdict(w, m), w.acted[m]) for m in invariant),
        )

    def _verdict(self, w: World, m: int) -> int | str:
        """When DM last said AC; how long its bound is over does not matter."""
        over = w.c.ct > w.verdict[m] + 2 * self.system.modules[m].period_ns
        return PASSED if over else w.verdict[m]


def _put(values: tuple[Any, ...], index: int, value: object) -> tuple[Any, ...]:
    return (*values[:index], value, *values[index + 1 :])


def _condition(scope: Scope, e: typed.TypedExpr | None) -> Callable[[Environment], Value]:
    return (lambda _env: True) if e is None else Evaluator.for_scope(scope).compiled(e)


# ---------------------------------------------------------------- calendars


def actors_of(system: System) -> tuple[Actor, ...]:
    """Components in their order, then inputs."""
    assert system.test is not None
    actors = []
    for n in system.components:
        by = {f.kind: f for f in system.test.faults if f.component == n.index}
        late = by["late"].by_ns if "late" in by else 0
        actors.append(
            Actor(
                "component",
                n.index,
                n.period_ns,
                n.phase_ns,
                window=0 if n.role == "plant" else system.test.skew_ns + late,
                skips=by["skip"].at_most if "skip" in by else 0,
                overrun=by["overrun"].by_ns if "overrun" in by else 0,
                least=by["overrun"].least_ns if "overrun" in by else 0,
            )
        )
    actors += [Actor("input", i, d.every_ns, 0) for i, d in enumerate(system.inputs)]
    return tuple(actors)


# ---------------------------------------------------------------- what can be seen


class _Sight:
    """What code and properties of a test read: topics, stamps, time, and what is observed.

    What nobody reads does not determine the future. A `fault` queue that lost a value says so in
    its stamp.
    """

    def __init__(self, system: System) -> None:
        assert system.test is not None
        self.system = system
        self.read = {t.index for t in system.topics if t.queue_of is not None}
        self.lossy = [t.index for t in system.topics if t.policy == "fault"]
        self.ages: set[int] = set()
        self.max_age: dict[int, int] = {}
        self.time = any(system.test.timed)
        for scope, roots in _everything(system):
            self._look(scope, roots)
        for m in system.modules:
            for t in m.inputs:
                age = system.topics[t].max_age_ns
                if age is not None:
                    self.max_age[t] = age
            latch = {t for t in (m.latch, m.acknowledgement) if t is not None}
            self.read |= latch
            self.ages |= latch if m.acknowledgement is not None else set()
        self.stamps = {*self.ages, *self.max_age}
        self.time = self.time or bool(self.stamps)
        self.topics: set[int] = set()
        self.truths: set[int] = set()
        self.modes: set[int] = set()
        self.clock = False
        for scope, root in _observing(system):
            self._observe(scope, root)

    def _look(self, scope: Scope, roots: list[object]) -> None:
        for node in nodes(roots):
            if isinstance(node, typed.TopicRead):
                self.read.add(scope.topics[node.topic])
            if isinstance(node, typed.AgeRead):
                self.ages.add(scope.topics[node.topic])
            self.time = self.time or isinstance(node, (typed.AgeRead, typed.TimeRead))

    def _observe(self, scope: Scope, root: object) -> None:
        for node in nodes([root]):
            if isinstance(node, (typed.TopicRead, typed.AgeRead)):
                self.topics.add(scope.topics[node.topic])
            elif isinstance(node, typed.TruthRead):
                self.truths.add(scope.plants[node.instance])
            elif isinstance(node, typed.ModeRead):
                self.modes.add(self.system.modules[scope.modules[node.module]].dm)
            self.clock = self.clock or isinstance(node, (typed.TimeRead, typed.AgeRead))

    def projection(self, w: World) -> Canonical:
        """What the properties read."""
        return (
            w.c.ct if self.clock else None,
            tuple(w.c.Topics[t] for t in sorted(self.topics)),
            tuple(w.c.L[n] for n in sorted({*self.truths, *self.modes})),
        )

    def stamp(self, c: Configuration, topic: int) -> int:
        """The stamp; where it only decides about staleness, all that are too old are one."""
        stamp = c.stamps[topic]
        if topic not in self.ages and c.ct - stamp > self.max_age[topic]:
            return NEVER
        return stamp


def _everything(system: System) -> Iterator[tuple[Scope, list[object]]]:
    """All code that runs, with the scope it runs in."""
    for n in system.components:
        if n.node is not None:
            yield n.scope, [*n.node.step, *(n.node.takeover or ())]
        elif n.plant is not None:
            plant = n.plant
            yield (
                n.scope,
                [*(e for _, e in plant.lets), *plant.der.values(), *plant.next.values()],
            )
            yield n.scope, [e for _, e in plant.drives]
    for m in system.modules:
        yield m.scope, [e for e in (m.symbol.ttf, m.symbol.safer) if e is not None]
    for p in system.properties:
        yield p.scope, [p.condition]
    yield from ((scope, [root]) for scope, root in _observing(system))


def _observing(system: System) -> Iterator[tuple[Scope, object]]:
    """What is judged at observable configurations."""
    assert system.test is not None
    for p in system.properties:
        if p.component is None:
            yield p.scope, p.condition
    for t in system.test.timed:
        if t.kind == "invariant":
            assert t.module is not None
            module = system.modules[t.module]
            yield module.scope, module.symbol.safe
        else:
            yield from ((t.scope, e) for e in (t.premise, t.condition) if e is not None)


def enumerate_all(system: System, most: int = 100_000, *, whole: bool = False) -> Found:
    """All executions of the test that `system` was flattened for."""
    return BruteForce(system, whole=whole).run(most)

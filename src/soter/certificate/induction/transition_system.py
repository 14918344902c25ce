"""Executions as sequences of steps: one after the other, each on the state that the last one left.

Purpose: a `TransitionSystem` runs the instants of some hyperperiods; at each, every component that
is due makes its step, in an order that is left open. Topics carry the absolute times of their
publications. What holds is recorded at the end of every instant.
Non-goals: what a step does to its environment (`solver_reading.py`), induction (`check.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import z3

from soter.certificate.induction.exactness_rules import is_exact
from soter.certificate.induction.solver_reading import SolverReading, VisibleValues
from soter.certificate.induction.solver_values import either, inside, known, opaque, unknown
from soter.language.evaluate.predicates.numbers_in_predicates import maybe_nan
from soter.language.model import typed
from soter.language.model.tree_walk import nodes as parts_of
from soter.language.model.types import MODE
from soter.workers.interruptible_solver import raise_if_interrupted

if TYPE_CHECKING:
    from soter.certificate.induction.induction_problem import InductionFacts
    from soter.language.model.system import Component

Term = Any
YES, NO = z3.BoolVal(True), z3.BoolVal(False)
IN_SC, IN_AC = 0, 1
UNPUBLISHED = -(2**62)


@dataclass
class MachineState:
    """The state between two steps. `stamps`: absolute times; `faulted`: some step did."""

    topics: dict[int, Term]
    stamps: dict[int, Term]
    locals: dict[int, tuple[Term, ...]]
    mode: Term
    faulted: Term
    had: dict[int, Term]
    latched: dict[int, Term]


@dataclass(frozen=True)
class Instant:
    """The end of one: when, and what holds then; `always`: `safe` until the next instant."""

    at: int
    holds: Term
    always: Term
    decided: tuple[Term, ...]
    """The modes that the DM found and left, where it stepped."""


def calendar_of(
    facts: InductionFacts, end: int, *, first: bool = False
) -> dict[int, list[Component]]:
    """Who is due when, up to `end`; `first`: from the start of a run, else of a later turn."""
    components_by_time: dict[int, list[Component]] = {}
    for c in facts.actors:
        for at in range(c.phase_ns if first else c.phase_ns % c.period_ns, end, c.period_ns):
            components_by_time.setdefault(at, []).append(c)
    return components_by_time


class TransitionSystem:
    """Runs the instants in [begin, end): from the first values, or after any state."""

    def __init__(
        self, facts: InductionFacts, *, first: bool, fresh: bool = False, begin: int = 0
    ) -> None:
        self.facts = facts
        self.first, self.begin = first, begin
        self.fresh = fresh
        """The DM's reads are fresh and the gate has nothing against AC."""
        self.tolerant = facts.latching and not fresh
        """A fault of what is opaque latches its node; without it such a fault fails."""
        self.constraints: list[Term] = []
        self.instants: list[Instant] = []
        self.gets: list[tuple[int, Term]] = []
        self.keeps: list[tuple[int, Term]] = []
        """When the DM steps, and whether it then gives AC control, or leaves it in control."""
        self.now = self._start()

    def _start(self) -> MachineState:
        flying = self.facts.flying
        topics, stamps, locals_by_component = {}, {}, {}
        for i in self.facts.topics:
            topic = flying.topics[i]
            if self.first:
                topics[i], stamps[i] = known(topic.type, topic.default), z3.IntVal(UNPUBLISHED)
                continue
            topics[i] = unknown(topic.type, topic.name, self.constraints)
            self.constraints.append(inside(topics[i], topic.type, topic.bounds))
            stamps[i] = z3.FreshInt("stamp")
            self.constraints.append(stamps[i] < self.begin)
        for c in self.facts.actors:
            if c.node is not None:
                pairs = zip(c.node.locals, c.initial, strict=True)
                locals_by_component[c.index] = tuple(
                    known(v.type, x) if self.first else unknown(v.type, v.name, self.constraints)
                    for v, x in pairs
                )
        mode = z3.IntVal(IN_SC) if self.first else unknown(MODE, "mode", self.constraints)
        indices = [c.index for c in self.facts.actors]
        had = {i: NO if self.first else z3.FreshBool("had") for i in indices}
        free = self.tolerant and not self.first
        latched = {i: z3.FreshBool("latched") if free else NO for i in indices}
        return MachineState(topics, stamps, locals_by_component, mode, NO, had, latched)

    # ------------------------------------------------------------ time

    def run(self, end: int) -> None:
        """Everything up to `end`."""
        longest = max(c.period_ns + c.phase_ns for c in self.facts.actors)
        calendar = calendar_of(self.facts, end + longest, first=self.first)
        times = sorted(calendar)
        if self.first:
            self._before_everything(times[0])
        for at, following in pairwise(times):
            if self.begin <= at < end:
                self._instant(at, calendar[at], following)

    def _before_everything(self, first: int) -> None:
        """Other components may step, and `safe` be judged, before any that is followed."""
        others = [c.phase_ns for c in self.facts.flying.components]
        others += [0 for _ in self.facts.flying.inputs]
        if min(others) < first:
            self._judge(0, first, ())

    def _instant(self, at: int, due: list[Component], following: int) -> None:
        """Each of them once, in any order."""
        raise_if_interrupted()
        left = list(range(len(due)))
        turns = []
        decided: list[Term] = []
        for _k in left:
            who = z3.FreshInt("who")
            turns.append(who)
            self.constraints += [who >= 0, who < len(due)]
            after = None
            for n, c in enumerate(due):
                one, seen = self._stepped(c, at)
                if seen is not None:
                    stays, gets, keeps = seen
                    decided.append(z3.Implies(who == n, stays))
                    self.gets.append((at, z3.And(who == n, gets)))
                    self.keeps.append((at, z3.And(who == n, keeps)))
                after = one if after is None else _merge(who == n, one, after)
            assert after is not None
            self.now = self._named(after)
        if len(turns) > 1:
            self.constraints.append(z3.Distinct(*turns))
        self._judge(at, following, tuple(decided))

    def _named(self, state: MachineState) -> MachineState:
        """Terms of bounded size: a new name for every part of a state."""
        return MachineState(
            {i: self._name(v) for i, v in state.topics.items()},
            {i: self._name(v) for i, v in state.stamps.items()},
            {i: self._name(v) for i, v in state.locals.items()},
            self._name(state.mode),
            self._name(state.faulted),
            {i: self._name(v) for i, v in state.had.items()},
            {i: self._name(v) for i, v in state.latched.items()},
        )

    def _name(self, value: Term) -> Term:
        if isinstance(value, tuple):
            return tuple(self._name(v) for v in value)
        value = opaque(value)
        if z3.is_const(value):
            return value
        constant = z3.FreshConst(value.sort(), "is")
        self.constraints.append(constant == value)
        return constant

    # ------------------------------------------------------------ steps

    def _stepped(
        self, c: Component, at: int
    ) -> tuple[MachineState, tuple[Term, Term, Term] | None]:
        if c.role == "dm":
            return self._decision(at)
        on = YES
        if c.role in ("ac", "sc"):
            on = self.now.mode == (IN_AC if c.role == "ac" else IN_SC)
        if c.role == "ac":
            return self._anything(c, at, on), None
        return self._code(c, at, on), None

    def _sight(self, c: Component, at: Term, on: Term) -> VisibleValues:
        now, flying = self.now, self.facts.flying

        def topic(i: int) -> Term:
            if i in now.topics:
                return now.topics[i]
            term = unknown(flying.topics[i].type, flying.topics[i].name, self.constraints)
            if flying.topics[i].queue_of is None:
                self.constraints.append(
                    inside(term, flying.topics[i].type, flying.topics[i].bounds)
                )
            return term

        def age(i: int) -> Term:
            source = flying.topics[i].queue_of
            i = i if source is None else source
            if i in now.stamps:
                return at - now.stamps[i]
            term = z3.FreshInt("age")
            self.constraints.append(term >= 0)
            return term

        own = self.facts.flying_module.index
        return VisibleValues(c.scope, topic, age, now.mode, own, on, self.constraints)

    def _decision(self, at: int) -> tuple[MachineState, tuple[Term, Term, Term]]:
        dm, symbol, module = self.facts.dm, self.facts.symbol, self.facts.flying_module
        assert symbol.ttf is not None
        assert symbol.safer is not None
        sight = self._sight(dm, z3.IntVal(at), YES)
        looked_at = maybe_nan(self.facts.flying, module)
        ttf, unsure = SolverReading(sight, looked_at=looked_at).truth(symbol.ttf)
        safer, doubtful = SolverReading(sight, looked_at=looked_at).truth(symbol.safer)
        old = NO
        for i in module.inputs:
            limit = self.facts.flying.topics[i].max_age_ns
            if limit is not None:
                old = z3.Or(old, sight.age(i) > limit)
        refused, owed = z3.FreshBool("refused"), z3.FreshBool("owed")
        if self.fresh:
            self.constraints += [z3.Not(refused), z3.Not(owed), z3.Not(old)]
        stay = z3.Not(z3.Or(ttf, unsure, old, refused))
        get = z3.And(safer, z3.Not(doubtful), z3.Not(old), z3.Not(owed))
        good = z3.If(self.now.mode == IN_AC, stay, get)
        mode = z3.If(good, z3.IntVal(IN_AC), z3.IntVal(IN_SC))
        now = self.now
        ways = ((IN_SC, IN_SC), (IN_SC, IN_AC), (IN_AC, IN_AC))
        stays, gets, keeps = (z3.And(now.mode == a, mode == b) for a, b in ways)
        return replace(now, mode=mode), (stays, gets, keeps)

    def _anything(self, c: Component, at: int, on: Term) -> MachineState:
        """AC: each of its topics, or not, any value of the set."""
        now, flying = self.now, self.facts.flying
        topics, stamps = dict(now.topics), dict(now.stamps)
        assert c.node is not None
        for symbol in c.node.publishes:
            i = c.scope.topics[symbol]
            value = unknown(flying.topics[i].type, flying.topics[i].name, self.constraints)
            self.constraints.append(inside(value, flying.topics[i].type, flying.topics[i].bounds))
            out = z3.And(on, z3.FreshBool("published"))
            topics[i], stamps[i] = _both(out, value, at, topics[i], stamps[i])
        return replace(now, topics=topics, stamps=stamps)

    def _code(self, c: Component, at: int, on: Term) -> MachineState:
        """SC or a node: its statements."""
        now, flying, node = self.now, self.facts.flying, c.node
        assert node is not None
        reading = SolverReading(self._sight(c, z3.IntVal(at), on))
        reading.env = dict(zip(node.locals, now.locals[c.index], strict=True))
        reading.run(node.takeover or (), z3.And(on, z3.Not(now.had[c.index])))
        reading.run(node.step, YES)
        fault, doubt = reading.fault, reading.doubt
        for symbol, (flag, value) in reading.said.items():
            topic = flying.topics[c.scope.topics[symbol]]
            refused = z3.And(flag, z3.Not(inside(value, topic.type, topic.bounds)))
            if is_exact(topic.type):
                fault = z3.Or(fault, refused)
            else:
                doubt = z3.Or(doubt, refused)
        if any(flying.topics[c.scope.topics[s.topic]].policy == "fault" for s in node.subscribes):
            fault = z3.Or(fault, z3.FreshBool("lost"))
        gone = z3.Or(now.latched[c.index], fault, doubt) if self.tolerant else NO
        faulted = z3.Or(now.faulted, fault) if self.tolerant else z3.Or(now.faulted, fault, doubt)
        topics, stamps = dict(now.topics), dict(now.stamps)
        for symbol in node.publishes:
            i = c.scope.topics[symbol]
            flag, value = reading.said.get(symbol, (NO, topics[i]))
            if i in c.failsafe:
                value = either(gone, known(flying.topics[i].type, c.failsafe[i]), value)
            out = z3.And(on, z3.If(gone, z3.BoolVal(i in c.failsafe), flag))
            topics[i], stamps[i] = _both(out, value, at, topics[i], stamps[i])
        after = tuple(reading.env[v] for v in node.locals)
        return MachineState(
            topics,
            stamps,
            {**now.locals, c.index: either(gone, now.locals[c.index], after)},
            now.mode,
            faulted,
            {**now.had, c.index: z3.If(gone, now.had[c.index], on)},
            {**now.latched, c.index: gone},
        )

    # ------------------------------------------------------------ what holds

    def _judge(self, at: int, following: int, decided: tuple[Term, ...]) -> None:
        symbol, dm = self.facts.symbol, self.facts.dm

        def holds(e: typed.TypedExpr, now: Term) -> Term:
            value, fault = SolverReading(self._sight(dm, now, YES)).truth(e)
            return z3.And(value, z3.Not(fault))

        here = z3.IntVal(at)
        safe = holds(symbol.safe, here)
        every = [z3.Not(self.now.faulted), safe, *(holds(e, here) for e in symbol.verify.lemmas)]
        always = safe
        if any(isinstance(n, typed.AgeRead) for n in parts_of([symbol.safe])):
            later = z3.FreshInt("later")
            self.constraints.append(z3.And(later >= at, later < following))
            always = z3.And(safe, holds(symbol.safe, later))
        self.instants.append(Instant(at, z3.And(*every), always, decided))


def _both(out: Term, value: Term, at: int, old: Term, stamp: Term) -> tuple[Term, Term]:
    return either(out, value, old), z3.If(out, z3.IntVal(at), stamp)


def _merge(c: Term, a: MachineState, b: MachineState) -> MachineState:
    """One of two states."""
    return MachineState(
        {i: either(c, a.topics[i], b.topics[i]) for i in a.topics},
        {i: either(c, a.stamps[i], b.stamps[i]) for i in a.stamps},
        {i: either(c, a.locals[i], b.locals[i]) for i in a.locals},
        either(c, a.mode, b.mode),
        either(c, a.faulted, b.faulted),
        {i: either(c, a.had[i], b.had[i]) for i in a.had},
        {i: either(c, a.latched[i], b.latched[i]) for i in a.latched},
    )

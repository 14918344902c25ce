"""The re-checker's executions of an induction: steps, each on the state the last one left.

Purpose: a `TransitionSystem` runs the instants of some hyperperiods; at each, every component that
is due makes its step, in an order that is left open. Topics carry the absolute times of their
publications. What holds is recorded at the end of every instant. What is known stays a number or a
truth of Python.
Non-goals: what a step does to its environment (`solver_reading.py`), induction (`check_claims.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import z3

from soter.certificate.induction.solver_reading import SolverReading, VisibleValues
from soter.certificate.induction.solver_values import (
    Elapsed,
    both,
    either,
    inside,
    is_exact,
    negation,
    one_of,
    shaped,
    term,
    unknown,
)
from soter.certificate.reading.symbolic_operations import is_known
from soter.language.evaluate.numbers_in_predicates import maybe_nan
from soter.language.model import typed
from soter.language.model.tree_walk import nodes as parts_of
from soter.language.model.types import MODE
from soter.workers.solvers import raise_if_interrupted

if TYPE_CHECKING:
    from soter.certificate.induction.induction_problem import InductionFacts
    from soter.language.model.system import Component

Term = Any
State = dict[Any, Term]
"""Between two steps: by index under "topic", "stamp" (absolute times), "locals", "had" and
"latched", and "mode" and "faulted": whether some step did."""
IN_SC, IN_AC = 0, 1
UNPUBLISHED = -(2**62)


@dataclass(frozen=True)
class Instant:
    """The end of one: when, and what holds then; `always`: `safe` until the next instant."""

    at: int
    holds: Term
    always: Term


@dataclass(frozen=True)
class Decision:
    """A step of the DM, if it is its turn then: whether SC keeps control, AC gets or keeps it."""

    at: int
    turn: Term
    stays: Term
    gets: Term
    keeps: Term


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
        self.decisions: list[Decision] = []
        self.now = self._start()

    def _start(self) -> State:
        facts, flying, known = self.facts, self.facts.flying, self.constraints
        state: State = {"mode": IN_SC if self.first else unknown(MODE, "mode", known)}
        state["faulted"] = False
        for i in facts.topics:
            topic = flying.topics[i]
            if self.first:
                state["topic", i] = shaped(topic.type, topic.default, known)
                state["stamp", i] = UNPUBLISHED
                continue
            state["topic", i] = self._anything_of(i)
            state["stamp", i] = z3.FreshInt("stamp")
            known.append(state["stamp", i] < self.begin)
        for c in facts.actors:
            state["locals", c.index] = tuple(
                shaped(v.type, x, known) if self.first else unknown(v.type, v.name, known)
                for v, x in (zip(c.node.locals, c.initial, strict=True) if c.node else ())
            )
            free = self.tolerant and not self.first
            state["had", c.index] = False if self.first else z3.FreshBool("had")
            state["latched", c.index] = z3.FreshBool("latched") if free else False
        return state

    def _anything_of(self, i: int) -> Term:
        """Any value of the set of a topic."""
        topic = self.facts.flying.topics[i]
        value = unknown(topic.type, topic.name, self.constraints)
        self.constraints.append(inside(value, topic.type, topic.bounds))
        return value

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
            self._judge(0, first)

    def _instant(self, at: int, due: list[Component], following: int) -> None:
        """Each of them once, in any order."""
        raise_if_interrupted()
        turns = []
        for _ in due:
            who = z3.FreshInt("who")
            turns.append(who)
            self.constraints += [who >= 0, who < len(due)]
            after = self._stepped(due[0], at, who == 0)
            for n, c in enumerate(due[1:], 1):
                one = self._stepped(c, at, who == n)
                after = {k: either(who == n, x, after[k]) for k, x in one.items()}
            self.now = {k: self._name(v) for k, v in after.items()}
        if len(turns) > 1:
            self.constraints.append(z3.Distinct(*turns))
        self._judge(at, following)

    def _name(self, value: Term) -> Term:
        """Terms of bounded size: a new name for every part of a state that is none yet."""
        if isinstance(value, tuple):
            return tuple(self._name(v) for v in value)
        value = term(value) if isinstance(value, Elapsed) else value
        if is_known(value) or z3.is_const(value):
            return value
        constant = z3.FreshConst(value.sort(), "is")
        self.constraints.append(constant == value)
        return constant

    # ------------------------------------------------------------ steps

    def _stepped(self, c: Component, at: int, turn: Term) -> State:
        if c.role == "dm":
            return self._decision(at, turn)
        if c.role == "ac":
            return self._anything(c, at, self.now["mode"] == IN_AC)
        return self._code(c, at, c.role != "sc" or self.now["mode"] == IN_SC)

    def _sight(self, c: Component, at: Term, on: Term) -> VisibleValues:
        now, flying = self.now, self.facts.flying

        def topic(i: int) -> Term:
            if ("topic", i) in now:
                return now["topic", i]
            of = flying.topics[i]
            if of.queue_of is None:
                return self._anything_of(i)
            return unknown(of.type, of.name, self.constraints)

        def age(i: int) -> Term:
            source = flying.topics[i].queue_of
            i = i if source is None else source
            if ("stamp", i) in now:
                return at - now["stamp", i]
            ns = z3.FreshInt("age")
            self.constraints.append(ns >= 0)
            return ns

        own = self.facts.flying_module.index
        return VisibleValues(c.scope, topic, age, now["mode"], own, on, self.constraints)

    def _decision(self, at: int, turn: Term) -> State:
        dm, symbol, module = self.facts.dm, self.facts.symbol, self.facts.flying_module
        assert symbol.ttf is not None
        assert symbol.safer is not None
        sight = self._sight(dm, at, on=True)
        looked_at = maybe_nan(self.facts.flying, module)
        ttf, unsure = SolverReading(sight, looked_at=looked_at).truth(symbol.ttf)
        safer, doubtful = SolverReading(sight, looked_at=looked_at).truth(symbol.safer)
        limits = [(i, self.facts.flying.topics[i].max_age_ns) for i in module.inputs]
        old = one_of(*(sight.age(i) > limit for i, limit in limits if limit is not None))
        refused, owed = z3.FreshBool("refused"), z3.FreshBool("owed")
        if self.fresh:
            self.constraints += [z3.Not(refused), z3.Not(owed), negation(old)]
        stay = negation(one_of(ttf, unsure, old, refused))
        get = both(safer, negation(doubtful), negation(old), negation(owed))
        had = self.now["mode"]
        mode = either(either(had == IN_AC, stay, get), IN_AC, IN_SC)
        ways = ((IN_SC, IN_SC), (IN_SC, IN_AC), (IN_AC, IN_AC))
        self.decisions.append(Decision(at, turn, *(both(had == a, mode == b) for a, b in ways)))
        return {**self.now, "mode": mode}

    def _anything(self, c: Component, at: int, on: Term) -> State:
        """AC: each of its topics, or not, any value of the set."""
        assert c.node is not None
        after = dict(self.now)
        for symbol in c.node.publishes:
            i = c.scope.topics[symbol]
            _publish(after, i, both(on, z3.FreshBool("published")), self._anything_of(i), at)
        return after

    def _code(self, c: Component, at: int, on: Term) -> State:
        """SC or a node: its statements."""
        now, flying, node = self.now, self.facts.flying, c.node
        assert node is not None
        reading = SolverReading(self._sight(c, at, on))
        before = now["locals", c.index]
        taken = both(on, negation(now["had", c.index]))
        behind, said = reading.step(node, before, taken)
        fault, doubt = reading.make.fault, reading.make.doubt
        for symbol, (flag, value) in said.items():
            topic = flying.topics[c.scope.topics[symbol]]
            refused = both(flag, negation(inside(value, topic.type, topic.bounds)))
            if is_exact(topic.type):
                fault = one_of(fault, refused)
            else:
                doubt = one_of(doubt, refused)
        if any(flying.topics[c.scope.topics[s.topic]].policy == "fault" for s in node.subscribes):
            fault = one_of(fault, z3.FreshBool("lost"))
        latched = now["latched", c.index]
        gone = one_of(latched, fault, doubt) if self.tolerant else False
        after = dict(now)
        after["faulted"] = one_of(now["faulted"], fault, False if self.tolerant else doubt)
        for symbol in node.publishes:
            i = c.scope.topics[symbol]
            flag, value = said.get(symbol, (False, after["topic", i]))
            if i in c.failsafe:
                own = shaped(flying.topics[i].type, c.failsafe[i], self.constraints)
                value = either(gone, own, value)
            _publish(after, i, both(on, either(gone, i in c.failsafe, flag)), value, at)
        after["locals", c.index] = either(gone, before, behind)
        after["had", c.index] = either(gone, now["had", c.index], on)
        after["latched", c.index] = gone
        return after

    # ------------------------------------------------------------ what holds

    def _judge(self, at: int, following: int) -> None:
        symbol, dm = self.facts.symbol, self.facts.dm

        def holds(e: typed.TypedExpr, now: Term) -> Term:
            value, fault = SolverReading(self._sight(dm, now, on=True)).truth(e)
            return both(value, negation(fault))

        safe = holds(symbol.safe, at)
        lemmas = [holds(e, at) for e in symbol.verify.lemmas]
        always = safe
        if any(isinstance(n, typed.AgeRead) for n in parts_of([symbol.safe])):
            later = z3.FreshInt("later")
            self.constraints.append(z3.And(later >= at, later < following))
            always = both(safe, holds(symbol.safe, later))
        every = both(negation(self.now["faulted"]), safe, *lemmas)
        self.instants.append(Instant(at, every, always))


def _publish(state: State, topic: int, out: Term, value: Term, at: int) -> None:
    state["topic", topic] = either(out, value, state["topic", topic])
    state["stamp", topic] = either(out, at, state["stamp", topic])

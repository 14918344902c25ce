"""Reads the problem of an induction again, and runs its executions step by step.

Purpose: `read_induction` reads `InductionFacts` off the checked program, by other code than the
prover's; `compare_entry` holds the certificate against them. A `TransitionSystem` runs the instants
of some hyperperiods as terms of a solver: at each, every component that is due makes its step, in
an order that is left open. Topics carry the absolute times of their publications. What holds is
recorded at the end of every instant. What is known stays a number or a truth of Python.
Non-goals: what a step does (`solver_steps.py`), showing anything (`check_claims.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from math import lcm
from typing import TYPE_CHECKING, Any

import z3

from soter.certificate.extras.sc_locals_and_modes import modes_in
from soter.certificate.extras.thread_times import first_delayed_in_thread
from soter.certificate.induction.solver_steps import SolverReading, VisibleValues
from soter.certificate.induction.solver_values import (
    Elapsed,
    and_of,
    as_term,
    choose,
    is_exact,
    negation,
    or_of,
    unknown_value,
    value_as_terms,
    within_bounds,
)
from soter.certificate.reading.symbolic_values import is_known
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.language.check.constants_and_types import declared_ns
from soter.language.evaluate.predicates import maybe_nan
from soter.language.model import typed
from soter.language.model.tree_walk import nodes as parts_of
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import MODE
from soter.workers.interruptible_solver import raise_if_interrupted

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from soter.language.model.system import Component, Module, System


REFUSED = "groups", "abstracts", "commands", "core", "horizon", "levels", "acts", "dropout", "age"
IN_SC, IN_AC = 0, 1
UNPUBLISHED = -(2**62)


@dataclass(eq=False)
class InductionFacts:
    """A module, the nodes that are followed beside it, and their times in ns."""

    flying: System
    flying_module: Module
    symbol: typed.ModuleSymbol
    sc: Component
    actors: list[Component] = field(default_factory=list)
    undeclared: bool = False
    work: int = 0
    """The work that the solver has done, in its own units."""
    latching: bool = False
    """Whether, by the certificate, faults of what is opaque may happen, and latch their nodes."""
    topics: list[int] = field(default_factory=list)
    """Topics of the actors: these are followed, everything else may hold anything of its set."""

    @property
    def dm(self) -> Component:
        """The decision module."""
        return self.flying.components[self.flying_module.dm]

    @property
    def hyperperiod(self) -> int:
        """The hyperperiod in ns, after which the pattern of releases repeats."""
        return lcm(*(c.period_ns for c in self.actors))

    @property
    def settled_at(self) -> int:
        """The first beginning of a hyperperiod, in ns, by which every actor was released once."""
        return -(-max(c.phase_ns for c in self.actors) // self.hyperperiod) * self.hyperperiod


def read_induction(flat: System, name: str) -> InductionFacts:
    """Reads a module's problem; RejectedError, NotRecheckedError where it is none, or unknown."""
    matches = [m for m in flat.modules if m.name == name]
    if len(matches) != 1:
        raise RejectedError(f"system `{flat.name}` has no module `{name}`")
    module = matches[0]
    symbol = module.symbol
    if module.forced is not None:
        raise NotRecheckedError(f"`{name}` is forced to {module.forced}: its DM never decides")
    if symbol.verify.induction is None or symbol.ttf is None or symbol.safer is None:
        raise RejectedError(f"module `{name}` does not ask for an induction")
    if any(getattr(symbol.verify, word) for word in REFUSED):
        raise NotRecheckedError("a `verify` block that speaks of sets")
    facts = InductionFacts(flat, module, symbol, flat.components[module.sc])
    _enter_actors(facts)
    _check_times(facts)
    return facts


def _enter_actors(facts: InductionFacts) -> None:
    """Makes actors of DM, AC, SC, and of the followable nodes whose topics are read."""
    flat, module, symbol = facts.flying, facts.flying_module, facts.symbol
    facts.actors = [flat.components[i] for i in (module.dm, module.ac, module.sc)]
    scope = module.scope.topics
    verify = symbol.verify
    roots = (symbol.safe, symbol.ttf, symbol.safer, *verify.lemmas, *verify.progress)
    wanted = {scope[t] for t in topic_reads(*roots)}
    assert facts.sc.node is not None
    wanted |= {facts.sc.scope.topics[t] for t in topic_reads(*facts.sc.node.step)}
    changed = True
    while changed:
        changed = False
        for c in flat.components:
            if c in facts.actors or c.role != "node" or c.node is None:
                continue
            if wanted & set(c.writes) and _is_followable(c):
                facts.actors.append(c)
                wanted |= {c.scope.topics[t] for t in topic_reads(*c.node.step)}
                changed = True
    facts.topics = _published_topics(facts.actors)
    for index in facts.topics:
        _require_one_publisher(facts, index)


def _published_topics(actors: list[Component]) -> list[int]:
    return sorted({i for c in actors for i in c.writes})


def _is_followable(c: Component) -> bool:
    """Whether a node is Soter source and publishes one value a step; others may do anything."""
    assert c.node is not None
    return not c.extern and not c.node.bursts and len(modes_in(c.node.step)) < 2


def _require_one_publisher(facts: InductionFacts, index: int) -> None:
    flat = facts.flying
    assert all(c in facts.actors or index not in c.writes for c in flat.components)  # else M004
    assert index not in {d.topic for d in flat.inputs}  # else M011


def modes_of_others(facts: InductionFacts) -> list[str]:
    """The names of other modules whose modes the actors and the module's predicates read."""
    flat, module = facts.flying, facts.flying_module
    asked: list[tuple[Any, Sequence[object]]]
    asked = [(module.scope, (facts.symbol.ttf, facts.symbol.safer))]
    asked += [(c.scope, c.node.step) for c in facts.actors if c.node and c.role != "ac"]
    read = {scope.modules.get(m, module.index) for scope, code in asked for m in modes_in(code)}
    return [flat.modules[i].name for i in sorted(read - {module.index})]


def _has_undeclared_time(facts: InductionFacts, *groups: Iterable[str]) -> bool:
    """Whether the program declares no lateness or no response for some AC or node."""
    for c in facts.actors:
        names = {c.name, c.name.rpartition(".")[2], c.node.name if c.node else c.name}
        if c.role in ("ac", "node") and any(names.isdisjoint(word) for word in groups):
            return True
    return False


def _check_times(facts: InductionFacts) -> None:
    verify = facts.symbol.verify
    declared = [verify.late_dm, verify.late_sc, verify.response_dm, verify.response_sc]
    facts.undeclared = any(e is None for e in declared)
    for expr in (*declared, *verify.late_of.values(), *verify.response_of.values()):
        if declared_ns(facts.flying_module, expr):
            raise NotRecheckedError("steps that are late, or take time: not rechecked yet")
    if any(c.wcet_ns is not None for c in facts.flying.components):
        raise NotRecheckedError("declared execution times: not rechecked yet beside an induction")
    late = any(c.jitter_ns for c in facts.flying.components)
    if late and (who := first_delayed_in_thread(facts.flying, facts.actors)):
        raise NotRecheckedError(f"releases that are late (`jitter`), and with them `{who}`")
    if any(c.takes_ns is not None for c in facts.actors):
        raise NotRecheckedError("steps that are late, or take time: not rechecked yet")
    facts.undeclared |= _has_undeclared_time(facts, verify.late_of, verify.response_of)


# ---------------------------------------------------------------- the certificate


def _leave_out_nodes(facts: InductionFacts, followed: object) -> None:
    """Leaves out the nodes beside the module that a certificate does not follow (`followed`).

    Their topics may then hold any value of their sets at any time: more executions are shown safe.
    """
    if not isinstance(followed, dict):
        raise RejectedError("`clocks` are not as they should be")
    facts.actors = [c for c in facts.actors if c.role != "node" or c.name in followed]
    facts.topics = _published_topics(facts.actors)


def compare_entry(facts: InductionFacts, induction: Any) -> tuple[int, int]:  # noqa: ANN401 - any JSON
    """(k, hyperperiods of P2b) of an entry; raises RejectedError if the program differs."""
    names = ("k", "returns", "hyperperiod_ns", "lemmas", "progress", "latching", "clocks")
    if not isinstance(induction, dict) or set(induction) != set(names):
        raise RejectedError("`induction` is not as it should be")
    verify = facts.symbol.verify
    for name, stated in (("lemmas", verify.lemmas), ("progress", verify.progress)):
        if induction[name] != [e.span.text_on_one_line for e in stated]:
            raise RejectedError(f"`{name}`: the program says something else")
    if type(induction["latching"]) is not bool:
        raise RejectedError("`latching` is no truth")
    facts.latching = induction["latching"]
    _leave_out_nodes(facts, induction["clocks"])
    clocks = {c.name: [c.period_ns, c.phase_ns, 0, 0] for c in facts.actors}
    if induction["clocks"] != clocks:
        raise RejectedError("the nodes, or their times, are others in the program")
    if induction["hyperperiod_ns"] != facts.hyperperiod:
        raise RejectedError(f"the hyperperiod is {facts.hyperperiod} ns by the program")
    for key in ("k", "returns"):
        if type(induction[key]) is not int or not 0 <= induction[key] <= 64:
            raise RejectedError(f"`{key}` of the induction is no number of hyperperiods")
    return induction["k"], induction["returns"]


Term = Any
State = dict[Any, Term]
"""The state between two steps: by index under "topic", "stamp" (absolute times), "locals", "had"
and "latched"; "mode"; and "faulted": whether some step did."""


@dataclass(frozen=True)
class Instant:
    """An instant's end: its time, whether all holds, and whether `safe` holds until the next."""

    at: int
    holds: Term
    always: Term


@dataclass(frozen=True)
class Decision:
    """A step of the DM: if it is its turn, whether SC keeps control, or AC gets or keeps it."""

    at: int
    turn: Term
    stays: Term
    gets: Term
    keeps: Term


def actors_due(
    facts: InductionFacts, end: int, *, first: bool = False
) -> dict[int, list[Component]]:
    """Maps each time before `end` ns to the actors due then; with `first`, from their phases."""
    components_by_time: dict[int, list[Component]] = {}
    for c in facts.actors:
        for at in range(c.phase_ns if first else c.phase_ns % c.period_ns, end, c.period_ns):
            components_by_time.setdefault(at, []).append(c)
    return components_by_time


class TransitionSystem:
    """Runs the instants in [begin, end), from initial values if `first`, else from any state."""

    def __init__(
        self, facts: InductionFacts, *, first: bool, fresh: bool = False, begin: int = 0
    ) -> None:
        self.facts = facts
        self.first, self.begin = first, begin
        self.fresh = fresh
        """The DM's reads are fresh and the gate has nothing against AC."""
        self.tolerant = facts.latching and not fresh
        """Whether a fault of what is opaque latches its node; else such a fault is a failure."""
        self.constraints: list[Term] = []
        self.instants: list[Instant] = []
        self.decisions: list[Decision] = []
        self.now = self._initial_state()

    def _initial_state(self) -> State:
        facts, flying, known = self.facts, self.facts.flying, self.constraints
        state: State = {"mode": IN_SC if self.first else unknown_value(MODE, "mode", known)}
        state["faulted"] = False
        for i in facts.topics:
            topic = flying.topics[i]
            if self.first:
                state["topic", i] = value_as_terms(topic.type, topic.default, known)
                state["stamp", i] = UNPUBLISHED
                continue
            state["topic", i] = self._any_topic_value(i)
            state["stamp", i] = z3.FreshInt("stamp")
            known.append(state["stamp", i] < self.begin)
        for c in facts.actors:
            state["locals", c.index] = tuple(
                value_as_terms(v.type, x, known)
                if self.first
                else unknown_value(v.type, v.name, known)
                for v, x in (zip(c.node.locals, c.initial, strict=True) if c.node else ())
            )
            free = self.tolerant and not self.first
            state["had", c.index] = False if self.first else z3.FreshBool("had")
            state["latched", c.index] = z3.FreshBool("latched") if free else False
        return state

    def _any_topic_value(self, i: int) -> Term:
        topic = self.facts.flying.topics[i]
        value = unknown_value(topic.type, topic.name, self.constraints)
        self.constraints.append(within_bounds(value, topic.type, topic.bounds))
        return value

    # ------------------------------------------------------------ time

    def run_until(self, end: int) -> None:
        """Runs every instant before `end` (ns); records truths and the decisions of the DM."""
        longest = max(c.period_ns + c.phase_ns for c in self.facts.actors)
        calendar = actors_due(self.facts, end + longest, first=self.first)
        times = sorted(calendar)
        if self.first:
            self._record_time_before_first(times[0])
        for at, following in pairwise(times):
            if self.begin <= at < end:
                self._step_at_instant(at, calendar[at], following)

    def _record_time_before_first(self, first: int) -> None:
        """Records the time before `first` ns as an instant if any other component may step then."""
        others = [c.phase_ns for c in self.facts.flying.components]
        others += [0 for _ in self.facts.flying.inputs]
        if min(others) < first:
            self._record_instant(0, first)

    def _step_at_instant(self, at: int, due: list[Component], following: int) -> None:
        """Lets each due component make a step, in any order, and records the truths after it."""
        raise_if_interrupted()
        turns = []
        for _ in due:
            who = z3.FreshInt("who")
            turns.append(who)
            self.constraints += [who >= 0, who < len(due)]
            after = self._state_after(due[0], at, who == 0)
            for n, c in enumerate(due[1:], 1):
                one = self._state_after(c, at, who == n)
                after = {k: choose(who == n, x, after[k]) for k, x in one.items()}
            self.now = {k: self._with_named_parts(v) for k, v in after.items()}
        if len(turns) > 1:
            self.constraints.append(z3.Distinct(*turns))
        self._record_instant(at, following)

    def _with_named_parts(self, value: Term) -> Term:
        """The parts of a state; constants stand for unknown parts, so that terms stay small."""
        if isinstance(value, tuple):
            return tuple(self._with_named_parts(v) for v in value)
        value = as_term(value) if isinstance(value, Elapsed) else value
        if is_known(value) or z3.is_const(value):
            return value
        constant = z3.FreshConst(value.sort(), "is")
        self.constraints.append(constant == value)
        return constant

    # ------------------------------------------------------------ steps

    def _state_after(self, c: Component, at: int, turn: Term) -> State:
        if c.role == "dm":
            return self._state_after_dm(at, turn)
        if c.role == "ac":
            return self._state_after_ac(c, at, self.now["mode"] == IN_AC)
        return self._state_after_code(c, at, c.role != "sc" or self.now["mode"] == IN_SC)

    def _visible_values(self, c: Component, at: Term, on: Term) -> VisibleValues:
        now, flying = self.now, self.facts.flying

        def topic(i: int) -> Term:
            if ("topic", i) in now:
                return now["topic", i]
            of = flying.topics[i]
            if of.queue_of is None:
                return self._any_topic_value(i)
            return unknown_value(of.type, of.name, self.constraints)

        def age(i: int) -> Term:
            source = flying.topics[i].queue_of
            i = i if source is None else source
            if ("stamp", i) in now:
                return at - now["stamp", i]
            ns = z3.FreshInt("age")
            self.constraints.append(ns >= 0)
            return ns

        index = self.facts.flying_module.index
        return VisibleValues(c.scope, topic, age, now["mode"], index, on, self.constraints)

    def _state_after_dm(self, at: int, turn: Term) -> State:
        dm, symbol, module = self.facts.dm, self.facts.symbol, self.facts.flying_module
        assert symbol.ttf is not None
        assert symbol.safer is not None
        sight = self._visible_values(dm, at, on=True)
        looked_at = maybe_nan(self.facts.flying, module)
        ttf, unsure = SolverReading(sight, looked_at=looked_at).truth_and_fault(symbol.ttf)
        safer, doubtful = SolverReading(sight, looked_at=looked_at).truth_and_fault(symbol.safer)
        limits = [(i, self.facts.flying.topics[i].max_age_ns) for i in module.inputs]
        old = or_of(*(sight.age(i) > limit for i, limit in limits if limit is not None))
        refused, owed = z3.FreshBool("refused"), z3.FreshBool("owed")
        if self.fresh:
            self.constraints += [z3.Not(refused), z3.Not(owed), negation(old)]
        stay = negation(or_of(ttf, unsure, old, refused))
        get = and_of(safer, negation(doubtful), negation(old), negation(owed))
        had = self.now["mode"]
        mode = choose(choose(had == IN_AC, stay, get), IN_AC, IN_SC)
        ways = ((IN_SC, IN_SC), (IN_SC, IN_AC), (IN_AC, IN_AC))
        self.decisions.append(Decision(at, turn, *(and_of(had == a, mode == b) for a, b in ways)))
        return {**self.now, "mode": mode}

    def _state_after_ac(self, c: Component, at: int, on: Term) -> State:
        """The state after a step of AC, which may publish any value of a topic, or none."""
        assert c.node is not None
        after = dict(self.now)
        for symbol in c.node.publishes:
            i = c.scope.topics[symbol]
            _publish(after, i, and_of(on, z3.FreshBool("published")), self._any_topic_value(i), at)
        return after

    def _state_after_code(self, c: Component, at: int, on: Term) -> State:
        """The state after a step of SC or a node, computed from the statements."""
        now, flying, node = self.now, self.facts.flying, c.node
        assert node is not None
        reading = SolverReading(self._visible_values(c, at, on))
        before = now["locals", c.index]
        taken = and_of(on, negation(now["had", c.index]))
        behind, published = reading.run_step(node, before, taken)
        fault, doubt = reading.operations.fault, reading.operations.doubt
        for symbol, (flag, value) in published.items():
            topic = flying.topics[c.scope.topics[symbol]]
            refused = and_of(flag, negation(within_bounds(value, topic.type, topic.bounds)))
            if is_exact(topic.type):
                fault = or_of(fault, refused)
            else:
                doubt = or_of(doubt, refused)
        if any(flying.topics[c.scope.topics[s.topic]].policy == "fault" for s in node.subscribes):
            fault = or_of(fault, z3.FreshBool("lost"))
        latched = now["latched", c.index]
        gone = or_of(latched, fault, doubt) if self.tolerant else False
        after = dict(now)
        after["faulted"] = or_of(now["faulted"], fault, False if self.tolerant else doubt)
        for symbol in node.publishes:
            i = c.scope.topics[symbol]
            flag, value = published.get(symbol, (False, after["topic", i]))
            if i in c.failsafe:
                fallback = value_as_terms(flying.topics[i].type, c.failsafe[i], self.constraints)
                value = choose(gone, fallback, value)
            _publish(after, i, and_of(on, choose(gone, i in c.failsafe, flag)), value, at)
        after["locals", c.index] = choose(gone, before, behind)
        after["had", c.index] = choose(gone, now["had", c.index], on)
        after["latched", c.index] = gone
        return after

    # ------------------------------------------------------------ what holds

    def _record_instant(self, at: int, following: int) -> None:
        symbol, dm = self.facts.symbol, self.facts.dm

        def holds(e: typed.TypedExpr, now: Term) -> Term:
            value, fault = SolverReading(self._visible_values(dm, now, on=True)).truth_and_fault(e)
            return and_of(value, negation(fault))

        safe = holds(symbol.safe, at)
        lemmas = [holds(e, at) for e in symbol.verify.lemmas]
        always = safe
        if any(isinstance(n, typed.AgeRead) for n in parts_of([symbol.safe])):
            later = z3.FreshInt("later")
            self.constraints.append(z3.And(later >= at, later < following))
            always = and_of(safe, holds(symbol.safe, later))
        every = and_of(negation(self.now["faulted"]), safe, *lemmas)
        self.instants.append(Instant(at, every, always))


def _publish(state: State, topic: int, out: Term, value: Term, at: int) -> None:
    state["topic", topic] = choose(out, value, state["topic", topic])
    state["stamp", topic] = choose(out, at, state["stamp", topic])

"""The transition relation of an induction: all that may happen in a span of time, as terms.

Purpose: a `TimeSpan` is the span [0, end) from the start of a run, or from any state. It makes
terms for the effects of all its steps, in every order that their windows allow, and for what is
judged at each instant: whether `safe` and the lemmas hold and no step faulted. There is no state
between steps: what a step reads is the value of the last writer before it, by the order of steps.
Non-goals: proving anything (`prove_or_refute.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core_walks import walk
from soter.language.model.system import queues_of
from soter.language.model.types import BOOL, MODE
from soter.verify.induction.calendar import before, clusters, steps_of
from soter.verify.induction.step_terms import (
    AC,
    NEVER,
    SC,
    ClusterView,
    Evaluation,
    JudgedInstant,
    State,
    StepEffect,
    if_,
)
from soter.workers.solvers import raise_if_interrupted

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import Component
    from soter.language.model.types import Type
    from soter.verify.induction.calendar import CalendarStep, Point
    from soter.verify.induction.problem import InductionProblem
    from soter.verify.induction.solver_terms import SolverTerms, Term


class TimeSpan:
    """The span of time [0, end) in ns, of a run (`first`) or of any hyperperiod from any state.

    `returning` adds what P2b takes for granted: what the DM reads is fresh, the gate has latched no
    fault and waits for no clean output, topics of nodes that hear plants or other modules are
    constant, and modules whose mode `safer` reads are in AC. `stays`: the mode is SC throughout.
    `latching`: a step whose fault depends on something uninterpreted latches its node
    (semantics.md).
    """

    def __init__(
        self,
        problem: InductionProblem,
        terms: SolverTerms,
        end: int,
        *,
        first: bool = False,
        returning: bool = False,
        stays: bool = False,
        latching: bool = False,
    ) -> None:
        self.problem, self.terms, self.end = problem, terms, end
        self.returning, self.stays, self.latching = returning, stays, latching
        self.functions = {f.name: f for f in problem.core.functions}
        self.writers = sorted({t for own in problem.outputs.values() for t in own})
        self.still: dict[int, Term] = {}
        if returning:
            self.still = {i: self._anything(i) for i in problem.heard}
            self.still |= {i: terms.constant(MODE, AC) for i in problem.waited}
        self.aged = any(isinstance(n, core.Fact) for n in _facts(problem.safe))
        self.uninterpreted: dict[str, None] = {}
        self.seen: list[JudgedInstant] = []
        self.done: list[StepEffect] = []
        self.start = self.state = self._initial() if first else self._any()
        steps = steps_of(terms, problem.clocks, end, first=first)
        groups = clusters(steps)
        if first and groups and problem.first_ns < groups[0][0].start.earliest:
            self._see_start()
        next_block = min(c.phase % c.period for c in problem.clocks)
        for k, group in enumerate(groups):
            after = groups[k + 1][0].start.earliest if k + 1 < len(groups) else end + next_block
            Cluster(self, group, after).run()

    # ------------------------------------------------------------ where it begins

    def _initial(self) -> State:
        system, terms = self.problem.system, self.terms
        topics = {
            i: (terms.constant(system.topics[i].type, system.topics[i].default), NEVER)
            for i in self.writers
        }
        local_values = {}
        for c in system.components:
            if c.node is not None:
                for v, value in zip(c.node.locals, c.initial, strict=True):
                    local_values[c.index, v.name] = terms.constant(v.type, value)
        nobody: dict[int, Term] = {c.index: False for c in system.components}
        return State(topics, local_values, SC, dict(nobody), nobody)

    def _any(self) -> State:
        system, terms = self.problem.system, self.terms
        topics = {}
        for i in self.writers:
            stamp = terms.whole(f"stamp {system.topics[i].name}")
            terms.state(stamp < 0)
            topics[i] = (self._anything(i), stamp)
        local_values = {
            (c.index, v.name): terms.fresh(v.type, f"{c.name}.{v.name}")
            for c in system.components
            if c.node is not None
            for v in c.node.locals
        }
        indices = [c.index for c in system.components]
        had = {i: terms.truth("had control") for i in indices}
        latched = {i: terms.truth("latched") if self.latching else False for i in indices}
        mode = SC if self.stays else terms.fresh(MODE, "mode")
        return State(topics, local_values, mode, had, latched)

    def _anything(self, index: int) -> Term:
        topic = self.problem.system.topics[index]
        return self.terms.fresh(topic.type, topic.name, topic.bounds)

    def _see_start(self) -> None:
        view = ClusterView(self, None, 0)
        holds = (True, *self.judged(view))
        self.seen.append(
            JudgedInstant(True, 0, 0, 0, holds, holds[1], self.problem.clocks[0].component)
        )

    # ------------------------------------------------------------ what is judged

    def judged(self, view: ClusterView) -> tuple[Term, ...]:
        """The conditions that `safe` and each lemma hold; one that faults does not hold."""
        problem = self.problem
        return tuple(self.predicate(p, view, fault=False) for p in (problem.safe, *problem.lemmas))

    def predicate(self, p: core.Predicate, view: ClusterView, *, fault: bool) -> Term:
        """The condition that a predicate holds; `fault`: its value where it faults."""
        evaluation = Evaluation(self.terms, self.functions, view)
        evaluation.run(p.body)
        value = evaluation.expr(p.value)
        self.uninterpreted |= evaluation.uninterpreted
        terms = self.terms
        faults = terms.any_of(evaluation.fault, evaluation.doubt)
        return terms.any_of(value, faults) if fault else terms.all_of(value, terms.negated(faults))


class Cluster:
    """Steps whose windows overlap; the effect of each is a term of what those before it did."""

    def __init__(self, of: TimeSpan, steps: list[CalendarStep], after: int) -> None:
        self.of, self.terms, self.steps, self.after = of, of.terms, steps, after
        self.done = [self._announced(s) for s in steps]
        self.locals = dict(of.state.locals)
        self.had, self.latched = dict(of.state.had), dict(of.state.latched)

    def run(self) -> None:
        """Defines each step's effects, judges the instants, and makes the state behind them."""
        raise_if_interrupted()
        for done in self.done:
            self._define(done)
        self._see()
        of, terms = self.of, self.terms
        topics = {}
        for index, old in of.state.topics.items():
            value, stamp = self.last(index, old, None, None)
            topic = of.problem.system.topics[index]
            topics[index] = (
                terms.defined(value, topic.type, topic.name),
                terms.named(stamp, "stamp"),
            )
        mode = terms.named(self.mode(of.state.mode, None, None), "mode")
        of.state = State(topics, self.locals, mode, self.had, self.latched)
        of.done += self.done

    # ------------------------------------------------------------ who came before

    def last(
        self, index: int, old: tuple[Term, Term], point: Point | None, own: CalendarStep | None
    ) -> tuple[Term, Term]:
        """Value and stamp of a topic at a point, after step `own`; None: at the cluster's end."""
        publications = [
            (d, here, *d.published[index])
            for d in self.done
            if index in d.published and (here := self._there(d, point, own)) is not False
        ]
        t = self.of.problem.system.topics[index].type
        value, stamp = old
        terms = self.terms
        counted = [(d, terms.all_of(here, said), new) for d, here, said, new in publications]
        for d, counts, new in counted:
            later = [
                terms.all_of(other, before(terms, d.step.effect, e.step.effect))
                for e, other, _ in counted
                if e is not d
            ]
            is_last = terms.all_of(counts, terms.negated(terms.any_of(*later)))
            value = terms.chosen(is_last, new, value, t)
            stamp = if_(terms, is_last, d.step.effect.at, stamp)
        return value, stamp

    def mode(self, old: Term, point: Point | None, own: CalendarStep | None) -> Term:
        """The mode after the last decision before a point, or at the cluster's end (None)."""
        mode = old
        for d in self.done:  # decisions of one DM are in order
            if d.mode is not None:
                here = self._there(d, point, own)
                mode = if_(self.terms, here, d.mode, mode)
        return mode

    def _there(self, d: StepEffect, point: Point | None, own: CalendarStep | None) -> Term:
        """The condition that a step's effect is seen at a point."""
        if point is None or d.step is own:
            return True
        return before(self.terms, d.step.effect, point)

    # ------------------------------------------------------------ what a step does

    def _announced(self, step: CalendarStep) -> StepEffect:
        """A step with unknowns for its effects: readers may come before it is defined."""
        of, terms = self.of, self.terms
        component = of.problem.system.components[step.component]
        done = StepEffect(step)
        if component.role == "dm":
            inside = of.stays and step.effect.latest < of.end
            done.mode = SC if inside else terms.fresh(MODE, "mode")
            if of.stays and not inside:
                still = step.effect.at >= of.end
                terms.state(terms.any_of(still, done.mode == SC))
            return done
        for index in of.problem.outputs[step.component]:
            topic = of.problem.system.topics[index]
            value = terms.fresh(topic.type, topic.name, topic.bounds)
            done.published[index] = (terms.truth(f"{topic.name} said"), value)
        return done

    def _define(self, done: StepEffect) -> None:
        component = self.of.problem.system.components[done.step.component]
        if done.step.begun:
            self._havoc_locals(component.index)
        elif component.role == "dm":
            self._decide(done)
        elif component.role == "ac":
            self._gate(done, dict.fromkeys(done.published, True))
        else:
            self._compute(done)

    def _decide(self, done: StepEffect) -> None:
        of, terms = self.of, self.terms
        step, problem = done.step, of.problem
        view = ClusterView(of, self, step.start.at, step.start)
        decision = problem.core.decisions[problem.module.index]
        ttf = of.predicate(decision.ttf, view, fault=True)
        safer = of.predicate(decision.safer, view, fault=False)
        stale = terms.any_of(
            *[
                step.start.at - view.stamp(i) > limit
                for i in problem.module.inputs
                if (limit := problem.system.topics[i].max_age_ns) is not None
            ]
        )
        gate_fault, clean = terms.truth("gate fault"), terms.truth("clean")
        if of.returning:
            terms.state(terms.all_of(terms.negated(gate_fault), clean, terms.negated(stale)))
        leaves = terms.any_of(ttf, stale, gate_fault)
        enters = terms.all_of(safer, terms.negated(stale), clean)
        done.before = view.mode()
        from_ac = if_(terms, leaves, SC, AC)
        from_sc = if_(terms, enters, AC, SC)
        terms.state(done.mode == if_(terms, done.before == AC, from_ac, from_sc))

    def _compute(self, done: StepEffect) -> None:
        """Defines the effects of a step of SC or a node by its Core, from what it reads."""
        of, terms = self.of, self.terms
        step, system = done.step, of.problem.system
        component = system.components[step.component]
        code = of.problem.core.nodes[component.index]
        enabled = self._enabled(done, step.start)
        view = ClusterView(of, self, step.start.at, step.start, enabled=enabled)
        evaluation = Evaluation(terms, of.functions, view)
        for copy in code.locals:
            evaluation.bind(copy.name, copy.type, self.locals[component.index, copy.cell.name])
        if code.takeover:
            takes = terms.all_of(enabled, terms.negated(self.had[component.index]))
            evaluation.branch(takes, lambda: evaluation.run(code.takeover), lambda: None)
        evaluation.run(code.body)
        of.uninterpreted |= evaluation.uninterpreted
        fault, doubt = evaluation.fault, evaluation.doubt
        said, values = {}, {}
        for k, output in enumerate(code.outputs):
            flag, value, t = evaluation.frame.outputs.get(k, (False, None, output.type))
            said[output.topic] = flag
            if flag is False:
                continue
            passes = terms.may_publish(value, t, output.bounds)
            refused = terms.all_of(flag, terms.negated(passes))
            if terms.is_opaque(passes):
                doubt = terms.any_of(doubt, refused)
            else:
                fault = terms.any_of(fault, refused)
            values[output.topic] = (value, t, terms.all_of(flag, passes))
        for q in queues_of(system, component):
            if system.topics[q].policy == "fault":
                fault = terms.any_of(fault, terms.truth("queue lost a value"))
        done.fault, done.doubt = terms.named(fault, "fault"), terms.named(doubt, "doubt")
        runs = self._latch(component, done) if of.latching else True
        for index, (value, t, passed) in values.items():
            self._equal(done.published[index][1], value, t, terms.all_of(passed, runs))
        for copy in code.locals:
            key = component.index, copy.cell.name
            after = evaluation.frame.variables[copy.name]
            value = terms.chosen(runs, after, self.locals[key], copy.type)
            self.locals[key] = terms.defined(value, copy.type, copy.name)
        if code.takeover:
            had = terms.chosen(runs, enabled, self.had[component.index], BOOL)
            self.had[component.index] = terms.named(had, "had control")
        if runs is not True:
            said = self._failsafe(component, done, runs, said)
        self._gate(done, said)

    def _latch(self, component: Component, done: StepEffect) -> Term:
        """The condition that the step runs to its end: a node that has faulted does nothing."""
        terms = self.terms
        bad = terms.any_of(self.latched[component.index], done.fault, done.doubt)
        self.latched[component.index] = bad = terms.named(bad, "latched")
        return terms.negated(bad)

    def _failsafe(
        self, component: Component, done: StepEffect, runs: Term, said: Mapping[int, Term]
    ) -> dict[int, Term]:
        """Which topics a step wants to publish; where its node is latched, its fail-safe values."""
        terms, condition_by_topic = self.terms, {}
        for index, wanted in said.items():
            falls_back = index in component.failsafe
            if falls_back:
                t = self.of.problem.system.topics[index].type
                value = terms.constant(t, component.failsafe[index])
                self._equal(done.published[index][1], value, t, terms.negated(runs))
            condition_by_topic[index] = terms.chosen(runs, wanted, falls_back, BOOL)
        return condition_by_topic

    def _gate(self, done: StepEffect, said: Mapping[int, Term]) -> None:
        """States when publications pass the gate: if in control all along surely, but for AC's."""
        terms = self.terms
        component = self.of.problem.system.components[done.step.component]
        starts = self._enabled(done, done.step.start)
        ends = starts
        if done.step.effect is not done.step.start:
            ends = self._enabled(done, done.step.effect)
        free = component.role == "ac"
        for index, (flag, _) in done.published.items():
            wanted = said[index]
            terms.state(terms.z3.Implies(flag, terms.all_of(wanted, terms.any_of(starts, ends))))
            if not free:
                terms.state(terms.z3.Implies(terms.all_of(wanted, starts, ends), flag))

    def _enabled(self, done: StepEffect, point: Point) -> Term:
        """The condition that the step's component is in control at a point; nodes always are."""
        component = self.of.problem.system.components[done.step.component]
        if component.role == "node":
            return True
        wanted = AC if component.role == "ac" else SC
        return ClusterView(self.of, self, point.at, point).mode() == wanted

    def _equal(self, name: Term, value: Term, t: Type, where: Term) -> None:
        terms = self.terms
        for a, b in zip(terms.flat(name, t), terms.flat(value, t), strict=True):
            terms.state(terms.z3.Implies(where, a == b))

    def _havoc_locals(self, component: int) -> None:
        self.had[component] = self.terms.truth("had control")
        if self.of.latching:
            self.latched[component] = self.terms.truth("latched")
        node = self.of.problem.system.components[component].node
        for v in node.locals if node is not None else ():
            self.locals[component, v.name] = self.terms.fresh(v.type, v.name)

    # ------------------------------------------------------------ what is seen

    def _see(self) -> None:
        """Judges each instant at which a step had effect, after the last effect of the instant."""
        every = [d.step.effect for d in self.done] + [d.step.start for d in self.done]
        points = dict.fromkeys(every)  # in their order: a query is the same in every run
        if len({(p.earliest, p.latest) for p in points}) == 1 and isinstance(
            self.done[0].step.effect.at, int
        ):
            self._see_at(self.done[-1], None, True)
            return
        for d in self.done:
            if d.step.begun:
                continue  # it may have been over before: then there is no such instant
            here = d.step.effect
            over = [
                self.terms.negated(self.terms.all_of(p.at == here.at, before(self.terms, here, p)))
                for p in points
                if p is not here and p.earliest <= here.latest and here.earliest <= p.latest
            ]
            self._see_at(d, here, self.terms.all_of(*over))

    def _see_at(self, d: StepEffect, point: Point | None, counts: Term) -> None:
        of, terms = self.of, self.terms
        at = d.step.effect
        holds = of.judged(ClusterView(of, self, at.at, point, d.step))
        holds = tuple(terms.named(h, "holds") for h in holds)
        later = holds[0]
        if of.aged:
            now = terms.whole("now")
            still = [
                terms.any_of(before(terms, e.step.effect, at), e.step.effect.at > now)
                for e in self.done
                if e is not d and point is not None
            ]
            terms.state(terms.all_of(now >= at.at, now < max(self.after, at.latest + 1)))
            view = ClusterView(of, self, now, point, d.step)
            holds_then = of.predicate(of.problem.safe, view, fault=False)
            later = terms.any_of(terms.negated(terms.all_of(*still)), holds_then)
        over = self.done if point is None else [d]
        faults = [e.fault if of.latching else terms.any_of(e.fault, e.doubt) for e in over]
        no_fault = terms.negated(terms.any_of(*faults))
        granted: Term = True
        if of.returning:
            view = ClusterView(of, self, at.at, point, d.step)
            asked = of.problem.progress
            granted = terms.all_of(*[of.predicate(p, view, fault=False) for p in asked])
        every = (no_fault, *holds)
        who = d.step.component
        of.seen.append(
            JudgedInstant(
                counts, at.earliest, at.latest, at.at, every, later, component=who, granted=granted
            )
        )


def _facts(p: core.Predicate) -> list[object]:
    return [
        n
        for n in walk((*p.body, core.Let(p.span, "value", p.value)))
        if isinstance(n, core.Fact) and n.fact in ("age", "time")
    ]

"""Makes the transition relation of an induction: terms for all runs of a span of time.

Purpose: a `TimeSpan` is the span [0, end) from the start of a run, or from any state. It makes
terms for the effects of all its steps, in every order that their windows allow (`calendar.py`), and
for the claims at each instant: that `safe` and the lemmas hold and no step faulted. A `Cluster`
does so for steps whose windows overlap. There is no state between the steps of a cluster: a step
reads the value of the last writer before it, by the order of steps.
Non-goals: the Core of one step (`step_terms.py`); proving anything (`prove_or_refute.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core_walks import walk
from soter.language.model.system import queues_read_by
from soter.language.model.types import BOOL, MODE
from soter.verify.induction.calendar import calendar_steps, groups_apart_in_time, is_before
from soter.verify.induction.step_terms import (
    AC,
    NEVER,
    SC,
    ClusterView,
    Evaluation,
    JudgedInstant,
    State,
    StepEffect,
    integer_if,
)
from soter.workers.interruptible_solver import raise_if_interrupted

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import Component
    from soter.language.model.types import Type
    from soter.verify.induction.calendar import CalendarStep, Point
    from soter.verify.induction.problem import InductionProblem
    from soter.verify.induction.solver_terms import SolverTerms, Term


class TimeSpan:
    """A span [0, end) in ns, at the start of a run (`first`) or in any hyperperiod, any state.

    `returning` adds the assumptions of P2b: the DM's reads are fresh, the gate has latched no fault
    and waits for no clean output, topics of nodes that hear plants or other modules are constant,
    and modules whose mode `safer` reads are in AC. `stays` keeps the mode SC. With `latching` a
    step whose fault depends on something uninterpreted latches its node (semantics.md).
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
        self.writers = sorted({t for topics in problem.outputs.values() for t in topics})
        self.constant_topics: dict[int, Term] = {}
        if returning:
            self.constant_topics = {i: self._any_value(i) for i in problem.heard}
            self.constant_topics |= {i: terms.constant(MODE, AC) for i in problem.waited}
        safe = problem.safe
        self.reads_ages = any(
            isinstance(n, core.Fact) and n.fact in ("age", "time")
            for n in walk((*safe.body, core.Let(safe.span, "value", safe.value)))
        )
        self.uninterpreted: dict[str, None] = {}
        self.judged: list[JudgedInstant] = []
        self.effects: list[StepEffect] = []
        self.start = self.state = self._initial_state() if first else self._any_state()
        steps = calendar_steps(terms, problem.clocks, end, first=first)
        groups = groups_apart_in_time(steps)
        if first and groups and problem.first_ns < groups[0][0].start.earliest:
            self._judge_start()
        next_block = min(c.phase % c.period for c in problem.clocks)
        for k, group in enumerate(groups):
            after = groups[k + 1][0].start.earliest if k + 1 < len(groups) else end + next_block
            Cluster(self, group, after).define_effects()

    def _initial_state(self) -> State:
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

    def _any_state(self) -> State:
        system, terms = self.problem.system, self.terms
        topics = {}
        for i in self.writers:
            stamp = terms.unknown_int(f"stamp {system.topics[i].name}")
            terms.state(stamp < 0)
            topics[i] = (self._any_value(i), stamp)
        local_values = {
            (c.index, v.name): terms.unknown(v.type, f"{c.name}.{v.name}")
            for c in system.components
            if c.node is not None
            for v in c.node.locals
        }
        indices = [c.index for c in system.components]
        had_control = {i: terms.unknown_bool("had control") for i in indices}
        latched = {i: terms.unknown_bool("latched") if self.latching else False for i in indices}
        mode = SC if self.stays else terms.unknown(MODE, "mode")
        return State(topics, local_values, mode, had_control, latched)

    def _any_value(self, index: int) -> Term:
        topic = self.problem.system.topics[index]
        return self.terms.unknown(topic.type, topic.name, topic.bounds)

    def _judge_start(self) -> None:
        view = ClusterView(self, None, 0)
        holds = (True, *self.claim_conditions(view))
        self.judged.append(
            JudgedInstant(True, 0, 0, 0, holds, holds[1], self.problem.clocks[0].component)
        )

    def claim_conditions(self, view: ClusterView) -> tuple[Term, ...]:
        """The conditions that `safe` and each lemma hold; a predicate that faults is false."""
        problem = self.problem
        return tuple(
            self.condition_of(p, view, fault=False) for p in (problem.safe, *problem.lemmas)
        )

    def condition_of(self, p: core.Predicate, view: ClusterView, *, fault: bool) -> Term:
        """The condition that a predicate holds; `fault` is the value if the predicate faults."""
        evaluation = Evaluation(self.terms, self.functions, view)
        evaluation.run(p.body)
        value = evaluation.expr(p.value)
        self.uninterpreted |= evaluation.uninterpreted
        terms = self.terms
        faults = terms.any_of(evaluation.fault, evaluation.doubt)
        return terms.any_of(value, faults) if fault else terms.all_of(value, terms.negated(faults))


class Cluster:
    """Steps whose windows overlap; each effect is a term that depends on earlier effects.

    `after` is the earliest time in ns at which a step after the cluster may start.
    """

    def __init__(self, span: TimeSpan, steps: list[CalendarStep], after: int) -> None:
        self.span, self.terms, self.steps, self.after = span, span.terms, steps, after
        self.effects = [self._unknown_effect(s) for s in steps]
        self.locals = dict(span.state.locals)
        self.had_control, self.latched = dict(span.state.had_control), dict(span.state.latched)

    def define_effects(self) -> None:
        """Defines the effects of all steps, judges the claims, and makes the state afterwards."""
        raise_if_interrupted()
        for effect in self.effects:
            self._define_effect(effect)
        self._judge_instants()
        span, terms = self.span, self.terms
        topics = {}
        for index, old in span.state.topics.items():
            value, stamp = self.topic_at(index, old, None, None)
            topic = span.problem.system.topics[index]
            topics[index] = (
                terms.named_value(value, topic.type, topic.name),
                terms.new_constant_for(stamp, "stamp"),
            )
        mode = terms.new_constant_for(self.mode_at(span.state.mode, None, None), "mode")
        span.state = State(topics, self.locals, mode, self.had_control, self.latched)
        span.effects += self.effects

    def topic_at(
        self, index: int, old: tuple[Term, Term], point: Point | None, own_step: CalendarStep | None
    ) -> tuple[Term, Term]:
        """The value and stamp of a topic at a point, or at the end if None, as `own_step` reads."""
        terms = self.terms
        topic_type = self.span.problem.system.topics[index].type
        seen = [
            (effect, is_seen, *effect.published[index])
            for effect in self.effects
            if index in effect.published
            and (is_seen := self._is_effect_seen_at(effect, point, own_step)) is not False
        ]
        publications = [
            (effect.step.effect, terms.all_of(is_seen, published), new)
            for effect, is_seen, published, new in seen
        ]
        value, stamp = old
        for place, counts, new in publications:
            later = [
                terms.all_of(other_counts, is_before(terms, place, other))
                for other, other_counts, _ in publications
                if other is not place
            ]
            is_last = terms.all_of(counts, terms.negated(terms.any_of(*later)))
            value = terms.choice(is_last, new, value, topic_type)
            stamp = integer_if(terms, is_last, place.at, stamp)
        return value, stamp

    def mode_at(self, old: Term, point: Point | None, own_step: CalendarStep | None) -> Term:
        """The mode after the last decision before a point, or at the cluster's end (None)."""
        mode = old
        for effect in self.effects:  # decisions of one DM are in order
            if effect.mode is not None:
                is_seen = self._is_effect_seen_at(effect, point, own_step)
                mode = integer_if(self.terms, is_seen, effect.mode, mode)
        return mode

    def _is_effect_seen_at(
        self, effect: StepEffect, point: Point | None, own_step: CalendarStep | None
    ) -> Term:
        """The condition that an effect is seen at a point; `own_step` sees its effect at once."""
        if point is None or effect.step is own_step:
            return True
        return is_before(self.terms, effect.step.effect, point)

    def _unknown_effect(self, step: CalendarStep) -> StepEffect:
        """An effect of unknown terms, which other steps may read before the effect is defined."""
        span, terms = self.span, self.terms
        component = span.problem.system.components[step.component]
        effect = StepEffect(step)
        if component.role == "dm":
            inside = span.stays and step.effect.latest < span.end
            effect.mode = SC if inside else terms.unknown(MODE, "mode")
            if span.stays and not inside:
                is_after_end = step.effect.at >= span.end
                terms.state(terms.any_of(is_after_end, effect.mode == SC))
            return effect
        for index in span.problem.outputs[step.component]:
            topic = span.problem.system.topics[index]
            value = terms.unknown(topic.type, topic.name, topic.bounds)
            effect.published[index] = (terms.unknown_bool(f"{topic.name} said"), value)
        return effect

    def _define_effect(self, effect: StepEffect) -> None:
        """Adds facts that tie a step's effects to its reads, by the role of the component."""
        component = self.span.problem.system.components[effect.step.component]
        if effect.step.begun:
            self._forget_locals(component.index)
        elif component.role == "dm":
            self._define_mode(effect)
        elif component.role == "ac":
            self._add_gate_facts(effect, dict.fromkeys(effect.published, True))
        else:
            self._define_publications(effect)

    def _define_mode(self, effect: StepEffect) -> None:
        """Adds facts that define the mode after a DM step, from the reads and the mode before."""
        span, terms = self.span, self.terms
        step, problem = effect.step, span.problem
        view = ClusterView(span, self, step.start.at, step.start)
        decision = problem.core.decisions[problem.module.index]
        ttf = span.condition_of(decision.ttf, view, fault=True)
        safer = span.condition_of(decision.safer, view, fault=False)
        stale = terms.any_of(
            *[
                step.start.at - view.stamp(i) > limit
                for i in problem.module.inputs
                if (limit := problem.system.topics[i].max_age_ns) is not None
            ]
        )
        gate_fault, clean = terms.unknown_bool("gate fault"), terms.unknown_bool("clean")
        if span.returning:
            terms.state(terms.all_of(terms.negated(gate_fault), clean, terms.negated(stale)))
        leaves = terms.any_of(ttf, stale, gate_fault)
        enters = terms.all_of(safer, terms.negated(stale), clean)
        effect.before = view.mode()
        from_ac = integer_if(terms, leaves, SC, AC)
        from_sc = integer_if(terms, enters, AC, SC)
        terms.state(effect.mode == integer_if(terms, effect.before == AC, from_ac, from_sc))

    def _define_publications(self, effect: StepEffect) -> None:
        """Adds facts for the publications and faults of a step of SC or of a node, by its Core."""
        span, terms = self.span, self.terms
        step, system = effect.step, span.problem.system
        component = system.components[step.component]
        code = span.problem.core.nodes[component.index]
        enabled = self._has_control_at(effect, step.start)
        view = ClusterView(span, self, step.start.at, step.start, enabled=enabled)
        evaluation = self._evaluation_of_step(component, code, view)
        fault, doubt = evaluation.fault, evaluation.doubt
        wanted, values = {}, {}
        for k, output in enumerate(code.outputs):
            flag, value, t = evaluation.frame.outputs.get(k, (False, None, output.type))
            wanted[output.topic] = flag
            if flag is False:
                continue
            passes = terms.may_publish(value, t, output.bounds)
            refused = terms.all_of(flag, terms.negated(passes))
            if terms.is_opaque(passes):
                doubt = terms.any_of(doubt, refused)
            else:
                fault = terms.any_of(fault, refused)
            values[output.topic] = (value, t, terms.all_of(flag, passes))
        for q in queues_read_by(system, component):
            if system.topics[q].policy == "fault":
                fault = terms.any_of(fault, terms.unknown_bool("queue lost a value"))
        effect.fault = terms.new_constant_for(fault, "fault")
        effect.doubt = terms.new_constant_for(doubt, "doubt")
        runs = self._latch_after_fault(component, effect) if span.latching else True
        for index, (value, t, passed) in values.items():
            self._assert_equal(effect.published[index][1], value, t, terms.all_of(passed, runs))
        self._store_locals(component, code, evaluation, runs)
        if code.takeover:
            had_control = terms.choice(runs, enabled, self.had_control[component.index], BOOL)
            self.had_control[component.index] = terms.new_constant_for(had_control, "had control")
        if runs is not True:
            wanted = self._add_failsafe_facts(component, effect, runs, wanted)
        self._add_gate_facts(effect, wanted)

    def _evaluation_of_step(
        self, component: Component, code: core.NodeStep, view: ClusterView
    ) -> Evaluation:
        """Executes a step's Core, and `on takeover` first if the component takes control."""
        terms, span = self.terms, self.span
        evaluation = Evaluation(terms, span.functions, view)
        for copy in code.locals:
            evaluation.bind(copy.name, copy.type, self.locals[component.index, copy.cell.name])
        if code.takeover:
            takes = terms.all_of(view.enabled, terms.negated(self.had_control[component.index]))
            evaluation.branch(takes, lambda: evaluation.run(code.takeover), lambda: None)
        evaluation.run(code.body)
        span.uninterpreted |= evaluation.uninterpreted
        return evaluation

    def _store_locals(
        self, component: Component, code: core.NodeStep, evaluation: Evaluation, runs: Term
    ) -> None:
        """Stores the locals after a step; they change only under the condition `runs`."""
        terms = self.terms
        for copy in code.locals:
            key = component.index, copy.cell.name
            after = evaluation.frame.variables[copy.name]
            value = terms.choice(runs, after, self.locals[key], copy.type)
            self.locals[key] = terms.named_value(value, copy.type, copy.name)

    def _latch_after_fault(self, component: Component, effect: StepEffect) -> Term:
        """Latches a node that faults; gives the condition that its step runs to the end."""
        terms = self.terms
        bad = terms.any_of(self.latched[component.index], effect.fault, effect.doubt)
        self.latched[component.index] = bad = terms.new_constant_for(bad, "latched")
        return terms.negated(bad)

    def _add_failsafe_facts(
        self, component: Component, effect: StepEffect, runs: Term, wanted: Mapping[int, Term]
    ) -> dict[int, Term]:
        """Adds a latched node's fail-safe values as facts; gives when each topic is published."""
        terms, condition_by_topic = self.terms, {}
        for index, is_wanted in wanted.items():
            falls_back = index in component.failsafe
            if falls_back:
                t = self.span.problem.system.topics[index].type
                value = terms.constant(t, component.failsafe[index])
                self._assert_equal(effect.published[index][1], value, t, terms.negated(runs))
            condition_by_topic[index] = terms.choice(runs, is_wanted, falls_back, BOOL)
        return condition_by_topic

    def _add_gate_facts(self, effect: StepEffect, wanted: Mapping[int, Term]) -> None:
        """Adds facts about which of the `wanted` publications pass the gate.

        A publication passes if the component is in control at the step's start and effect, and may
        pass if it is in control at only one of them; AC may leave out any publication.
        """
        terms = self.terms
        component = self.span.problem.system.components[effect.step.component]
        starts = self._has_control_at(effect, effect.step.start)
        ends = starts
        if effect.step.effect is not effect.step.start:
            ends = self._has_control_at(effect, effect.step.effect)
        for index, (passes, _) in effect.published.items():
            may_pass = terms.all_of(wanted[index], terms.any_of(starts, ends))
            terms.state(terms.z3.Implies(passes, may_pass))
            if component.role != "ac":
                must_pass = terms.all_of(wanted[index], starts, ends)
                terms.state(terms.z3.Implies(must_pass, passes))

    def _has_control_at(self, effect: StepEffect, point: Point) -> Term:
        """The condition that a step's component has control at a point; a node always has it."""
        component = self.span.problem.system.components[effect.step.component]
        if component.role == "node":
            return True
        wanted = AC if component.role == "ac" else SC
        return ClusterView(self.span, self, point.at, point).mode() == wanted

    def _assert_equal(self, name: Term, value: Term, t: Type, where: Term) -> None:
        """Adds the fact that `name` has this value if the condition `where` holds."""
        terms = self.terms
        for a, b in zip(terms.leaves(name, t), terms.leaves(value, t), strict=True):
            terms.state(terms.z3.Implies(where, a == b))

    def _forget_locals(self, component: int) -> None:
        """Makes a component's locals unknown, because its step began earlier with unknown reads."""
        self.had_control[component] = self.terms.unknown_bool("had control")
        if self.span.latching:
            self.latched[component] = self.terms.unknown_bool("latched")
        node = self.span.problem.system.components[component].node
        for v in node.locals if node is not None else ():
            self.locals[component, v.name] = self.terms.unknown(v.type, v.name)

    def _judge_instants(self) -> None:
        """Judges the claims at each instant of an effect, after the last effect of the instant."""
        steps = [e.step for e in self.effects]
        # ordered, so that a query is the same in every run of Soter
        points = dict.fromkeys([*(s.effect for s in steps), *(s.start for s in steps)])
        if len({(p.earliest, p.latest) for p in points}) == 1 and isinstance(
            self.effects[0].step.effect.at, int
        ):
            self._judge_instant(self.effects[-1], None, True)
            return
        for effect in self.effects:
            if effect.step.begun:
                continue  # its effect may lie before the span
            place = effect.step.effect
            is_last = [
                self.terms.negated(
                    self.terms.all_of(p.at == place.at, is_before(self.terms, place, p))
                )
                for p in points
                if p is not place and p.earliest <= place.latest and place.earliest <= p.latest
            ]
            self._judge_instant(effect, place, self.terms.all_of(*is_last))

    def _judge_instant(self, effect: StepEffect, point: Point | None, counts: Term) -> None:
        """Adds the claims after one effect; if `point` is None, after all effects of a cluster."""
        span, terms, step = self.span, self.terms, effect.step
        at = step.effect
        holds = span.claim_conditions(ClusterView(span, self, at.at, point, step))
        holds = tuple(terms.new_constant_for(h, "holds") for h in holds)
        later = self._holds_until_next(effect, point) if span.reads_ages else holds[0]
        over = self.effects if point is None else [effect]
        faults = [e.fault if span.latching else terms.any_of(e.fault, e.doubt) for e in over]
        no_fault = terms.negated(terms.any_of(*faults))
        progress: Term = True
        if span.returning:
            view = ClusterView(span, self, at.at, point, step)
            conditions = span.problem.progress
            progress = terms.all_of(*[span.condition_of(p, view, fault=False) for p in conditions])
        span.judged.append(
            JudgedInstant(
                counts=counts,
                earliest=at.earliest,
                latest=at.latest,
                at=at.at,
                holds=(no_fault, *holds),
                later=later,
                component=step.component,
                progress=progress,
            )
        )

    def _holds_until_next(self, effect: StepEffect, point: Point | None) -> Term:
        """The condition that `safe` holds at all times from an effect until the next effect."""
        span, terms, at = self.span, self.terms, effect.step.effect
        now = terms.unknown_int("now")
        still = [
            terms.any_of(is_before(terms, e.step.effect, at), e.step.effect.at > now)
            for e in self.effects
            if e is not effect and point is not None
        ]
        terms.state(terms.all_of(now >= at.at, now < max(self.after, at.latest + 1)))
        view = ClusterView(span, self, now, point, effect.step)
        holds = span.condition_of(span.problem.safe, view, fault=False)
        return terms.any_of(terms.negated(terms.all_of(*still)), holds)

"""The data that each step of a tested system may read and write: which steps may not be swapped.

Purpose: `Footprints` computes the resources of every actor's step and of every property, for
`exploration_plan.py`; `may_fault` says which steps may fault, `is_sampled` whether a test tries
only some values of a continuum.
Non-goals: calendars and the plan (`exploration_plan.py`).

A step reads and writes *resources*: topics, stamps, queues
(publishing pushes: a write; their subscriber reads and empties them), node locals, plant states,
the latch and `had_control` of a component, and of every module its mode (with OE of AC and SC) and
its gate (`gate_fault`, `clean_needed`). Two steps are dependent iff one of them may write what the
other may read or write. All of it is what *may* happen: a gated controller counts as writing its
outputs, a fail-safe value as published, a read on a branch that is never taken as read. Time is no
resource: where it matters (`ExplorationPlan.timely`) a search must not swap steps across a change
of time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core_walks import walk
from soter.language.model.types import FloatType, IntType, leaves

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.system import Component, InputDrive, Property, System

    Label = tuple[str, int] | tuple[str, int, str]
    """A piece of a configuration: kind, index, name."""


TIME: Label = ("time", 0)
"""The time: no step writes it as a resource, but every step may move it on."""


@dataclass
class Effects:
    """The resources that a step may read and write; `timed`: whether the step reads the time.

    `keeps`: whether the step may leave `writes` unchanged, so that their old values matter.
    """

    reads: set[Label] = field(default_factory=set)
    writes: set[Label] = field(default_factory=set)
    timed: bool = False
    keeps: bool = False

    def conflicts_with(self, other: Effects) -> bool:
        """Whether a step with these effects may not be swapped with a step of the others."""
        return bool(
            self.writes & (other.reads | other.writes) or other.writes & (self.reads | self.writes)
        )


class Footprints:
    """Computes the effects of every step of a system."""

    def __init__(self, system: System, lowered: core.CoreSystem) -> None:
        self.system = system
        self.core = lowered
        self.facts = [
            n for root in _impure_code(lowered) for n in walk(root) if isinstance(n, core.Fact)
        ]
        """Every read of a fact, such as the time or an age, in the code that runs."""

    def output_topics(self, component: int | None, drive: int | None) -> tuple[int, ...]:
        """The topics that an actor publishes, in the order of its step's outputs."""
        if drive is not None:
            return (self.system.inputs[drive].topic,)
        assert component is not None
        step = self.core.nodes.get(component) or self.core.plants.get(component)
        return tuple(o.topic for o in step.outputs) if step else ()

    def actor_effects(self, component: int | None, drive: int | None) -> Effects:
        """The resources that the steps of an actor may read and write."""
        effects = Effects()
        outputs = set(self.output_topics(component, drive))
        if component is not None:
            acting = self.system.components[component]
            outputs |= set(acting.failsafe)
            self._add_step_effects(acting, effects)
        for topic in outputs:
            effects.writes |= {("topic", topic), ("stamp", topic)}
            for queue in self.system.topics[topic].queues:
                effects.reads |= {("topic", queue), ("stamp", queue)}
                effects.writes |= {("topic", queue), ("stamp", queue)}
        return effects

    def _add_control_effects(self, role: str, module: int, effects: Effects) -> None:
        effects.reads.add(("mode", module))
        if role == "ac":
            effects.reads.add(("gate", module))
            effects.writes.add(("gate", module))

    def _add_step_effects(self, component: Component, effects: Effects) -> None:
        if component.role == "dm":
            assert component.module is not None
            self._add_decision_effects(component.module, effects)
        step = self.core.nodes.get(component.index) or self.core.plants.get(component.index)
        if step is not None:
            self._add_footprint(step.footprint, effects)
            effects.writes |= set(map(_cell_label, step.footprint.writes))
            effects.timed |= _reads_time(_step_code(step))
            effects.reads |= {("latched", component.index), ("control", component.index)}
            effects.writes |= {("latched", component.index), ("control", component.index)}
        effects.keeps |= component.node is not None
        if isinstance(step, core.PlantStep):
            effects.timed |= _holds_disturbances(step)
        if component.plant is not None:
            effects.reads |= {
                ("topic", component.scope.topics[topic]) for topic in component.plant.reads
            }
        if component.role in {"ac", "sc"} and component.module is not None:
            self._add_control_effects(component.role, component.module, effects)
        for topic in self.system.topics:
            if topic.queue_of is not None and _owns_queue(component, topic.name):
                effects.reads |= {("topic", topic.index), ("stamp", topic.index)}
                effects.writes |= {("topic", topic.index), ("stamp", topic.index)}
        for prop, predicate in zip(self.system.properties, self.core.properties, strict=True):
            if prop.component == component.index:
                self._add_predicate(predicate, effects)

    def _add_predicate(self, predicate: core.Predicate, effects: Effects) -> None:
        self._add_footprint(predicate.footprint, effects)
        effects.timed |= _reads_time((*predicate.body, predicate.value))

    def _add_footprint(self, footprint: core.Footprint, effects: Effects) -> None:
        effects.reads |= {_cell_label(c) for c in footprint.reads}
        effects.reads |= {("mode", m) for m in footprint.modes}
        effects.reads |= {("stamp", t) for t in footprint.stamps}

    def _add_decision_effects(self, module: int, effects: Effects) -> None:
        """Adds the effects of a DM: it reads its topics, may change mode, both OE, and the gate."""
        decision, m = self.core.decisions[module], self.system.modules[module]
        effects.keeps = True
        self._add_predicate(decision.ttf, effects)
        self._add_predicate(decision.safer, effects)
        effects.reads |= {("topic", topic) for topic in m.inputs}
        effects.reads |= {
            ("stamp", topic) for topic in m.inputs if self._max_age_ns(topic) is not None
        }
        for kind in ("mode", "gate"):
            effects.reads.add((kind, module))
            effects.writes.add((kind, module))
        if m.looked is not None:
            effects.writes |= {("topic", m.looked), ("stamp", m.looked)}
        for topic in (m.latch, m.acknowledgement):
            if topic is not None:
                effects.reads |= {("topic", topic), ("stamp", topic)}
        if m.plan is not None:
            effects.reads.add(("topic", m.plan))
            effects.writes.add(("topic", m.plan))
        if m.latch is not None:
            effects.writes |= {("topic", m.latch), ("stamp", m.latch)}

    def _max_age_ns(self, topic: int) -> int | None:
        return self.system.topics[topic].max_age_ns

    # ------------------------------------------------------------ properties

    def property_reads(self, index: int) -> set[Label]:
        """The resources that a property reads; none for a contract, as its node's step reads it."""
        if _is_contract(self.system.properties[index]):
            return set()
        effects = Effects()
        self._add_predicate(self.core.properties[index], effects)
        return effects.reads | ({TIME} if effects.timed else set())

    def timed_property_reads(self, index: int) -> set[Label]:
        """The resources that a timed property reads, and those by which an invariant changes."""
        assert self.system.test is not None
        effects = Effects()
        timed = self.core.timed[index]
        for predicate in (timed.premise, timed.condition):
            if predicate is not None:
                self._add_predicate(predicate, effects)
        if effects.timed:
            effects.reads.add(TIME)
        module = self.system.test.timed[index].module
        if module is not None:
            effects.reads |= {("mode", module), ("gate", module)}
            for topic in self.output_topics(self.system.modules[module].sc, None):
                effects.reads.add(("stamp", topic))
        return effects.reads

    def all_property_reads(self) -> set[Label]:
        """The resources that some property of configurations reads."""
        assert self.system.test is not None
        labels: set[Label] = set()
        for p in range(len(self.system.properties)):
            labels |= self.property_reads(p)
        for t in range(len(self.system.test.timed)):
            labels |= self.timed_property_reads(t)
        return labels

    # ------------------------------------------------------------ time

    def time_matters(self) -> bool:
        """Whether a test can notice at which time a step happens."""
        assert self.system.test is not None
        return (
            any(f.fact == "time" for f in self.facts)
            or bool(self.aged_topics())
            or any(self._max_age_ns(t) is not None for m in self.system.modules for t in m.inputs)
            or bool(self.system.test.timed)
        )

    def aged_topics(self) -> set[int]:
        """The topics whose exact age matters, as code reads the age or a latch depends on it."""
        latched = [m for m in self.system.modules if m.acknowledgement is not None]
        latches = {t for m in latched for t in (m.latch, m.acknowledgement) if t is not None}
        return latches | {f.index for f in self.facts if f.fact == "age"}

    def limited_inputs(self) -> set[int]:
        """The module inputs whose age, against their `max_age`, decides a switch."""
        inputs = {t for m in self.system.modules if m.forced is None for t in m.inputs}
        return {t for t in inputs if self._max_age_ns(t) is not None}


def _impure_code(lowered: core.CoreSystem) -> Iterator[object]:
    """Yields the Core of all steps, decisions and properties; functions are pure, so left out."""
    yield from (_step_code(step) for step in lowered.nodes.values())
    yield from (_step_code(step) for step in lowered.plants.values())
    predicates = list(lowered.properties)
    for d in lowered.decisions:
        predicates += [d.ttf, d.safer]
    for t in lowered.timed:
        predicates += [t.condition] if t.premise is None else [t.premise, t.condition]
    for p in predicates:
        yield (*p.body, p.value)


def _step_code(step: core.NodeStep | core.PlantStep) -> tuple[core.Stmt, ...]:
    """All statements of a step, in the order in which they run."""
    if isinstance(step, core.NodeStep):
        return (*step.takeover, *step.body, *(step.shield.body if step.shield else ()))
    return (*step.choose, *step.integrate, *step.publish)


def _reads_time(root: object) -> bool:
    return any(isinstance(n, core.Fact) and n.fact in {"time", "age"} for n in walk(root))


def _holds_disturbances(step: core.PlantStep) -> bool:
    return any(d.hold_ns > 0 for _, _, some in step.disturbances for d in some)


def _cell_label(cell: core.Cell) -> Label:
    return ("topic", cell.owner) if cell.kind == "topic" else ("cell", cell.owner, cell.name)


def _owns_queue(x: Component, queue: str) -> bool:
    """Whether a queue belongs to the component or to a component inside it."""
    return queue.startswith(f"{x.name}.")


def _is_contract(p: Property) -> bool:
    """Whether a property is a contract, which is judged when its node steps."""
    return p.component is not None


# ---------------------------------------------------------------- faults


def may_fault(system: System, lowered: core.CoreSystem, index: int) -> bool:
    """Whether a step of the component can raise a step fault."""
    component = system.components[index]
    step = lowered.nodes.get(index) or lowered.plants.get(index)
    if step is None:
        return False
    if component.extern or any(
        t.policy == "fault" and _owns_queue(component, t.name) for t in system.topics
    ):
        return True
    faulty = {f.name for f in lowered.functions if f.can_fault}
    return _has_faults(_step_code(step), faulty) or any(
        isinstance(leaf, FloatType) or (isinstance(leaf, IntType) and bound is not None)
        for o in step.outputs
        for (_, leaf), bound in zip(leaves(o.type), o.bounds, strict=True)
    )


def _has_faults(bodies: tuple[core.Stmt, ...], faulty: set[str]) -> bool:
    return any(
        isinstance(n, (core.Checked, core.Guard, core.Push))
        or (isinstance(n, core.Call) and n.function in faulty)
        or (isinstance(n, core.Publish) and n.limit is not None)
        for n in walk(bodies)
    )


# ---------------------------------------------------------------- continua


def is_sampled(system: System, lowered: core.CoreSystem) -> bool:
    """Whether the test tries only some values of a continuum, or draws some by chance."""
    return (
        any(_samples_input(system, d) for d in system.inputs)
        or any(_samples_draws(step) for step in lowered.plants.values())
        or any(i is not None and i[0] < i[1] for x in system.components for i in x.initial_range)
    )


def _samples_input(system: System, drive: InputDrive) -> bool:
    topic = system.topics[drive.topic]
    if drive.values:
        return False
    return any(
        isinstance(leaf, FloatType) and (bound is None or bound.low < bound.high)
        for (_, leaf), bound in zip(leaves(topic.type), topic.bounds, strict=True)
    )


def _samples_draws(step: core.PlantStep) -> bool:
    """Whether a plant's step draws disturbances or measurement errors from a continuum."""
    used = {n.name for n in walk(_step_code(step)) if isinstance(n, core.Var)}
    draws = [d for name, _, some in step.disturbances if name in used for d in some]
    draws += [d for _, _, d in step.noise]
    return any(d.low < d.high for d in draws)

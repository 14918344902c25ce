"""Shows that a view's state jumps only where `enters` holds ("Hand-over" in docs/proof-sets.md).

Purpose: the state of a view is computed by a map that may read topics, so it jumps when a node
publishes new values there. `jumping_topics` finds that node and asks z3 about any two of its steps
in a row, and about its first step. Either the later step publishes the same values, or `enters`
holds of what that step reads and publishes, and it publishes all that the view's plants drive.
Non-goals: that the state lies in R(H) wherever `enters` holds (`claims/start.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import TYPE_CHECKING

from soter.core.execution import TooManyStatementsError
from soter.core.steps import lower
from soter.language.elaborate import derived_systems
from soter.language.model import typed
from soter.language.model.system import Property
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.types import FLOAT, MODE, RecordType
from soter.verify.induction.solver_terms import Age, SolverTerms
from soter.verify.induction.step_terms import Evaluation
from soter.workers.interruptible_solver import ctrl_c_waits

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.core import core
    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type
    from soter.verify.induction.solver_terms import Term

Path = tuple[int, ...]


@dataclass(frozen=True)
class JumpingTopic:
    """A topic, the node that publishes it, and `why` nothing is shown of it ("" if it is shown)."""

    topic: typed.TopicSymbol
    node: str
    why: str = ""


def jumping_topics(
    flat: System, module: Module, link: typed.AbstractionLink
) -> Iterator[JumpingTopic]:
    """The topics that the map of a view reads, each with what is shown; none without `enters`."""
    enters = None if module.whole is None else module.whole.verify.enters
    if enters is None:
        return
    for topic in topic_reads(link.value):
        index = _topic_index(flat, topic)
        writers = [c for c in flat.components if c.node and index in c.writes]
        why = _why_not_followed(flat, index, writers) or _why_locals_matter(flat, module)
        why = why or _why_age_read(link.value, topic)
        name = writers[0].name if writers else ""
        if not why:
            changed = ChangedTopic(
                index, _paths_read(link.value, topic), _driven_topics(flat, module, link)
            )
            why = _why_change_possible(flat, module, enters, writers[0], changed)
        yield JumpingTopic(topic, name, why)


def _why_age_read(value: typed.TypedExpr | None, topic: typed.TopicSymbol) -> str:
    """Why a map that reads a topic's age is not followed, as publishing resets ages; or ""."""
    aged = any(isinstance(n, typed.AgeRead) and n.topic is topic for n in nodes([value]))
    return f"its map reads the age of {topic.name}" if aged else ""


def _topic_index(flat: System, topic: typed.TopicSymbol) -> int:
    """The system's index of a topic symbol; -1 if it has none or differs between components."""
    indices = {c.scope.topics[topic] for c in flat.components if topic in c.scope.topics}
    return indices.pop() if len(indices) == 1 else -1


@dataclass(frozen=True)
class ChangedTopic:
    """A topic's index, the parts that the map reads, and the topics that show the plant's state."""

    index: int
    paths: list[Path]
    shown: list[int]


def _why_locals_matter(flat: System, module: Module) -> str:
    """Why an SC with locals is not followed, as they may remember the time before a jump; or ""."""
    sc = flat.components[module.sc]
    return f"{sc.name} keeps locals" if sc.node is None or sc.node.locals else ""


def _driven_topics(flat: System, module: Module, link: typed.AbstractionLink) -> list[int]:
    """The topics that the plant of a view drives and the module reads."""
    scopes = (module.scope.topics, flat.components[module.sc].scope.topics)
    indices = [next((s[t] for s in scopes if t in s), -1) for t, _ in link.plant.drives]
    return [i for i in indices if i >= 0]


def _why_not_followed(flat: System, index: int, writers: list[Component]) -> str:
    if find_spec("z3") is None:
        return "z3 is not installed"
    if len(writers) != 1 or index in {d.topic for d in flat.inputs}:
        return "it is published by more than one, or by nobody"
    (c,) = writers
    assert c.node is not None
    if c.role != "node" or c.extern or c.node.bursts:
        return f"{c.name} is no node with one value a step"
    if index in c.failsafe:
        return f"{c.name} publishes its fail-safe value after a fault"
    if any(s.queue is not None for s in c.node.subscribes):
        return f"{c.name} reads a queue"
    return ""


def _paths_read(value: typed.TypedExpr | None, topic: typed.TopicSymbol) -> list[Path]:
    """The parts of a topic that an expression reads, as field indices; () is the whole topic."""
    every = [n for n in nodes([value]) if isinstance(n, typed.TypedExpr)]
    around = {id(n.target): n for n in every if isinstance(n, typed.TypedField)}
    paths: dict[Path, None] = {}
    for read in every:
        if not isinstance(read, typed.TopicRead) or read.topic is not topic:
            continue
        path, at = [], id(read)
        while at in around:
            path.append(around[at].index)
            at = id(around[at])
        paths[tuple(path)] = None
    return list(paths)


@dataclass
class StepReads:
    """The topic values that one step reads; a topic not in `values` may have any allowed value."""

    terms: SolverTerms
    flat: System
    values: dict[int, Term] = field(default_factory=dict)

    def topic_value(self, cell: core.Cell, t: Type) -> Term:
        """The value of a topic in this step."""
        if cell.owner not in self.values:
            topic = self.flat.topics[cell.owner]
            self.values[cell.owner] = self.terms.unknown(t, topic.name, topic.bounds)
        return self.values[cell.owner]

    def fact_value(self, fact: core.Fact) -> Term:
        """A new unknown value for each read of a fact; only `in_control` is always true."""
        if fact.fact == "in_control":
            return True
        if fact.fact == "mode":
            return self.terms.unknown(MODE, "mode")
        if fact.fact == "age":
            age = self.terms.unknown_int("age")
            self.terms.state(age >= 0)
            return Age(age)
        return self.terms.unknown(FLOAT, "time")


@dataclass
class StepTransition:
    """The result of one step: its locals, (whether published, value) of topics, `enters` then."""

    locals: dict[str, Term]
    published: dict[int, tuple[Term, Term]]
    faults: Term
    enters: Term


@ctrl_c_waits()
def _why_change_possible(
    flat: System, module: Module, enters: typed.TypedExpr, c: Component, changed: ChangedTopic
) -> str:
    """Why a topic may change although `enters` does not hold, as z3 finds; "" if it cannot."""
    enters_property = Property(0, "always", enters, module.scope, "enters", enters.span)
    program = lower(derived_systems.with_properties(flat, (enters_property,)))
    topic = flat.topics[changed.index]
    terms = SolverTerms()
    assert c.node is not None
    anything = {v.name: terms.unknown(v.type, v.name) for v in c.node.locals}
    start = {
        v.name: terms.constant(v.type, value)
        for v, value in zip(c.node.locals, c.initial, strict=True)
    }
    default = terms.constant(topic.type, topic.default)
    first = StepTransition({}, {changed.index: (True, default)}, False, False)
    try:
        before = _step_transition(terms, flat, program, c, anything)
        cases = [
            ("the first step", _step_transition(terms, flat, program, c, start), first),
            ("a step", _step_transition(terms, flat, program, c, before.locals), before),
        ]
        for text, step, last in cases:
            if _may_jump(terms, step, last, topic.type, changed):
                return (
                    f"{text} of {c.name} may change it where `enters` does not hold, or without "
                    "showing it to DM and SC"
                )
    except TooManyStatementsError:
        return f"a step of {c.name} takes more statements than are followed"
    return ""


def _may_jump(
    terms: SolverTerms, step: StepTransition, last: StepTransition, t: Type, changed: ChangedTopic
) -> bool:
    """Whether a step may publish a forbidden change of a topic; `last` is the step before it."""
    nothing = (False, terms.unknown(t, "whatever"))
    published, value = step.published.get(changed.index, nothing)
    early_topics, old = last.published.get(changed.index, nothing)
    old = terms.choice(early_topics, old, terms.unknown(t, "before"), t)
    same = terms.all_of(*[_have_equal_parts(terms, value, old, t, p) for p in changed.paths])
    shows = [step.published.get(i, (False, None))[0] for i in changed.shown]
    runs = terms.negated(terms.any_of(step.faults, last.faults))
    good = terms.any_of(same, terms.all_of(step.enters, *shows))
    bad = terms.all_of(runs, published, terms.negated(good))
    if isinstance(bad, bool):
        return bad
    query = terms.query()
    query.add(bad)
    return bool(query.check() != terms.z3.unsat)


def _have_equal_parts(terms: SolverTerms, a: Term, b: Term, t: Type, path: Path) -> Term:
    """The condition that two values of type `t` are equal in the part at `path`."""
    for k in path:
        assert isinstance(t, RecordType)
        a, b, t = a[k], b[k], t.fields[k][1]
    pairs = zip(terms.leaves(a, t), terms.leaves(b, t), strict=True)
    return terms.all_of(*[x == y for x, y in pairs])


def _step_transition(
    terms: SolverTerms, flat: System, program: core.CoreSystem, c: Component, state: dict[str, Term]
) -> StepTransition:
    """The transition of one step of a node from these locals, for any values that it reads."""
    code = program.nodes[c.index]
    functions = {f.name: f for f in program.functions}
    reads = StepReads(terms, flat)
    evaluation = Evaluation(terms, functions, reads)
    for copy in code.locals:
        evaluation.bind(copy.name, copy.type, state[copy.cell.name])
    evaluation.run(code.body)
    after = {copy.cell.name: evaluation.frame.variables[copy.name] for copy in code.locals}
    published = {
        o.topic: evaluation.frame.outputs[k][:2]
        for k, o in enumerate(code.outputs)
        if k in evaluation.frame.outputs
    }
    (enters,) = program.properties
    shown = StepReads(terms, flat, dict(reads.values))
    for i, (says, value) in published.items():
        t = flat.topics[i].type
        shown.values[i] = terms.choice(says, value, terms.unknown(t, "before"), t)
    after_step = Evaluation(terms, functions, shown)
    after_step.run(enters.body)
    holds = after_step.expr(enters.value)
    holds = terms.all_of(holds, terms.negated(terms.any_of(after_step.fault, after_step.doubt)))
    return StepTransition(after, published, terms.any_of(evaluation.fault, evaluation.doubt), holds)

"""Checks the node of a hand-over: the state of a view jumps only in steps where `enters` holds.

Purpose: `why_jumps_not_shown` asks z3, for one topic that the map of a view reads, of any two steps
in a row of the node that publishes it, and of its very first step (proof-sets.md, "Hand-over"):
either it publishes what the map reads as it did last, or `enters` holds of what the later step
reads and publishes, and that step publishes all by which the decision module and SC know of the
view.
Non-goals: that the state lies in R(H) wherever `enters` holds (`handovers.py`).

Of the locals before the first of the two steps nothing is taken for granted, nor of what any step
reads. A step that faults publishes nothing, and its node is latched: it is the last one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import z3

from soter.certificate.induction.solver_steps import SolverReading, VisibleValues
from soter.certificate.induction.solver_values import (
    and_of,
    choose,
    leaf_terms,
    negation,
    or_of,
    unknown_value,
    value_as_terms,
)
from soter.certificate.reading.symbolic_reading import part_type
from soter.certificate.report import NotRecheckedError
from soter.language.model import typed
from soter.language.model.tree_walk import children
from soter.language.model.tree_walk import nodes as parts_of
from soter.language.model.types import MODE
from soter.workers.interruptible_solver import ask_solver, ctrl_c_waits

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.certificate.reading.module_facts import Facts
    from soter.language.model.system import Component, Scope, Topic
    from soter.language.model.types import Type

Term = Any
Path = tuple[int, ...]
WORK, PATIENCE_MS = 100_000_000, 300_000
IN_A_MAP = (
    typed.Literal, typed.ParamRead, typed.TopicRead, typed.TruthRead, typed.TypedUnary,
    typed.TypedBinary, typed.Vector, typed.Conditional, typed.TypedCall, typed.Builtin,
    typed.TypedField, typed.Index, typed.TypedLength, typed.Aggregate, typed.Narrow,
)  # fmt: skip
"""A map made of these changes only with the plant that flies and with the values of topics, and not
by itself, as one with `time`, an age or a mode does."""


@ctrl_c_waits()
def why_jumps_not_shown(
    facts: Facts, link: typed.AbstractionLink, topic: typed.TopicSymbol
) -> tuple[str, str]:
    """The node that publishes a topic, and why its jumps are not shown to be right ("" if shown).

    Raises NotRecheckedError for code that this check does not understand.
    """
    if not all(isinstance(n, IN_A_MAP) for n in parts_of([link.value])):
        return "", f"the map of {link.name} reads more than plants and topics"
    at = _index_of_running_topic(facts, topic)
    if at < 0:
        return "", "it stands for several topics, or for none"
    writers = _components_that_publish(facts, at)
    if len(writers) != 1 or writers[0].node is None:
        return "", "it is not published by one node alone"
    (c,) = writers
    if why := _why_unsuited(facts, c, at):
        return c.name, why
    shown = _topics_showing_view(facts)
    for index in shown:
        if [w.index for w in _components_that_publish(facts, index)] != [c.index]:
            name = facts.flying.topics[index].name
            return c.name, f"{name}, which shows the view, is not published by {c.name} alone"
    paths = list(dict.fromkeys(_paths_read(link.value, topic)))
    if not paths:
        return c.name, f"the map of {link.name} is not read here"
    return c.name, _Steps(facts, c).why_step_fails(at, paths, shown)


# ---------------------------------------------------------------- who publishes


def _index_of_running_topic(facts: Facts, topic: typed.TopicSymbol) -> int:
    """The index of the running topic that a name in the map means; -1 unless it is unique."""
    flat_ = facts.flying
    scopes = [c.scope for c in flat_.components] + [m.scope for m in flat_.modules]
    indices = {s.topics[topic] for s in scopes if topic in s.topics}
    made = {t.index for t in flat_.topics if t.symbol is topic and t.queue_of is None}
    return indices.pop() if len(indices) == 1 and made == indices else -1


def _components_that_publish(facts: Facts, index: int) -> list[Component]:
    return [c for c in facts.flying.components if index in c.writes]


def _is_plain_node(c: Component) -> bool:
    is_node = c.role == "node" and not c.extern and c.stands_for is None
    return is_node and c.node is not None and c.node.takeover is None


def _why_unsuited(facts: Facts, c: Component, index: int) -> str:
    node, sc = c.node, facts.sc.node
    assert node is not None
    published = c.writes
    drawn = {d.topic for d in facts.flying.inputs}
    if index in drawn or facts.flying.topics[index].symbol.input:
        return "it is drawn as an input, too"
    if not _is_plain_node(c):
        return f"{c.name} is no plain node"
    if node.bursts or len(set(published)) < len(published):
        return f"{c.name} does not publish one value a step"
    if index in c.failsafe:
        return f"{c.name} publishes its fail-safe value after a fault"
    if any(s.queue is not None for s in node.subscribes):
        return f"{c.name} reads a queue"
    if sc is None or sc.locals:
        return f"{facts.sc.name} keeps locals: it may go by what was there before"
    return ""


def _topics_showing_view(facts: Facts) -> list[int]:
    """The running topics that plants of the view drive and that the decision module or SC reads."""
    module = facts.flying_module
    scopes = (module.scope.topics, facts.flying.components[module.sc].scope.topics)
    topics = []
    for link in facts.symbol.verify.abstracts:
        for topic, _ in link.plant.drives:
            topics += [s[topic] for s in scopes if topic in s]
    return list(dict.fromkeys(topics))


def _paths_read(e: object, topic: typed.TopicSymbol, path: Path = ()) -> Iterator[Path]:
    """Yields the paths of a topic's parts that an expression reads; () is the whole topic."""
    if isinstance(e, typed.TypedField):
        yield from _paths_read(e.target, topic, (e.index, *path))
    elif isinstance(e, typed.TopicRead):
        if e.topic is topic:
            yield path
    else:
        for part in children(e):
            yield from _paths_read(part, topic)


# ---------------------------------------------------------------- two steps in a row


@dataclass
class _Step:
    """The effects of a step: locals after it, topic -> (whether published, value), fault, reads."""

    behind: tuple[Term, ...]
    published: dict[int, tuple[Term, Term]]
    fault: Term
    read: dict[int, Term]


class _Steps:
    """Makes terms of the steps of a node, and asks the solver about two steps in a row."""

    def __init__(self, facts: Facts, c: Component) -> None:
        assert facts.whole is not None
        self.facts, self.c, self.whole = facts, c, facts.whole
        self.known: list[Term] = []

    def why_step_fails(self, index: int, paths: Sequence[Path], shown: Sequence[int]) -> str:
        """Why a step may wrongly change a topic; "" if no step does."""
        node, topic = self.c.node, self.facts.flying.topics[index]
        assert node is not None
        anything = [unknown_value(v.type, v.name, self.known) for v in node.locals]
        pairs = zip(node.locals, self.c.initial, strict=True)
        initial = [value_as_terms(v.type, value, self.known) for v, value in pairs]
        default = value_as_terms(topic.type, topic.default, self.known)
        before = self._run_step(anything)
        for text, last, fault, step in (
            ("the first step", (True, default), False, self._run_step(initial)),
            ("a step", before.published.get(index), before.fault, self._run_step(before.behind)),
        ):
            bad = self._wrong_step_term(topic, paths, shown, last, step)
            if not self._is_unsatisfiable(and_of(negation(fault), bad)):
                return (
                    f"{text} of {self.c.name} may change it where `enters` does not hold, or "
                    "without showing it to DM and SC"
                )
        return ""

    def _wrong_step_term(
        self,
        topic: Topic,
        paths: Sequence[Path],
        shown: Sequence[int],
        last: tuple[Term, Term] | None,
        step: _Step,
    ) -> Term:
        """The term that a step publishes a changed value although it must not change."""
        if topic.index not in step.published:
            return False
        is_published, value = step.published[topic.index]
        old = unknown_value(topic.type, "before", self.known)
        if last is not None:
            old = choose(last[0], last[1], old)
        same = [_is_same_part(value, old, topic.type, p) for p in paths]
        shows = [step.published[i][0] if i in step.published else False for i in shown]
        good = or_of(and_of(*same), and_of(self._enters_term(step), *shows))
        return and_of(negation(step.fault), is_published, negation(good))

    def _is_unsatisfiable(self, truth: Term) -> bool:
        solver = z3.Solver()
        solver.set("rlimit", WORK)
        solver.set("timeout", PATIENCE_MS)
        solver.add(*self.known, truth)
        return bool(ask_solver(solver) == z3.unsat)

    def _visible_values(self, scope: Scope, topics: dict[int, Term], mode: Term) -> VisibleValues:
        """The values that a step sees: a term for each topic, about which nothing more is known."""
        flying = self.facts.flying

        def topic(i: int) -> Term:
            if flying.topics[i].queue_of is not None:
                raise NotRecheckedError(f"`{flying.topics[i].name}` is a queue")
            if i not in topics:
                topics[i] = unknown_value(flying.topics[i].type, flying.topics[i].name, self.known)
            return topics[i]

        def age(_: int) -> Term:
            term = z3.FreshInt("age")
            self.known.append(term >= 0)
            return term

        index = self.facts.flying_module.index
        return VisibleValues(scope, topic, age, mode, index, in_control=True, facts=self.known)

    def _run_step(self, before: Sequence[Term]) -> _Step:
        assert self.c.node is not None
        read: dict[int, Term] = {}
        sight = self._visible_values(self.c.scope, read, unknown_value(MODE, "mode", self.known))
        reading = SolverReading(sight, deep=True)
        behind, published = reading.run_step(self.c.node, before)
        out = {self.c.scope.topics[t]: value for t, value in published.items()}
        return _Step(behind, out, or_of(reading.operations.fault, reading.operations.doubt), read)

    def _enters_term(self, step: _Step) -> Term:
        """The term that `enters` holds on a step's reads and publications, without a fault."""
        enters = self.whole.verify.enters
        assert enters is not None
        seen = dict(step.read)
        for i, (is_published, value) in step.published.items():
            t = self.facts.flying.topics[i].type
            seen[i] = choose(is_published, value, unknown_value(t, "before", self.known))
        scope = self.facts.flying_module.scope
        sight = self._visible_values(scope, seen, unknown_value(MODE, "mode", self.known))
        value, fault = SolverReading(sight, deep=True).truth_and_fault(enters)
        return and_of(value, negation(fault))


def _is_same_part(a: Term, b: Term, t: Type, path: Path) -> Term:
    for k in path:
        a, b, t = a[k], b[k], part_type(t, k)
    return and_of(*(x == y for x, y in zip(leaf_terms(a), leaf_terms(b), strict=True)))

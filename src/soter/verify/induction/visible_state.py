"""What a step sees: topics with their stamps, ages and modes at a point of a stretch of time.

Purpose: the state between clusters of steps, what a step did, and the `ClusterView` of a reader, in
which a topic is what the last writer before it published.
Non-goals: when steps are made, and what they do (`transition_relation.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from soter.language.model.types import FLOAT
from soter.verify.induction.solver_terms import Age

if TYPE_CHECKING:
    from soter.core import core
    from soter.language.model.types import Type
    from soter.verify.induction.calendar import CalendarStep, Point
    from soter.verify.induction.problem import InductionProblem
    from soter.verify.induction.solver_terms import SolverTerms, Term

SC, AC = 0, 1
NEVER = -(2**62)


@dataclass
class State:
    """Between two clusters: topics with their stamps, locals, the mode."""

    topics: dict[int, tuple[Term, Term]]
    locals: dict[tuple[int, str], Term]
    mode: Term
    had: dict[int, Term] = field(default_factory=dict)
    """Of SC with `on takeover`: whether it had control at its last step."""
    latched: dict[int, Term] = field(default_factory=dict)
    """Whether a node has faulted, where that is allowed."""


@dataclass(eq=False)
class StepEffect:
    """What a step did: publications (whether, what), its mode where it is a DM's."""

    step: CalendarStep
    published: dict[int, tuple[Term, Term]] = field(default_factory=dict)
    mode: Term | None = None
    before: Term | None = None
    """The mode that a DM found."""
    fault: Term = False
    doubt: Term = False
    """A fault that hangs on something uninterpreted."""


@dataclass(frozen=True)
class JudgedInstant:
    """An instant at which properties are judged: when it counts, and what holds there.

    `holds`: what is proved: that no step faulted, `safe`, then the lemmas, at `at`; `later`: `safe`
    at any time until something happens, where ages matter to it.
    """

    counts: Term
    earliest: int
    latest: int
    at: Term
    holds: tuple[Term, ...]
    later: Term
    component: int
    granted: Term = True
    """What P2b takes for granted then."""


class StepSurroundings(Protocol):
    """The stretch of time that a step stands in."""

    problem: InductionProblem
    terms: SolverTerms
    writers: list[int]
    state: State
    still: dict[int, Term]
    """Topics that nobody of the relation publishes, and that do not change."""


class Order(Protocol):
    """A cluster of steps in an order that is left open."""

    def last(
        self, index: int, old: tuple[Term, Term], point: Point | None, own: CalendarStep | None
    ) -> tuple[Term, Term]:
        """The last publication on a topic before a point."""

    def mode(self, old: Term, point: Point | None, own: CalendarStep | None) -> Term:
        """After the last decision before a point."""


class ClusterView:
    """What is read at a point of a cluster, `own` included where it is an effect."""

    def __init__(
        self,
        of: StepSurroundings,
        cluster: Order | None,
        now: Term,
        point: Point | None = None,
        own: CalendarStep | None = None,
        *,
        enabled: Term = True,
    ) -> None:
        self.of, self.cluster, self.now, self.point, self.own = of, cluster, now, point, own
        self.enabled = enabled
        self._known: dict[int, tuple[Term, Term]] = {}

    def cell(self, cell: core.Cell, t: Type) -> Term:
        """A topic; one that nobody of the relation publishes holds anything of its set."""
        assert cell.kind == "topic", cell
        if cell.owner in self.of.still:
            return self.of.still[cell.owner]
        if cell.owner not in self.of.writers:
            topic = self.of.problem.system.topics[cell.owner]
            bounds = topic.bounds if topic.queue_of is None else None
            return self.of.terms.fresh(t, topic.name, bounds)
        return self.topic(cell.owner)[0]

    def topic(self, index: int) -> tuple[Term, Term]:
        """Value and stamp."""
        if index not in self._known:
            publication = self.of.state.topics[index]
            if self.cluster is not None:
                publication = self.cluster.last(index, publication, self.point, self.own)
            self._known[index] = publication
        return self._known[index]

    def stamp(self, index: int) -> Term:
        """Of a topic; of one that nobody of the relation publishes, any."""
        if index in self.of.writers:
            return self.topic(index)[1]
        terms = self.of.terms
        stamp = terms.whole("stamp")
        terms.state(stamp <= self.now)
        return stamp

    def mode(self) -> Term:
        """Of the module."""
        mode = self.of.state.mode
        return mode if self.cluster is None else self.cluster.mode(mode, self.point, self.own)

    def fact(self, fact: core.Fact) -> Term:
        """`time` may be anything."""
        if fact.fact == "mode":
            return self.mode()
        if fact.fact == "in_control":
            return self.enabled
        if fact.fact == "age":
            return Age(self.now - self.stamp(fact.index))
        return self.of.terms.fresh(FLOAT, "time")


def if_(terms: SolverTerms, condition: Term, then: Term, otherwise: Term) -> Term:
    """Of two integers."""
    if isinstance(condition, bool) or then is otherwise:
        return then if condition is not False else otherwise
    return terms.z3.If(condition, then, otherwise)

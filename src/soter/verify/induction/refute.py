"""A run that leaves `safe`, of the program with an AC that may publish anything.

Purpose: where the relation has a run in which something fails, look for one of the program, by
systematic testing up to that time; it counts only when the reference interpreter has replayed it.
Non-goals: what an execution is (docs/testing.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

from soter.language.elaborate import derived_systems
from soter.language.model import typed
from soter.language.model.system import Property, TestPlan, TimingFault
from soter.language.model.types import (
    BOOL,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
    default_value,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.span import Span
    from soter.language.model.system import Bound, System
    from soter.language.model.types import Type, Value
    from soter.verify.induction.problem import InductionProblem

ALTERNATIVES_MAX = 64
"""Of one leaf; of a larger set the ends, the default and the middle are tried."""


@dataclass(frozen=True)
class ReplayedRun:
    """A run of the program with some AC, replayed by the reference interpreter."""

    time_ns: int
    lines: tuple[str, ...]

    def __str__(self) -> str:
        """Its steps, a line each."""
        return "\n".join(self.lines)


class Violated(Protocol):
    """A run that was found: what it violates (`property`, `fault`), when, and its steps."""

    @property
    def what(self) -> str:
        """Of the kinds of a trace."""

    @property
    def time_ns(self) -> int:
        """Of the violation."""

    @property
    def lines(self) -> tuple[str, ...]:
        """For people."""


Search = Callable[["System"], "Violated | None"]
"""Looks for a run of a flat system with a test plan that violates one of its properties."""


def refuting_run(
    problem: InductionProblem, until_ns: int, search: Search, *, fault: bool
) -> ReplayedRun | None:
    """A run in which `safe` is violated by then, or a trusted step faults; None: none found.

    Where the proof rests on topics that nobody in it publishes, what is tested would not be the
    program: nobody looks.
    """
    if problem.any_value:
        return None
    for system in (any_ac(problem), problem.system):
        if any(c.extern for c in system.components):
            continue
        violation = search(system_as_test(problem, system, until_ns))
        if violation is not None and violation.what == ("fault" if fault else "property"):
            return ReplayedRun(violation.time_ns, violation.lines)
    return None


def system_as_test(problem: InductionProblem, system: System, until_ns: int) -> System:
    """The system as a test: `safe` always, steps as late as they are declared to be."""
    m = problem.module
    span = m.symbol.span
    safe = Property(0, "always", m.symbol.safe, m.scope, "safe", m.symbol.safe.span)
    faults = []
    for c in problem.declared:
        if c.late:
            faults.append(TimingFault("late", c.component, c.late, 0, span))
        if c.response and c.component != m.dm:
            takes = system.components[c.component].takes_ns
            least = 0 if takes is None else takes[0]
            faults.append(TimingFault("overrun", c.component, c.response, 0, span, least))
    plan = TestPlan(m.name, 0, max(until_ns, 1), None, tuple(faults), (), span)
    return derived_systems.with_test(derived_systems.with_properties(system, (safe,)), plan)


# ---------------------------------------------------------------- an AC that may do anything


def any_ac(problem: InductionProblem) -> System:
    """AC publishes at each of its releases, or not, on each of its topics, any value of its set."""
    system = problem.system
    ac = system.components[problem.module.ac]
    assert ac.node is not None
    span = ac.node.span
    step: list[typed.TypedStmt] = []
    for t in ac.node.publishes:
        topic = system.topics[ac.scope.topics[t]]
        value = _any_value(topic.type, topic.bounds, topic.default, span)
        coin = typed.TypedChoose(BOOL, span, 2, 0, (), None)
        step.append(typed.TypedIf(span, ((coin, (typed.TypedPublish(span, t, value),)),), ()))
    node = replace(
        ac.node,
        extern=False,
        source=None,
        subscribes=(),
        locals=(),
        initial=(),
        takeover=None,
        step=tuple(step),
    )
    return derived_systems.with_components(system, [derived_systems.with_node(ac, node, {})])


def _any_value(
    t: Type, bounds: Sequence[Bound | None], default: Value, at: Span
) -> typed.TypedExpr:
    if isinstance(t, (RecordType, ArrayType)):
        own = [f for _, f in t.fields] if isinstance(t, RecordType) else [t.element] * t.size
        elements, k = [], 0
        for part, value in zip(own, default, strict=True):
            count = sum(1 for _ in leaves(part))
            elements.append(_any_value(part, bounds[k : k + count], value, at))
            k += count
        return typed.Aggregate(t, at, tuple(elements))
    if isinstance(t, BoolType):
        return typed.TypedChoose(t, at, 2, 0, (), None)
    if isinstance(t, EnumType):
        return typed.TypedChoose(t, at, len(t.members), 0, (), None)
    values: list[Value] = [default]
    bound = bounds[0] if bounds else None
    if isinstance(t, IntType):
        low, high = (t.low, t.high) if bound is None else (int(bound.low), int(bound.high))
        few = high - low < ALTERNATIVES_MAX
        values += range(low, high + 1) if few else [low, (low + high) // 2, high]
    elif isinstance(t, FloatType) and bound is not None:
        values += [bound.low, 0.5 * bound.low + 0.5 * bound.high, bound.high]
    else:
        values.append(default_value(t))
    options = [typed.Literal(t, at, v) for v in dict.fromkeys(values)]
    return typed.TypedChoose(t, at, len(options), 0, tuple(options), None)

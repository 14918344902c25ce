"""SC on topics that nobody has published yet: it reads defaults, and must not latch on them.

Purpose: `fault_on_defaults`: what goes wrong in the steps before every read shows a state. Their
outputs are in U, checked as they are published, so that they belong to what R(h_0) covers; but a
step that faults latches SC, and then it never speaks again.
Non-goals: steps on states (the enclosures).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

from soter.language.elaborate import derived_systems
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import ac_or_sc_step
from soter.verify.problem.modes_of_other_modules import AC, SC
from soter.verify.problem.verification_system import sc_reads

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.language.model.system import Component, System
    from soter.language.model.typed import TopicSymbol
    from soter.semantics.configuration import Configuration
    from soter.verify.problem.problem import Problem

STEPS_MAX = 10_000


def fault_on_defaults(problem: Problem) -> str:
    """What may go wrong, in words; empty: nothing."""
    schedule = problem.times.schedule
    steps = schedule.defaults_read
    if not steps:
        return ""
    system, sc = _alone(problem)
    component = system.components[sc]
    assert component.node is not None
    modes = [component.scope.topics[t] for t in sc_reads(component.node) if t in _modes(problem)]
    topics = {component.scope.topics[t] for t in sc_reads(component.node)} - {*modes}
    if steps > STEPS_MAX:
        return "SC reads defaults for too long to try them all"
    if not _published_together(problem, {system.topics[t].name for t in topics}):
        return "SC may read the default of one topic beside a value of another"
    known = {p.topic for p in schedule.read_by_dm}
    if component.node.locals or component.node.takeover is not None:  # it keeps something
        if modes:
            return "SC steps on defaults in any mode of others, with what it keeps: not followed"
        if any(p.topic not in known for p in schedule.read_by_sc):
            return "SC may lose control and take it over, with what it keeps, before it has read"
    return _first_fault(system, component, steps, modes)


def _first_fault(system: System, sc: Component, steps: int, modes: Sequence[int]) -> str:
    """What goes wrong in so many first steps; "": nothing."""
    dummies = {c.name: _silent for c in system.components if c.extern}
    interpreter = Interpreter(system, 0, dummies)
    c = interpreter.initial()
    for k in range(steps):
        at = sc.phase_ns + k * sc.period_ns
        for seen in _in_every_mode(replace(c, ct=at, FN=(sc.index,)), modes):
            c, outcome = ac_or_sc_step(interpreter.machine, seen, sc.index)
            if outcome.fault is not None:
                return f"SC faults on the defaults that it reads at first: {outcome.fault}"
    return ""


def _published_together(problem: Problem, topics: set[str]) -> bool:
    """Whether SC reads defaults of all of these topics, or of none."""
    schedule, paths = problem.times.schedule, problem.times.schedule.read_by_sc
    at_once = len({p.publisher for p in paths}) == 1
    if not any(p.nodes for p in paths) and not schedule.dropout:
        at_once = len({p.sensor for p in paths}) == 1  # plants of one phase publish together
    with_them = {t for t, node in problem.beside.items() if node == paths[0].publisher}
    return at_once and topics <= {p.topic for p in paths} | with_them


def _modes(problem: Problem) -> Mapping[TopicSymbol, str]:
    return {} if problem.modes is None else problem.modes.topics


def _in_every_mode(c: Configuration, modes: Sequence[int]) -> Iterator[Configuration]:
    """The same with every combination of other modes; SC keeps nothing from one to the next."""
    for combination in product((SC, AC), repeat=len(modes)):
        by = dict(zip(modes, combination, strict=True))
        yield replace(c, Topics=tuple(by.get(i, value) for i, value in enumerate(c.Topics)))


def _alone(problem: Problem) -> tuple[System, int]:
    """The module without plants: nobody publishes what SC reads; a shield judges AC alone."""
    system = derived_systems.module_alone(problem.system, problem.module)
    system = derived_systems.with_module(system, replace(system.modules[0], shield=None))
    return derived_systems.forced(system, 0, "sc"), system.modules[0].sc


def _silent(_: object) -> dict[str, object]:
    return {}

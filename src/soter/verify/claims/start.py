"""The claim `start`: SC gets control while the state is in R(h), its steps on defaults go well.

K, the core: states from which SC keeps `safe` for ever. R(t): states from which no command of U,
the declared sets of what drives plants, leads out of K within t. h_0: the time by which an output
of SC has acted, counted from the start. H, the look-ahead: how long a state may move on before
SC's first output acts, once control is given back (both: `verify/problem/schedule.py`).

Purpose: the claim has two parts. *Control*: `check_start` checks that initial states lie in R(h_0).
`why_not_entered` checks the set part of a hand-over (docs/proof-sets.md): where `enters` holds at
an estimate, the state lies in R(H), on cells and outside the grid. *Defaults*: `fault_on_defaults`
runs the steps of SC before all that it reads shows a state. Their outputs are in U, so R(h_0)
covers them; but after a step that faults SC never publishes again.
Non-goals: that a node changes a view in no other step (`induction/handover.py`).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from soter.language.elaborate import derived_systems
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import leaves, show_ns
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import ac_or_sc_step
from soter.verify.problem.verification_system import AC, SC, topics_read_in_step

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.core.layout import Floats
    from soter.language.model.system import Component, System
    from soter.semantics.configuration import Configuration
    from soter.verify.grid.case import Case
    from soter.verify.problem.problem import Axis, Problem


STEPS_MAX = 10_000
"""The most steps of SC on defaults that are run; if there are more, nothing is shown."""
ENTERS = "enters"
"""The name of the predicate `enters` in the compiled enclosures."""
MAY_HOLD = 2
"""The bit of `CompiledEnclosures.truth` for a predicate that may be true somewhere in a box."""

FURTHER = "start further inside, or closer to rest"
WHY_NOT_HERE = (
    ("`safe` does not hold on the whole cell of an initial state", f"{FURTHER}; or smaller cells"),
    ("an initial state is not in K: SC is not shown to keep `safe` from there", FURTHER),
    (
        "an initial state is in K, and other commands may lead it out within {}, before SC's",
        FURTHER,
    ),
)
"""Text and advice where an initial state is not in C; in C, not in K; in K, not in R(h_0)."""
BEYOND = "the grid does not hold every initial state: {}"


def check_start(case: Case) -> None:
    """Checks that the initial states lie in R(h_0), and that SC does not fault on defaults."""
    if not case.problem.may_start_with(case.parameter):
        return
    _check_defaults(case)
    until_ns = case.problem.whole_periods(case.problem.times.start)
    for proof in case.proofs:
        at = proof.index_of_start_cells(case)
        if at is None:
            starts = ", ".join(_start_in_words(case, a) for a in proof.group.axes)
            case.fail("start", BEYOND.format(starts), proof, "a wider grid, or another start")
            continue
        wrong_by_reason = zip(WHY_NOT_HERE, proof.unshown_start_cells(at, until_ns), strict=True)
        for (text, hint), wrong in wrong_by_reason:
            if wrong.any():
                case.fail("start", text.format(show_ns(until_ns)), proof, hint).cells = wrong
                break


def _start_in_words(case: Case, axis: Axis) -> str:
    i = case.problem.initial[axis.state]
    return f"{axis.name} = {i.low:.6g}" + f" to {i.high:.6g}" * (i.low < i.high)


def why_not_entered(case: Case) -> str:
    """Why `enters` is not shown to imply that the state lies in R(H), in words; "": it is."""
    problem, library = case.problem, case.forms.library
    if library.symbol(ENTERS) == library.ffi.NULL:
        return "what it says cannot be enclosed"
    if case.failures_of("P2a"):  # otherwise R(H) is known, whatever else is not shown
        return "there is no R(H)"
    if {a.state for p in case.proofs for a in p.group.axes} != set(range(len(problem.states))):
        return "not every state is on an axis"
    reach = ranges_of_entry(problem)
    for s, range_ in enumerate(reach):
        if range_ is None:
            return f"nothing that it reads bounds {problem.quantities.states[s].name}"
    for where, box in _boxes_outside_grid(case, np.array(reach, dtype=np.float64)):
        if case.forms.truth(ENTERS, box) & MAY_HOLD:
            return f"it may hold where {where}, outside the grid"
    return next(filter(None, [proof.why_not_entered(case) for proof in case.proofs]), "")


def _boxes_outside_grid(case: Case, reach: Floats) -> Iterator[tuple[str, Floats]]:
    """Yields boxes of all inputs, (inputs, 2), that cover the states outside the grid, with texts.

    `reach`: the range of each state, of shape (states, 2).
    """
    for axis in (a for proof in case.proofs for a in proof.group.axes):
        s, first, last = axis.state, axis.edges[0], axis.edges[-1]
        for where, low, high in (
            (f"{axis.name} is below {first!r}", reach[s, 0], first),
            (f"{axis.name} is above {last!r}", last, reach[s, 1]),
        ):
            if low <= high:
                box = np.array(case.forms.whole)
                box[: len(reach)] = reach
                box[s] = low, high
                yield where, box


def ranges_of_entry(problem: Problem) -> list[tuple[float, float] | None]:
    """The range of each state when `enters` is judged, from the sets of the topics that it reads.

    A range is None if no such topic shows the state.
    """
    scope = problem.module.scope.topics
    read = {scope[t] for t in topic_reads(problem.module.symbol.verify.enters) if t in scope}
    ranges: list[tuple[float, float] | None] = [None] * len(problem.states)
    for (topic, leaf), state in problem.state_of_leaf.items():
        bounds = problem.system.topics[topic].bounds[leaf]
        if topic not in read or bounds is None:
            continue
        error = _measurement_error(problem, topic, leaf)
        error += 2.0**-50 * (error + max(abs(bounds.low), abs(bounds.high)))  # rounding
        ranges[state] = (bounds.low - error, bounds.high + error)
    return ranges


def _measurement_error(problem: Problem, topic: int, leaf: int) -> float:
    """The largest measurement error of a leaf of a topic."""
    path = list(leaves(problem.system.topics[topic].type))[leaf][0]
    return sum(
        max(-range_.low, range_.high)
        for error, range_ in zip(problem.quantities.errors, problem.errors, strict=True)
        if (error.owner, error.path) == (topic, path)
    )


def _check_defaults(case: Case) -> None:
    """Enters a failure of `start` if SC may fault on defaults."""
    why = fault_on_defaults(case.problem)
    if why:
        case.fail("start", why, hint="let SC step only after what it reads was published: `phase`")


def fault_on_defaults(problem: Problem) -> str:
    """Says why SC may fault on defaults; "" if it does not fault."""
    schedule = problem.times.schedule
    steps = schedule.steps_that_read_defaults
    if not steps:
        return ""
    system, sc = _without_plants(problem)
    component = system.components[sc]
    assert component.node is not None
    modes_read = {} if problem.modes is None else problem.modes.topics
    modes = [
        component.scope.topics[t] for t in topics_read_in_step(component.node) if t in modes_read
    ]
    topics = {component.scope.topics[t] for t in topics_read_in_step(component.node)} - {*modes}
    if steps > STEPS_MAX:
        return "SC reads defaults for too long to try them all"
    if not _are_published_together(problem, {system.topics[t].name for t in topics}):
        return "SC may read the default of one topic beside a value of another"
    read_by_dm = {p.topic for p in schedule.read_by_dm}
    if component.node.locals or component.node.takeover is not None:  # SC has variables
        if modes:
            return "SC steps on defaults in any mode of others, with what it keeps: not followed"
        if any(p.topic not in read_by_dm for p in schedule.read_by_sc):
            return "SC may lose control and take it over, with what it keeps, before it has read"
    return _first_fault(system, component, steps, modes)


def _are_published_together(problem: Problem, topics: set[str]) -> bool:
    """Whether SC always reads the defaults of all these topics, or of none of them."""
    schedule, paths = problem.times.schedule, problem.times.schedule.read_by_sc
    at_once = len({p.publisher for p in paths}) == 1
    if not any(p.nodes for p in paths) and not schedule.dropout:
        at_once = len({p.sensor for p in paths}) == 1  # plants of one phase publish together
    with_them = {t for t, node in problem.beside.items() if node == paths[0].publisher}
    return at_once and topics <= {p.topic for p in paths} | with_them


def _without_plants(problem: Problem) -> tuple[System, int]:
    """The module's system without plants, in which nothing publishes what SC reads; SC's index."""
    system = derived_systems.module_alone(problem.system, problem.module)
    system = derived_systems.with_module(system, replace(system.modules[0], shield=None))
    return derived_systems.with_forced_mode(system, 0, "sc"), system.modules[0].sc


def _first_fault(system: System, sc: Component, steps: int, modes: Sequence[int]) -> str:
    """Describes the first fault in the first steps of SC; "" if none faults."""
    dummies = {c.name: _no_outputs for c in system.components if c.extern}
    interpreter = Interpreter(system, 0, dummies)
    c = interpreter.initial()
    for k in range(steps):
        at = sc.phase_ns + k * sc.period_ns
        for seen in _copies_in_every_mode(replace(c, ct=at, FN=(sc.index,)), modes):
            c, outcome = ac_or_sc_step(interpreter.machine, seen, sc.index)
            if outcome.fault is not None:
                return f"SC faults on the defaults that it reads at first: {outcome.fault}"
    return ""


def _copies_in_every_mode(c: Configuration, modes: Sequence[int]) -> Iterator[Configuration]:
    """Yields a copy of the configuration for each combination of the other modules' modes."""
    for combination in product((SC, AC), repeat=len(modes)):
        by = dict(zip(modes, combination, strict=True))
        yield replace(c, Topics=tuple(by.get(i, value) for i, value in enumerate(c.Topics)))


def _no_outputs(_: object) -> dict[str, object]:
    return {}

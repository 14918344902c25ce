"""A problem as it would be had something else been written.

Purpose: one `Problem` from another: merged cells, `ttf` and `safer` left out, a
smaller `max_age`, an axis without ends or a longer one, AC and SC exchanged. None where that is
no problem, or where the module cannot be read again from its verification system alone (views,
`abstracts`, modes, a fail-safe law).
Non-goals: which of them helps (`tried_remedies.py`); changing the program's text.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate import derived_systems
from soter.language.model.durations import show_ns
from soter.language.model.least_ages import least_age_ns
from soter.verify.diagnosis.experiments import extended
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Group, Interval

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import Module, System
    from soter.verify.problem.problem import Axis, Problem


def merged(problem: Problem, most: int) -> Problem:
    """As many cells a step are merged along every axis as leave `most` of them in each group."""
    groups = tuple(_merged(g, most) for g in problem.groups)
    return replace(problem, groups=groups, declared_groups=())


def predicates_left_out(problem: Problem) -> Problem | None:
    """Neither `ttf` nor `safer`."""
    if problem.computed:
        return None
    symbol = replace(problem.module.symbol, ttf=None, safer=None, topics_read=())
    return _read_again(problem, problem.system, replace(problem.module, symbol=symbol))


def younger_reads(problem: Problem) -> tuple[Problem, tuple[str, ...]] | None:
    """`max_age` of what SC and the DM read of plants, as small as it can be, and what to write."""
    told, changed = [], []
    paths = (*problem.times.schedule.read_by_sc, *problem.times.schedule.read_by_dm)
    read = {p.topic for p in paths}
    for index, topic in enumerate(problem.system.topics):
        least = least_age_ns(problem.system, index)
        if topic.name not in read or least is None or topic.max_age_ns is None:
            continue
        if topic.max_age_ns > least:
            changed.append(replace(topic, max_age_ns=least))
            told.append(f"`max_age {show_ns(least).replace(' ', '')}` of `{topic.name}`")
    if not told:
        return None
    system = derived_systems.with_changed_topics(problem.system, changed)
    again = _read_again(problem, system, problem.module)
    return None if again is None else (again, tuple(told))


def without_ends(problem: Problem, state: int) -> Problem | None:
    """The axis of a state `open`; that nothing reads the state is seen when it is tried."""
    if problem.computed or len(problem.groups) > 1 or problem.kind != "flow":
        return None
    group = problem.groups[0]
    if any(a.open or a.unbounded or a.wraps for a in group.axes) or group.representation != "grid":
        return None
    axes = tuple(_unbounded(a) if a.state == state else a for a in group.axes)
    states = list(problem.states)
    edges = next(a.edges for a in axes if a.state == state)
    states[state] = Interval(edges[0], edges[-1])
    groups = (replace(group, axes=axes),)
    return replace(problem, groups=groups, declared_groups=(), states=tuple(states))


def longer_axes(problem: Problem, ends: Mapping[int, tuple[float, float]]) -> Problem:
    """Axes with more cells of the same size; `ends`: by state, from where to where."""
    states = list(problem.states)

    def changed(axis: Axis) -> Axis:
        if axis.state not in ends:
            return axis
        edges = extended(np.array(axis.edges), *ends[axis.state])
        states[axis.state] = Interval(float(edges[0]), float(edges[-1]))
        return replace(axis, edges=tuple(edges.tolist()))

    groups = tuple(replace(g, axes=tuple(changed(a) for a in g.axes)) for g in problem.groups)
    return replace(problem, groups=groups, declared_groups=(), states=tuple(states))


def exchanged(problem: Problem) -> Problem | None:
    """AC in the place of SC."""
    m, components = problem.module, problem.system.components
    if problem.below:
        return None
    symbol = replace(m.symbol, ac=m.symbol.sc, sc=m.symbol.ac)
    roles = replace(components[m.ac], role="sc"), replace(components[m.sc], role="ac")
    system = derived_systems.with_components(problem.system, roles)
    return _read_again(problem, system, replace(m, ac=m.sc, sc=m.ac, symbol=symbol))


def _read_again(problem: Problem, system: System, module: Module) -> Problem | None:
    """The problem of a module that was changed in its own verification system.

    Grids that were changed before stay so.
    """
    whole = problem.view or problem.modes or problem.influences or problem.law
    if whole or problem.module.symbol.verify.abstracts:
        return None
    if module.shield is not None:  # what it permitted was of the other sets
        module = replace(module, shield=replace(module.shield, held=None, permits=None, moved=()))
    try:
        again = extract(derived_systems.with_module(system, module), module)
    except SoterError:
        return None
    if again.computed and any(a.unbounded for g in problem.groups for a in g.axes):
        return None  # R007
    return replace(again, groups=problem.groups, states=problem.states)


# ---------------------------------------------------------------- grids


def _size(group: Group) -> int:
    return int(np.prod([len(a.edges) - 1 for a in group.axes], dtype=np.int64))


def _merged(group: Group, most: int) -> Group:
    if group.representation != "grid" or _size(group) <= most:
        return group
    step = int(np.ceil((_size(group) / most) ** (1 / len(group.axes))))
    return replace(group, axes=tuple(_every(a, step) for a in group.axes))


def _every(axis: Axis, step: int) -> Axis:
    edges = axis.edges[::step]
    last = axis.edges[-1]
    return replace(axis, edges=edges if edges[-1] == last else (*edges, last))


def _unbounded(axis: Axis) -> Axis:
    width = axis.edges[-1] - axis.edges[0]
    ends = (axis.edges[0] - width, *axis.edges, axis.edges[-1] + width)
    return replace(axis, edges=ends, unbounded=True)

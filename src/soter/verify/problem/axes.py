"""Makes groups and axes: which states are analysed together, over which boxes.

Purpose: `Axes` reads the `grid` lines of a module, and makes default groups for bounded states
that no line names. `states_that_wrap` looks at the axes that are a full turn long. It finds the
states that only periodic functions read, and names a reader of each other one.
Non-goals: whether a partition is useful: a bad one proves less, and nothing wrong; sets that wrap
around (`verify/engine/soter_reach_grid.c`), the DM's table (`verify/deploy/level_tables.py`).

Periodic functions take sums in which the state itself stands. `SOTER_FAR_TURNS` of
`verify/engine/soter_form_math.h` bounds the error of such a sum where the state is many turns away.
The bound holds up to `FARTHEST`, and a proof assumes that every such state stays below it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

from soter.language.check.constants_and_types import Calculator
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import ListType, RecordType, leaf_name, leaves
from soter.verify.enclose.compiled_enclosures import generate_enclosures
from soter.verify.enclose.enclosed_operations import FAR_TURNS, FARTHEST, TURN
from soter.verify.enclose.enclosure_emitter import EnclosureError
from soter.verify.problem.left_out_states import MOVING, reader_in_words
from soter.verify.problem.problem import Assumption, Axis, Group, Interval

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.core.core import CoreSystem
    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.model.system import Component
    from soter.verify.problem.inputs import Inputs
    from soter.verify.problem.problem import Problem, Quantities
    from soter.verify.problem.verification_system import VerificationSystem

AXES_MAX = 4
CELLS_MAX = 200_000_000
AXIS_CELLS_MAX = 60_000
WIDEST = 1e6
"""The largest width of a cell up to an open end, in ranges of its axis."""
DEFAULT_CELLS = {1: 2000, 2: 300, 3: 64, 4: 24}
BESIDE = 100
"""The number of cells of a state that no `grid` line names, beside states that one does."""
FINDS = "`soter verify FILE --write` finds a grid or `rest` and puts it here"
"""The first help of R008; after a search that found nothing it is left out."""
Path = tuple[str, ...]
NEAR = 2.0**-44
"""By how many rad the written length of a full turn may be off by rounding."""
NEARLY = 0.1
"""An axis whose length is this near to a full turn, in rad, as [-3.14, 3.14], was meant as one."""
COVERED_BY_OTHERS = frozenset({"drives", MOVING})
"""Functions whose reads do not count, as other functions of the same proof read the same."""


class Axes:
    """Finds the state that each axis names, and makes the axes and groups of a problem."""

    def __init__(
        self,
        place: VerificationSystem,
        inputs: Inputs,
        diagnostics: Diagnostics,
        readers: Mapping[str, str] | None = None,
    ) -> None:
        """Takes the inputs; `readers`: a function that reads each unbounded state, by its name."""
        self.readers = readers or {}
        self.place = place
        self.inputs = inputs
        self.diagnostics = diagnostics
        self.calculator = Calculator(diagnostics, place.module.scope.params)
        self.names = {leaf.name: i for i, leaf in enumerate(inputs.states)}
        self.topic_leaves = self._state_by_topic_leaf()
        self.shown: dict[int, tuple[int, int]] = {}
        """For each state the (topic, leaf) by which an axis names it."""

    def groups(self) -> tuple[Group, ...]:
        """The declared groups, and groups for all bounded states that are on no declared axis."""
        declared_groups = [self._declared_group(g) for g in self.place.module.symbol.verify.groups]
        groups = [g for g in declared_groups if g.axes]
        self._refuse_repeated_states(groups)
        missing = set(range(len(self.inputs.states))) - {a.state for g in groups for a in g.axes}
        if not self.diagnostics.has_errors and missing:
            groups += self._default_groups(sorted(missing), alone=bool(groups))
        return tuple(groups)

    def boundless_states(self) -> frozenset[int]:
        """The numbers of the moving states that have no declared axis and no bounds."""
        named = {
            self._state_named_by(a) for g in self.place.module.symbol.verify.groups for a in g.axes
        }
        others = (s for s in range(len(self.inputs.states)) if s not in named)
        moving = (s for s in others if s not in self.inputs.still)
        return frozenset(s for s in moving if self._range_in_program(s) is None)

    def _refuse_repeated_states(self, groups: list[Group]) -> None:
        """Reports R009 if two axes, perhaps with different names, stand for the same state."""
        seen: set[int] = set()
        for group in groups:
            for axis in group.axes:
                if axis.state in seen:
                    self.diagnostics.error(
                        "R009",
                        f"two axes are the same state, `{axis.name}`",
                        group.span or self.place.module.symbol.span,
                        notes=("every state is analysed once",),
                        helps=("keep one of them",),
                    )
                seen.add(axis.state)

    def _declared_group(self, group: typed.TypedAxisGroup) -> Group:
        axes = []
        for item in group.axes:
            state = self._state_of_declared_axis(item)
            if state is not None:
                axes.append(self._declared_axis(item, state))
        cells = math.prod(len(a.edges) - 1 for a in axes)
        longest = max((len(a.edges) - 1 for a in axes), default=1)
        large = len(axes) > AXES_MAX or cells > CELLS_MAX or longest > AXIS_CELLS_MAX
        if large:
            self.diagnostics.error(
                "R010",
                f"this grid has {len(axes)} axes and {cells} cells",
                group.span,
                notes=(
                    f"one group has at most {AXES_MAX} axes and {CELLS_MAX} cells",
                    f"and one axis at most {AXIS_CELLS_MAX}",
                ),
                helps=(
                    "states that do not interact may stand in `grid` lines of their own",
                    "or use fewer cells",
                ),
            )
        return Group(tuple(axes), group.span)

    def _declared_axis(self, item: typed.TypedGridAxis, state: int) -> Axis:
        leaf = self.inputs.states[state]
        name, unit = leaf.name, leaf.unit
        low, high = (
            float(self.calculator.value(e, "a bound") or 0.0) for e in (item.low, item.high)
        )
        cells = self.calculator.value(item.cells, "the number of cells")
        edges = self._even_breakpoints(low, high, int(cells or 1), item)
        written = tuple((v, e.span.text) for v, e in ((low, item.low), (high, item.high)))
        if item.unbounded:
            width = high - low
            edges = (low - width, *edges, high + width)
            return Axis(state, name, edges, unbounded=True, unit=unit, written=written)
        if item.open is None:
            return Axis(state, name, edges, unit=unit, written=written)
        end = float(self.calculator.value(item.open, "the end of an open axis") or 0.0)
        if not end - low < WIDEST * (high - low):
            self.diagnostics.error(
                "R010",
                f"the open end of `{name}` lies more than {WIDEST:g} times its range away",
                item.open.span,
                notes=("enclosures over such a cell say nothing",),
                helps=("an end that no run passes, not far beyond what matters",),
            )
        written = (*written, (end, item.open.span.text))
        return Axis(state, name, (*edges, end), open=True, unit=unit, written=written)

    def _even_breakpoints(
        self, low: float, high: float, cells: int, item: typed.TypedGridAxis | None = None
    ) -> tuple[float, ...]:
        """The breakpoints of `cells` equal cells; reports R010 if too few floats lie between."""
        edges = [low + (high - low) * (i / cells) for i in range(cells)] + [high]
        if any(a >= b for a, b in pairwise(edges)) and item is not None:
            self.diagnostics.error(
                "R010",
                f"{cells} cells are too many for [{low!r}, {high!r}]",
                item.span,
                notes=("there are not as many floats between the bounds",),
            )
        return tuple(edges)

    def topic_range_of_state(self, state: int) -> tuple[float, float]:
        """The ends of the set of a topic that equals the state; (-inf, inf) if no topic does."""
        for (topic, leaf), s in self.topic_leaves.items():
            bound = self.place.system.topics[topic].bounds[leaf]
            if s == state and bound is not None:
                return bound.low, bound.high
        return -math.inf, math.inf

    def _state_of_declared_axis(self, item: typed.TypedGridAxis) -> int | None:
        """The state that an axis names; None with R009 if it names none. Notes the axis's topic."""
        shown = leaf_name(item.topic.name if item.topic else item.instance, item.path)
        state, topic_leaf = self._state_named_by(item), self._topic_leaf_named_by(item)
        if topic_leaf is not None and state is not None:
            self.shown[state] = topic_leaf
        if state is None:
            state_names = ", ".join(f"`{n}`" for n in self.names)
            self.diagnostics.error(
                "R009",
                f"the axis `{shown}` is no state of a verification plant",
                item.span,
                notes=(
                    "an axis names a state, or a leaf of a topic that equals one",
                    f"the states are {state_names}" if state_names else "there are no states",
                    *self._notes_on_driven_topic(item),
                ),
                helps=("drive the state and scale it in controllers, or an axis over the state",),
            )
        return state

    def _state_named_by(self, item: typed.TypedGridAxis) -> int | None:
        """The state that an axis names, directly or by a topic; None if there is none."""
        if item.topic is None:
            return self.names.get(self.place.prefix + leaf_name(item.instance, item.path))
        at = self._topic_leaf_named_by(item)
        return None if at is None else self.topic_leaves.get(at)

    def _topic_leaf_named_by(self, item: typed.TypedGridAxis) -> tuple[int, int] | None:
        """The (topic, leaf) that an axis names; None if the axis names a state."""
        index = None if item.topic is None else self._topic_index(item.topic)
        if item.topic is None or index is None:
            return None
        return index, [p for p, _ in leaves(item.topic.type)].index(item.path)

    def _notes_on_driven_topic(self, item: typed.TypedGridAxis) -> tuple[str, ...]:
        """Notes on how a plant drives an axis's topic; empty if no plant drives it."""
        for c in self.place.plants:
            for topic, value in c.plant.drives if c.plant is not None else ():
                if topic is item.topic:
                    text = value.span.text_on_one_line
                    return (f"plant `{c.name}` drives `{topic.name}` as `{text}`",)
        return ()

    def _topic_index(self, symbol: typed.TopicSymbol) -> int | None:
        scopes = [
            self.place.module.scope,
            self.place.sc.scope,
            *(c.scope for c in self.place.plants),
        ]
        return next((s.topics[symbol] for s in scopes if symbol in s.topics), None)

    def _default_groups(self, missing: list[int], *, alone: bool) -> list[Group]:
        """Groups for states without a `grid` line, one each if `alone`; R008 without a range."""
        ranges = {s: self._range_in_program(s) for s in missing}
        unbounded = [s for s in missing if ranges[s] is None]
        if unbounded:
            names = [self.inputs.states[s].name for s in unbounded]
            symbol = self.place.module.symbol
            self._refuse_unbounded(names, symbol.verify.span or symbol.span)
            return []
        if not alone and len(missing) <= AXES_MAX:
            cells = DEFAULT_CELLS[len(missing)]
            return [Group(tuple(self._axis_over_range(s, cells, ranges[s]) for s in missing))]
        cells = BESIDE if alone else DEFAULT_CELLS[1]
        return [
            Group((self._axis_over_range(s, 1 if self._needs_one_cell(s) else cells, ranges[s]),))
            for s in missing
        ]

    def _needs_one_cell(self, state: int) -> bool:
        """Whether a state needs only one cell, as it never changes and no topic shows it."""
        plants = [c.plant for c in self.place.plants if c.plant is not None]
        parts = nodes([e for p in plants for _, e in (*p.drives, *p.lets)])
        names = {n.variable.name for n in parts if isinstance(n, typed.VarRead)}
        return state in self.inputs.still and self.inputs.states[state].member not in names

    def _refuse_unbounded(self, names: list[str], span: Span) -> None:
        self.diagnostics.error(
            "R008",
            f"nothing bounds the state{'s' if len(names) > 1 else ''} "
            + ", ".join(f"`{n}`" for n in names),
            span,
            notes=(
                "every state is analysed over a box; outside it counts as unsafe",
                *(f"`{n}` is read by {self.readers[n]}" for n in names if n in self.readers),
            ),
            helps=(FINDS, f"or say it: `verify {{ grid {names[0]} in [low, high] / cells; }}`"),
        )

    def _range_in_program(self, state: int) -> Interval | None:
        """The start of a state that never changes, otherwise its topic's set; None if unbounded."""
        if state in self.inputs.still:
            start = self.inputs.initial[state]
            return start if start.low < start.high else None
        low, high = self.topic_range_of_state(state)
        return Interval(low, high) if math.isfinite(low) and math.isfinite(high) else None

    def _axis_over_range(self, state: int, cells: int, extent: Interval | None) -> Axis:
        assert extent is not None
        edges = self._even_breakpoints(extent.low, extent.high, cells)
        leaf = self.inputs.states[state]
        return Axis(state, leaf.name, edges, unit=leaf.unit)

    def _state_by_topic_leaf(self) -> dict[tuple[int, int], int]:
        """The number of the state that each topic leaf equals, by (topic, leaf)."""
        state_by_leaf = {}
        for c in self.place.plants:
            assert c.plant is not None
            for topic, value in c.plant.drives:
                for i, (path, _) in enumerate(leaves(topic.type)):
                    at = self._driven_state(c, value, path)
                    if at is not None and at in self.names:
                        state_by_leaf[c.scope.topics[topic], i] = self.names[at]
        return state_by_leaf

    def _driven_state(self, c: Component, e: typed.TypedExpr, path: Path) -> str | None:
        """The full name of the state leaf that `e` equals at `path`; None if it equals no leaf."""
        assert c.plant is not None
        if isinstance(e, typed.VarRead):
            lets = dict(c.plant.lets)
            if e.variable in lets:
                return self._driven_state(c, lets[e.variable], path)
            return leaf_name(f"{c.name}.{e.variable.name}", path)
        if isinstance(e, typed.TypedField) and isinstance(e.target.type, RecordType):
            name = e.target.type.fields[e.index][0]
            return self._driven_state(c, e.target, (name, *path))
        if isinstance(e, typed.Index) and isinstance(e.index, typed.Literal):
            return self._driven_state(c, e.target, (f"[{e.index.value}]", *path))
        if isinstance(e, typed.Aggregate) and path:
            t = e.type
            if isinstance(t, ListType):
                return None  # its length decides which elements it has
            if not isinstance(t, RecordType):
                return self._driven_state(c, e.elements[int(path[0][1:-1])], path[1:])
            field = t.index(path[0])
            order = e.order or tuple(range(len(e.elements)))
            return (
                None
                if field is None
                else self._driven_state(c, e.elements[order.index(field)], path[1:])
            )
        return None


def states_that_wrap(
    at: VerificationSystem, core: CoreSystem, quantities: Quantities, groups: tuple[Group, ...]
) -> tuple[frozenset[int], dict[str, str]]:
    """The states whose axes wrap around; for each other angle, by name, who reads its turns.

    This reader is "" if nobody reads them but the axis is not exactly a turn long. In a view, or
    with `enters` or a `shield`, no state wraps.
    """
    symbol = at.module.symbol
    settled = not (at.module.view or symbol.verify.enters is not None or symbol.shield is not None)
    axes = [a for g in groups for a in g.axes if _is_full_turn(a, NEARLY)]
    found: set[int] = set()
    readers: dict[str, str] = {}
    for axis in axes if settled else ():
        try:
            read = _readers_of_turns(at, core, quantities, axis.state)
        except EnclosureError:
            continue  # it is reported where everything is enclosed
        if read:
            readers[axis.name] = reader_in_words(read, quantities)
        elif _is_full_turn(axis, NEAR):
            found.add(axis.state)
        else:
            readers[axis.name] = ""
    return frozenset(found), readers


def _is_full_turn(axis: Axis, off: float) -> bool:
    """Whether an axis is as long as a full turn, with a difference of at most `off` rad."""
    low, high = axis.edges[0], axis.edges[-1]
    long = abs(high - low - TURN) <= off and max(-low, high) <= 1.5 * TURN
    return long and not (axis.open or axis.unbounded)


def _readers_of_turns(
    at: VerificationSystem, core: CoreSystem, quantities: Quantities, state: int
) -> frozenset[str]:
    """The names of a proof's functions that depend on the number of turns of a state."""
    turning = replace(quantities, turning=frozenset({state}))
    unit = generate_enclosures(at.system, core, at.module, turning, apart=True)
    return frozenset(name for name in unit.of_turns if name not in COVERED_BY_OTHERS)


def groups_that_wrap(groups: tuple[Group, ...], states: frozenset[int]) -> tuple[Group, ...]:
    """A copy of the groups in which exactly the axes of these states wrap around."""
    return tuple(
        replace(g, axes=tuple(replace(a, wraps=a.state in states) for a in g.axes)) for g in groups
    )


def starts_on_axes(groups: tuple[Group, ...], starts: Sequence[Interval]) -> tuple[Interval, ...]:
    """The ranges of starts; a range on an axis that wraps is moved onto the axis by whole turns.

    A moved range begins on the axis, and may go on beyond the axis's upper end.
    """
    near = list(starts)
    for axis in (a for g in groups for a in g.axes if a.wraps):
        (first, last), start = (axis.edges[0], axis.edges[-1]), near[axis.state]
        far = max(-start.low, start.high) > FARTHEST  # more than what is assumed of such a state
        if far or first <= start.low <= start.high <= last:
            continue
        if start.high - start.low >= TURN:
            near[axis.state] = Interval(first, last)
            continue
        back = TURN * math.floor((start.low - first) / TURN)
        near[axis.state] = Interval(start.low - back - FAR_TURNS, start.high - back + FAR_TURNS)
    return tuple(near)


def law_with_same_wrapping(law: Problem, states: frozenset[int]) -> Problem:
    """The problem of a fail-safe law in which axes wrap only if they wrap for the module, too."""
    kept = law.quantities.turning & states
    quantities = replace(law.quantities, turning=kept)
    return replace(law, quantities=quantities, groups=groups_that_wrap(law.groups, kept))


def far_turns_assumption(groups: tuple[Group, ...]) -> list[Assumption]:
    """The assumption that states on axes that wrap around stay within `FARTHEST`."""
    names = [a.name for g in groups for a in g.axes if a.wraps]
    if not names:
        return []
    names_text = ", ".join(f"`{n}`" for n in names)
    text = (
        f"{names_text} stays within {FARTHEST:,.0f} rad of 0 "
        f"({FARTHEST / TURN:,.0f} turns): it is read "
        "modulo a full turn, and its axis wraps around"
    )
    return [Assumption("turns", text)]

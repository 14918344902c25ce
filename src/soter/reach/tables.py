"""Computed predicates as functions of the program: a table, and how it is read.

Purpose: levels of estimates (0: ttf, 1: in S_0, 2: in S_(m-2)) packed four cells a byte, and
checked expressions for `ttf` and `safer` that interpreter, Core and C see like any other.
Non-goals: the sets (`levels.py`), when they are computed (`complete.py`), half-spaces
(`facets.py`).

Why reading is sound. S_j is a set of closed cells. `place` looks for the cell by halving, then
compares the estimate with the two breakpoints of the cell it found: comparisons are exact, so an
entry is used only if the estimate lies in that closed cell, whichever of two neighbours a point of
a shared face came to. NaN, infinities and everything outside the grid fail the comparison: level 0,
that is `ttf` and not `safer`. The time is bounded: ceil(log2 n) + 2 comparisons an axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.program import typed as t
from soter.program.types import BOOL, FLOAT, INT, ArrayType, IntType, RecordType, leaves
from soter.reach.estimates import seen
from soter.reach.facets import Facets, facets_function

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.diagnostics.span import Span
    from soter.program.types import Type, Value
    from soter.reach.polytope_sets import Polytope
    from soter.reach.problem import Group, Problem
    from soter.reach.results import CaseSets

    Pair = tuple[NDArray[np.bool_], NDArray[np.bool_]] | tuple[Polytope, Polytope]
    Bools = NDArray[np.bool_]

PER_BYTE = 4
POWERS = (1, 4, 16, 64)
FULL = 2
"""The level at which AC may have control back."""


@dataclass(frozen=True, eq=False)
class Table:
    """The levels of one group over the axes that the DM sees."""

    states: tuple[int, ...]
    edges: tuple[tuple[float, ...], ...]
    entries: NDArray[np.uint8]
    """0, 1, 2 a cell."""

    @property
    def packed(self) -> tuple[int, ...]:
        """Four cells a byte, the first in the lowest bits; C order."""
        flat = self.entries.ravel()
        flat = np.concatenate([flat, np.zeros(-len(flat) % PER_BYTE, dtype=np.uint8)])
        four = flat.reshape(-1, PER_BYTE) @ np.array(POWERS, dtype=np.uint8)
        return tuple(int(v) for v in four)

    @property
    def share(self) -> float:
        """Share of the cells that are in S_0."""
        return float((self.entries > 0).mean())

    @property
    def full(self) -> tuple[float, ...] | None:
        """The middle of a cell of S_(m-2); None where there is none."""
        best = np.unravel_index(int(self.entries.argmax()), self.entries.shape)
        if self.entries[best] != FULL:
            return None
        cells = zip(self.edges, best, strict=True)
        return tuple(e[int(i)] / 2 + e[int(i) + 1] / 2 for e, i in cells)


def in_order(problem: Problem) -> list[Group]:
    """The groups as tables have them: grids first."""
    return sorted(problem.groups, key=lambda g: g.representation != "grid")


def tables(problem: Problem, cases: Sequence[Sequence[Pair]]) -> list[Table | Facets]:
    """A table for each group from (S_0, S_(m-2)) per case and group: what holds in every case.

    Groups in the order of `in_order`; of a polytope group the two are polytopes.
    """
    shown = seen(problem)
    found: list[Table | Facets] = []
    for i, group in enumerate(in_order(problem)):
        if group.representation != "grid":
            states = [a.state for a in group.axes]
            found.append(Facets.of(states, [case[i] for case in cases]))  # type: ignore[misc]
            continue
        sure = np.logical_and.reduce([np.asarray(case[i][0]) for case in cases])
        inner = np.logical_and.reduce([np.asarray(case[i][1]) for case in cases]) & sure
        entries = sure.astype(np.uint8) + inner.astype(np.uint8)
        kept = [k for k, a in enumerate(group.axes) if a.state in shown]
        unseen = tuple(k for k in range(entries.ndim) if k not in kept)
        axes = [group.axes[k] for k in kept]
        found.append(
            Table(
                tuple(a.state for a in axes),
                tuple(a.edges for a in axes),
                np.asarray(entries.min(axis=unseen)) if unseen else entries,
            )
        )
    return found


def pairs_of(case: CaseSets) -> list[Pair]:
    """(S_0, S_(m-2)) of the groups of a case that have them, in the order of `in_order`."""
    found: list[Pair] = [(g.levels[0], g.levels[-1]) for g in case.groups if g.levels]
    sets = [part.sets for part in case.polytopes if part.sets is not None]
    return found + [(s.allowed[0], s.safer) for s in sets if s.allowed]


def predicates(problem: Problem, found: Sequence[Table | Facets]) -> tuple[t.Expr, t.Expr]:
    """(ttf, safer): some group below level 1, every group at level 2."""
    symbol = problem.module.symbol
    w = Writer(symbol.span)
    shown = seen(problem)
    lows, highs = [], []
    for i, table in enumerate(found):
        name = f"{symbol.name}_level{i if len(found) > 1 else ''}"
        fun = (
            facets_function(w, name, table)
            if isinstance(table, Facets)
            else level_function(w, name, table)
        )
        arguments = []
        for state in table.states:
            topic, leaf = problem.topic_leaf_of_state[state]
            path = list(leaves(problem.system.topics[topic].type))[leaf][0]
            arguments.append(w.leaf(shown[state], path))
        lows.append(w.op("<", w.call(fun, *arguments), w.number(1)))
        highs.append(w.op(">=", w.call(fun, *arguments), w.number(2)))
    return w.chain("||", lows), w.chain("&&", highs)


# ---------------------------------------------------------------- functions


def place_function(w: Writer, name: str, edges: Sequence[float]) -> t.FunSymbol:
    """`fun place(x: float): int`: a cell that contains x, or -1 where there is none."""
    count = len(edges) - 1
    table = w.array(f"{name}_EDGES", FLOAT, tuple(float(e) for e in edges))
    x = w.variable("x", "parameter", FLOAT)
    low, high = (w.variable(n, "var", INT) for n in ("low", "high"))
    mid, step = w.variable("mid", "let", INT), w.variable("step", "loop", INT)
    middle = w.op("/", w.op("+", w.read(low), w.read(high)), w.number(2))
    above = w.op(">=", w.read(x), w.at(table, w.read(mid)))
    halve = t.If(w.span, ((above, (w.assign(low, mid),)),), (w.assign(high, mid),))
    rounds = (count - 1).bit_length()
    search = t.ForRange(w.span, step, 0, rounds, (w.declare(mid, middle), halve))
    first = w.at(table, w.read(low))
    last = w.at(table, w.op("+", w.read(low), w.number(1)))
    inside = w.op("&&", w.op(">=", w.read(x), first), w.op("<=", w.read(x), last))
    answer = t.Conditional(INT, w.span, inside, w.read(low), w.number(-1))
    begin = [w.declare(low, w.number(0)), w.declare(high, w.number(count))]
    return w.function(name, (x,), [*begin, *([search] if rounds else []), w.give(answer)])


def level_function(w: Writer, name: str, table: Table) -> t.FunSymbol:
    """`fun level(x0: float, ...): int`: 0, 1 or 2 for an estimate; 0 outside the grid."""
    inputs = tuple(w.variable(f"x{k}", "parameter", FLOAT) for k in range(len(table.edges)))
    body: list[t.Stmt] = []
    cell: t.Expr = w.number(0)
    outside = []
    for k, (x, edges) in enumerate(zip(inputs, table.edges, strict=True)):
        found = w.variable(f"i{k}", "let", INT)
        place = place_function(w, f"{name}_place{k}", edges)
        body.append(w.declare(found, w.call(place, w.read(x))))
        cell = w.op("+", w.op("*", cell, w.number(len(edges) - 1)), w.read(found))
        outside.append(w.op("<", w.read(found), w.number(0)))
    if outside:
        body.append(t.If(w.span, ((w.chain("||", outside), (w.give(w.number(0)),)),), ()))
    at = w.variable("cell", "let", INT)
    body.append(w.declare(at, cell))
    packed = w.array(f"{name}_TABLE", IntType(0, 255), table.packed)
    powers = w.array(f"{name}_POWERS", INT, POWERS)
    four = w.number(PER_BYTE)
    byte = w.at(packed, w.op("/", w.read(at), four))
    shifted = w.op("/", byte, w.at(powers, w.op("%", w.read(at), four)))
    return w.function(name, inputs, [*body, w.give(w.op("%", shifted, four))])


class Writer:
    """Builds checked trees that stand at one place of the program."""

    def __init__(self, span: Span) -> None:
        self.span = span

    def number(self, value: int) -> t.Expr:
        """An int."""
        return t.Literal(INT, self.span, value)

    def variable(self, name: str, kind: str, type_: Type) -> t.Variable:
        """A variable."""
        return t.Variable(name, type_, kind, self.span, used=True)

    def read(self, variable: t.Variable) -> t.Expr:
        """A variable's value."""
        return t.VarRead(variable.type, self.span, variable)

    def op(self, op: str, left: t.Expr, right: t.Expr) -> t.Expr:
        """Arithmetic on ints, or a comparison, or a connective."""
        return t.Binary(INT if op in "+-*/%" else BOOL, self.span, op, left, right)

    def chain(self, op: str, terms: Sequence[t.Expr]) -> t.Expr:
        """Several booleans joined."""
        first, *rest = terms
        for term in rest:
            first = self.op(op, first, term)
        return first

    def at(self, array: t.Expr, index: t.Expr) -> t.Expr:
        """An element."""
        assert isinstance(array.type, ArrayType)
        return t.Index(array.type.element, self.span, array, index)

    def array(self, name: str, element: Type, values: tuple[Value, ...]) -> t.Expr:
        """A constant table."""
        return t.Literal(ArrayType(element, len(values)), self.span, values, name)

    def leaf(self, topic: t.TopicSymbol, path: Sequence[str]) -> t.Expr:
        """One leaf of a topic."""
        e: t.Expr = t.TopicRead(topic.type, self.span, topic)
        for part in path:
            if isinstance(e.type, RecordType):
                index = e.type.index(part)
                assert index is not None
                e = t.Field(e.type.fields[index][1], self.span, e, index)
            else:
                e = self.at(e, self.number(int(part[1:-1])))
        return e

    def declare(self, variable: t.Variable, value: t.Expr) -> t.Stmt:
        """`let` or `var`."""
        return t.Declare(self.span, variable, value)

    def assign(self, variable: t.Variable, value: t.Variable) -> t.Stmt:
        """`variable = value;`."""
        place = t.Place(variable, (), variable.type, self.span)
        return t.Assign(self.span, place, self.read(value))

    def give(self, value: t.Expr) -> t.Stmt:
        """`return value;`."""
        return t.Return(self.span, value)

    def function(
        self, name: str, parameters: tuple[t.Variable, ...], body: list[t.Stmt]
    ) -> t.FunSymbol:
        """A function with an int result."""
        return t.FunSymbol(name, self.span, parameters, INT, tuple(body), False, None)

    def call(self, fun: t.FunSymbol, *arguments: t.Expr) -> t.Expr:
        """A call."""
        return t.Call(fun.result, self.span, fun, arguments)

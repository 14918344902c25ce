"""Writes computed predicates as functions of the program, which read tables of levels.

Purpose: `LevelTable` is the interface of every table of levels. A `GroupTable` is the table of a
grid: it holds the level of each cell of estimates (0: ttf, 1: in S_0, 2: in S_(m-2)), four cells a
byte. `predicates_of_tables` writes `ttf` and `safer` as checked expressions, which the interpreter,
Core and C treat like any other. `Writer` builds such expressions, at one place of the program.
Non-goals: the sets (`grid/estimate_sets.py`), when they are computed (`missing_predicates.py`).

Why reading is sound. S_j is a set of closed cells. `place` looks for the cell by halving, then
compares the estimate with the two breakpoints of the cell it found: comparisons are exact, so an
entry is used only if the estimate lies in that closed cell, whichever of two neighbours a point of
a shared face came to. NaN, infinities and everything outside the grid fail the comparison: level 0,
that is `ttf` and not `safer`. The time is bounded: ceil(log2 n) + 2 comparisons an axis.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.language.model import typed as t
from soter.language.model.types import (
    BOOL,
    FLOAT,
    INT,
    ArrayType,
    IntType,
    RecordType,
    leaf_name,
    leaves,
)
from soter.language.model.values import Table, is_table
from soter.verify.enclose.enclosed_operations import FARTHEST, TURN
from soter.verify.grid.set_figures import drawn_edges, volume_share
from soter.verify.problem.inputs import topics_seen_by_dm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.core.layout import Bools
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.typed import FunSymbol, TypedExpr
    from soter.language.model.types import Type, Value
    from soter.verify.claims.results import CaseSets
    from soter.verify.problem.problem import Group, Problem

    Pairs = list["Estimates"]
    """(S_0, S_(m-2)) of each group."""


class Writer:
    """Builds checked expressions and statements, all at one position in the program's text."""

    def __init__(self, span: Span) -> None:
        self.span = span

    def integer(self, value: int) -> t.TypedExpr:
        """An int literal."""
        return t.Literal(INT, self.span, value)

    def decimal(self, value: float) -> t.TypedExpr:
        """A float literal."""
        return t.Literal(FLOAT, self.span, value)

    def floats(self, values: Sequence[t.TypedExpr]) -> t.TypedExpr:
        """An array expression of these numbers."""
        return t.Aggregate(ArrayType(FLOAT, len(values)), self.span, tuple(values))

    def real_op(self, op: str, left: t.TypedExpr, right: t.TypedExpr) -> t.TypedExpr:
        """An arithmetic operation on two float expressions."""
        return t.TypedBinary(FLOAT, self.span, op, left, right)

    def variable(self, name: str, kind: str, type_: Type) -> t.Variable:
        """A new variable."""
        return t.Variable(name, type_, kind, self.span, used=True)

    def read(self, variable: t.Variable) -> t.TypedExpr:
        """The expression that reads a variable."""
        return t.VarRead(variable.type, self.span, variable)

    def op(self, op: str, left: t.TypedExpr, right: t.TypedExpr) -> t.TypedExpr:
        """An operation on two operands: int arithmetic, a comparison, or a connective."""
        return t.TypedBinary(INT if op in "+-*/%" else BOOL, self.span, op, left, right)

    def chain(self, op: str, terms: Sequence[t.TypedExpr]) -> t.TypedExpr:
        """An expression that joins several booleans by a connective."""
        first, *rest = terms
        for term in rest:
            first = self.op(op, first, term)
        return first

    def element_at(self, array: t.TypedExpr, index: t.TypedExpr) -> t.TypedExpr:
        """The expression of the element of an array at an index."""
        assert isinstance(array.type, ArrayType)
        return t.Index(array.type.element, self.span, array, index)

    def array(self, name: str, element: Type, values: tuple[Value, ...]) -> t.TypedExpr:
        """A named constant array."""
        return t.Literal(ArrayType(element, len(values)), self.span, values, name)

    def table_of_bytes(self, name: str, values: bytes) -> t.TypedExpr:
        """A constant array of ints in [0, 255]; a long one is written as data."""
        element = IntType(0, 255)
        of = ArrayType(element, len(values))
        if not is_table(of):
            return self.array(name, element, tuple(values))
        numbers = np.frombuffer(values, dtype=np.uint8).astype("<i8")
        return t.Literal(of, self.span, Table(element, numbers.tobytes()), name)

    def leaf_of(self, topic: t.TopicSymbol, path: Sequence[str]) -> t.TypedExpr:
        """The expression that reads one leaf of a topic."""
        e: t.TypedExpr = t.TopicRead(topic.type, self.span, topic)
        for part in path:
            if isinstance(e.type, RecordType):
                index = e.type.index(part)
                assert index is not None
                e = t.TypedField(e.type.fields[index][1], self.span, e, index)
            else:
                e = self.element_at(e, self.integer(int(part[1:-1])))
        return e

    def declare(self, variable: t.Variable, value: t.TypedExpr) -> t.TypedStmt:
        """The declaration of a variable, by `let` or `var` as its kind demands."""
        return t.TypedDeclare(self.span, variable, value)

    def assign(self, variable: t.Variable, value: t.Variable) -> t.TypedStmt:
        """The statement `variable = value;`."""
        place = t.Place(variable, (), variable.type, self.span)
        return t.TypedAssign(self.span, place, self.read(value))

    def result(self, value: t.TypedExpr) -> t.TypedStmt:
        """The statement `return value;`."""
        return t.TypedReturn(self.span, value)

    def function(
        self, name: str, parameters: tuple[t.Variable, ...], body: list[t.TypedStmt]
    ) -> t.FunSymbol:
        """Makes a function with an int result."""
        return t.FunSymbol(name, self.span, parameters, INT, tuple(body), False, None)

    def call_of(self, fun: t.FunSymbol, *arguments: t.TypedExpr) -> t.TypedExpr:
        """A call of a function."""
        return t.TypedCall(fun.result, self.span, fun, arguments)


@dataclass(frozen=True, eq=False)
class EstimateSamples:
    """Estimates for trials of the compiled DM: `points` (n, states) and their `levels` (n,)."""

    points: NDArray[np.float64]
    levels: NDArray[np.uint8]


class LevelTable(ABC):
    """A table of the levels of a group's estimates: 0 (`ttf`), 1 (in S_0), 2 (in S_(m-2)).

    `states`: the states that the DM sees, in the order of the table function's arguments.
    """

    states: tuple[int, ...]
    two_levels = False
    """Whether there is no level 1."""

    @abstractmethod
    def function(self, w: Writer, name: str) -> FunSymbol:
        """The function `fun level(x0: float, ...): int`, which finds the level of an estimate."""

    def more_arguments(self, w: Writer, problem: Problem) -> list[TypedExpr]:
        """The arguments of the table's function that follow the estimate."""
        del w, problem
        return []

    @abstractmethod
    def entry(self, names: Sequence[str], stem: str, files: dict[str, bytes]) -> dict[str, object]:
        """Describes the table for a certificate; `names` are those of all states of the problem."""


PER_BYTE = 4
POWERS = (1, 4, 16, 64)
FULL = 2
"""The level at which AC may get control back."""


@dataclass(frozen=True, eq=False)
class CommandTable:
    """The commands that a shield permits.

    `tops`: for each cell and command cell i the number of the first command cell whose commands may
    not act together with those of i; 0 if those of i may not act. `control`: the number of the
    control; None if none moves the group. `lasting`: for each cell and command cell 1 where its
    commands may act for longer, else 0; None if the shield does not need it.
    """

    control: int | None
    tops: NDArray[np.uint8]
    name: str | None = None
    lasting: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class Estimates:
    """The sets S_0 (`outer`) and S_(m-2) (`inner`) of a group, in the grid's shape."""

    outer: Bools
    inner: Bools
    commands: CommandTable | None = None


@dataclass(frozen=True, eq=False)
class GroupTable(LevelTable):
    """The levels of one group over the axes that the DM sees."""

    states: tuple[int, ...]
    edges: tuple[tuple[float, ...], ...]
    entries: NDArray[np.uint8]
    """The level, 0, 1 or 2, of each cell."""
    commands: CommandTable | None = None
    wraps: tuple[bool, ...] = ()
    """For each axis whether estimates are moved back to it by whole turns; empty if none are."""

    @property
    def packed(self) -> bytes:
        """The levels in C order, four cells per byte, with the first cell in the lowest bits."""
        flat = self.entries.ravel()
        flat = np.concatenate([flat, np.zeros(-len(flat) % PER_BYTE, dtype=np.uint8)])
        four: NDArray[np.uint8] = flat.reshape(-1, PER_BYTE) @ np.array(POWERS, dtype=np.uint8)
        return four.tobytes()

    def share_of_volume(self, group: Group) -> float:
        """The share of S_0 in the volume of the axes that the DM sees."""
        axes = [a for a in group.axes if a.state in self.states]
        return volume_share(self.entries > 0, drawn_edges(axes))

    @property
    def point_inside(self) -> tuple[float, ...] | None:
        """The middle of a cell of S_(m-2); None if S_(m-2) has no cells."""
        best = np.unravel_index(int(self.entries.argmax()), self.entries.shape)
        if self.entries[best] != FULL:
            return None
        cells = zip(self.edges, best, strict=True)
        return tuple(e[int(i)] / 2 + e[int(i) + 1] / 2 for e, i in cells)

    @property
    def ends(self) -> tuple[tuple[float, ...], ...]:
        """The breakpoints of each axis."""
        return self.edges

    @property
    def samples(self) -> EstimateSamples | None:
        """The middle of every cell that contains a double, with its level; None without axes."""
        if not self.states:
            return None  # one entry for all estimates
        middle = [np.array(e[:-1]) / 2 + np.array(e[1:]) / 2 for e in self.edges]
        grids = np.meshgrid(*middle, indexing="ij")
        points = np.stack(grids, axis=-1).reshape(-1, len(middle))
        sure = self.has_double_inside
        return EstimateSamples(np.ascontiguousarray(points[sure]), self.entries.ravel()[sure])

    @property
    def has_double_inside(self) -> Bools:
        """Whether each cell (in C order) has a double between its ends: (cells,)."""
        edges = [np.array(e) for e in self.edges]
        middle = [e[:-1] / 2 + e[1:] / 2 for e in edges]
        wide = [(m > e[:-1]) & (m < e[1:]) for m, e in zip(middle, edges, strict=True)]
        return np.asarray(np.logical_and.reduce(np.meshgrid(*wide, indexing="ij")).ravel())

    def function(self, w: Writer, name: str) -> t.FunSymbol:
        """The function that finds the level of an estimate; it finds the cell by bisection."""
        return level_function(w, name, self)

    def entry(self, names: Sequence[str], stem: str, files: dict[str, bytes]) -> dict[str, object]:
        """The table's description for a certificate: breakpoints and packed levels, as in the C."""
        files[f"{stem}.bin"] = self.packed
        axes = []
        for i, (state, edges) in enumerate(zip(self.states, self.edges, strict=True)):
            files[f"{stem}_axis{i}.bin"] = np.array(edges, dtype="<f8").tobytes()
            axes.append({"state": names[state], "edges": f"{stem}_axis{i}.bin"})
        entry: dict[str, object] = {"axes": axes, "levels": f"{stem}.bin"}
        if self.commands is not None:
            files[f"{stem}_commands.bin"] = self.commands.tops.tobytes()
            entry |= {"command": self.commands.name, "commands": f"{stem}_commands.bin"}
        return entry


def pairs_of(case: CaseSets) -> Pairs:
    """The sets (S_0, S_(m-2)) of each group of a case that has such sets."""
    return [p.estimate_levels for p in case.proofs if p.estimate_levels is not None]


def tables_of_groups(problem: Problem, cases: Sequence[Pairs]) -> list[GroupTable]:
    """The table of each group, in order, with the levels that hold in every case."""
    every = zip(problem.groups, zip(*cases, strict=True), strict=True)
    return [group_table(problem, g, pairs) for g, pairs in every]


def group_table(problem: Problem, group: Group, pairs: Sequence[Estimates]) -> GroupTable:
    """Makes the table of a grid; `pairs` has (S_0, S_(m-2)) of each case, in the grid's shape."""
    shown = topics_seen_by_dm(problem)
    sure = np.logical_and.reduce([np.asarray(p.outer) for p in pairs])
    inner = np.logical_and.reduce([np.asarray(p.inner) for p in pairs]) & sure
    entries = sure.astype(np.uint8) + inner.astype(np.uint8)
    kept = [k for k, a in enumerate(group.axes) if a.state in shown]
    unseen = tuple(k for k in range(entries.ndim) if k not in kept)
    axes = [group.axes[k] for k in kept]
    return GroupTable(
        tuple(a.state for a in axes),
        tuple(a.far_breakpoints for a in axes),
        np.asarray(entries.min(axis=unseen)) if unseen else entries,
        _permitted_commands(problem, pairs, unseen),
        tuple(a.wraps for a in axes) if any(a.wraps for a in axes) else (),
    )


def _permitted_commands(
    problem: Problem, pairs: Sequence[Estimates], unseen: tuple[int, ...]
) -> CommandTable | None:
    """The commands that a shield permits in every case, for all values on axes that no DM sees."""
    every = [p.commands for p in pairs if p.commands is not None]
    if len(every) < len(pairs) or len({c.control for c in every}) != 1:
        return None
    tops = np.minimum.reduce([c.tops for c in every])
    moved = every[0].control
    name = None if moved is None else problem.quantities.controls[moved].name
    longer = [c.lasting for c in every if c.lasting is not None]
    lasting = np.minimum.reduce(longer) if longer else None
    if unseen:
        tops = tops.min(axis=unseen)
        lasting = None if lasting is None else lasting.min(axis=unseen)
    return CommandTable(moved, tops, name, lasting)


def predicates_of_tables(
    problem: Problem, level_tables: Sequence[LevelTable]
) -> tuple[t.TypedExpr, t.TypedExpr]:
    """The predicates (ttf, safer), which read the tables.

    `ttf` holds if some group is below level 1, `safer` if every group is at level 2. If no table
    has a level 1, `ttf` is "not safer".
    """
    symbol = problem.module.symbol
    w = Writer(symbol.span)
    lows, highs = [], []
    for i, each in enumerate(level_tables):
        name = f"{symbol.name}_level{i if len(level_tables) > 1 else ''}"
        fun = each.function(w, name)
        arguments = [*estimate_leaves(w, problem, each), *each.more_arguments(w, problem)]
        lows.append(w.op("<", w.call_of(fun, *arguments), w.integer(1)))
        highs.append(w.op(">=", w.call_of(fun, *arguments), w.integer(2)))
    safer = w.chain("&&", highs)
    if all(table.two_levels for table in level_tables):
        return t.TypedUnary(BOOL, symbol.span, "!", safer), safer
    return w.chain("||", lows), safer


def estimate_leaves(w: Writer, problem: Problem, table: LevelTable) -> list[t.TypedExpr]:
    """The expressions that read the estimate for a table from the topics."""
    shown, arguments = topics_seen_by_dm(problem), []
    for state in table.states:
        topic, leaf = problem.topic_leaf_of_state[state]
        path = list(leaves(problem.system.topics[topic].type))[leaf][0]
        arguments.append(w.leaf_of(shown[state], path))
    return arguments


def grid_ends(
    problem: Problem, level_tables: Sequence[LevelTable]
) -> dict[str, tuple[float, float]]:
    """The two ends of each leaf's axis, by leaf name, without axes that wrap around."""
    shown, ends = topics_seen_by_dm(problem), {}
    for x in level_tables:
        if isinstance(x, GroupTable):
            for k, (state, edges) in enumerate(zip(x.states, x.edges, strict=True)):
                if not (x.wraps and x.wraps[k]):
                    number = problem.topic_leaf_of_state[state][1]
                    path = list(leaves(shown[state].type))[number][0]
                    ends[leaf_name(shown[state].name, path)] = (edges[0], edges[-1])
    return ends


def place_function(
    w: Writer, name: str, edges: Sequence[float], *, wraps: bool = False
) -> t.FunSymbol:
    """The function `fun place(x: float): int`: the number of a cell that contains x, or -1.

    `wraps`: the function first moves x back by whole turns, if these are not too many.
    """
    count = len(edges) - 1
    table = w.array(f"{name}_EDGES", FLOAT, tuple(float(e) for e in edges))
    argument = w.variable("x", "parameter", FLOAT)
    x = w.variable("near", "let", FLOAT) if wraps else argument
    low, high = (w.variable(n, "var", INT) for n in ("low", "high"))
    mid, step = w.variable("mid", "let", INT), w.variable("step", "loop", INT)
    middle = w.op("/", w.op("+", w.read(low), w.read(high)), w.integer(2))
    above = w.op(">=", w.read(x), w.element_at(table, w.read(mid)))
    halve = t.TypedIf(w.span, ((above, (w.assign(low, mid),)),), (w.assign(high, mid),))
    rounds = (count - 1).bit_length()
    search = t.ForRange(w.span, step, 0, rounds, (w.declare(mid, middle), halve))
    first = w.element_at(table, w.read(low))
    last = w.element_at(table, w.op("+", w.read(low), w.integer(1)))
    inside = w.op("&&", w.op(">=", w.read(x), first), w.op("<=", w.read(x), last))
    begin = [w.declare(low, w.integer(0)), w.declare(high, w.integer(count))]
    if wraps:
        begin.append(w.declare(x, _without_whole_turns(w, argument, edges[0], edges[-1])))
        size = t.Builtin(FLOAT, w.span, "abs", (w.read(argument),))
        inside = w.op("&&", w.op("<=", size, w.decimal(FARTHEST)), inside)
    answer = t.Conditional(INT, w.span, inside, w.read(low), w.integer(-1))
    return w.function(name, (argument,), [*begin, *([search] if rounds else []), w.result(answer)])


def _without_whole_turns(w: Writer, x: t.Variable, low: float, high: float) -> t.TypedExpr:
    """The expression min(max(x - turn * floor((x - low) / turn), low), high): x less whole turns.

    Up to `FARTHEST` its error is below `FAR_TURNS`: the turn is off by 2^-51, so its multiple by
    2^-40; a product and two sums round by 2^-39 each; near an end the quotient may be a turn off,
    and then x is that end but for these errors.
    """
    turn = w.decimal(TURN)
    since = w.real_op("-", w.read(x), w.decimal(low))
    turns = t.Builtin(FLOAT, w.span, "floor", (w.real_op("/", since, turn),))
    near = w.real_op("-", w.read(x), w.real_op("*", turn, turns))
    least = t.Builtin(FLOAT, w.span, "max", (near, w.decimal(low)))
    return t.Builtin(FLOAT, w.span, "min", (least, w.decimal(high)))


def cell_number(
    w: Writer,
    name: str,
    inputs: Sequence[t.Variable],
    edges_by_axis: Sequence[Sequence[float]],
    wraps: Sequence[bool] = (),
) -> tuple[list[t.TypedStmt], t.TypedExpr]:
    """Statements that return 0 outside the grid, and an expression for the cell's number."""
    body: list[t.TypedStmt] = []
    cell: t.TypedExpr = w.integer(0)
    outside = []
    for k, (x, edges) in enumerate(zip(inputs, edges_by_axis, strict=True)):
        index = w.variable(f"i{k}", "let", INT)
        around = bool(wraps) and wraps[k]
        place = place_function(w, f"{name}_place{k}", edges, wraps=around)
        body.append(w.declare(index, w.call_of(place, w.read(x))))
        cell = w.op("+", w.op("*", cell, w.integer(len(edges) - 1)), w.read(index))
        outside.append(w.op("<", w.read(index), w.integer(0)))
    if outside:
        body.append(t.TypedIf(w.span, ((w.chain("||", outside), (w.result(w.integer(0)),)),), ()))
    return body, cell


def level_function(w: Writer, name: str, table: GroupTable) -> t.FunSymbol:
    """Makes `fun level(x0: float, ...): int`: the level of an estimate, 0 outside the grid."""
    inputs = tuple(w.variable(f"x{k}", "parameter", FLOAT) for k in range(len(table.edges)))
    body, cell = cell_number(w, name, inputs, table.edges, table.wraps)
    at = w.variable("cell", "let", INT)
    body.append(w.declare(at, cell))
    packed = w.table_of_bytes(f"{name}_TABLE", table.packed)
    powers = w.array(f"{name}_POWERS", INT, POWERS)
    four = w.integer(PER_BYTE)
    byte = w.element_at(packed, w.op("/", w.read(at), four))
    shifted = w.op("/", byte, w.element_at(powers, w.op("%", w.read(at), four)))
    return w.function(name, inputs, [*body, w.result(w.op("%", shifted, four))])

"""Writes a shield as functions of the program, which judge AC's command or move it toward SC's.

Purpose: `shield_expressions` writes checked expressions for the new value of the shield's topic
when a command is published, and for whether all commands that may still act are permitted; `ttf` is
the same about the command that is held. `moved_commands` writes the search for a command that is
not permitted: for each number of it, from AC's toward SC's, the nearest one that may act longer
than a judgement asks.
Non-goals: which commands are permitted (`verify/grid/estimate_sets.py`), when they are judged
(`semantics/shields.py`). A found command is judged like any other, so no claim depends on the
search.

The search goes cell by cell, in one pass of at most as many steps as there are cells, and takes the
nearest number of a cell. Floats are looked up and compared, never calculated with. If no cell on
the way is permitted, SC's command is taken if that is permitted, else AC's stays.

Cells are closed and their ends are compared exactly, so a command lies in the cell that was looked
up. The topic holds for each cell the time until which a command of it was held. A command that was
held at t - W or later may act on the state of an estimate (`verify/problem/schedule.py`); for a
plant that moves in steps only the held one may. Times are whole ns as floats, W 1 us longer.
"""

from __future__ import annotations

from itertools import pairwise
from math import inf, nextafter
from typing import TYPE_CHECKING

from soter.language.model import typed as t
from soter.language.model.types import BOOL, FLOAT, INT, IntType, leaves
from soter.verify.deploy.level_tables import (
    GroupTable,
    Writer,
    cell_number,
    estimate_leaves,
    place_function,
)
from soter.verify.problem.inputs import topics_seen_by_dm
from soter.verify.problem.supported_constructs import topics_of_maps

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.language.model.system import Shield, System, Topic
    from soter.verify.problem.problem import Problem


def moved_commands(
    w: ShieldWriter, topic: Topic, tables: Sequence[GroupTable], ends: t.FunSymbol
) -> Iterator[t.TypedExpr]:
    """Yields an expression for each number of AC's command, moved if necessary, in topic order."""
    read = t.TopicRead(topic.type, w.span, topic.symbol)
    problem = w.problem
    places = [
        (i, path)
        for i in problem.module.outputs
        for path, _ in leaves(problem.system.topics[i].type)
    ]
    control_of = {(c.owner, c.path): k for k, c in enumerate(problem.quantities.controls)}
    for at, place in enumerate(places):
        mine, other = (w.element_at(read, w.integer(n)) for n in (at, at + len(places)))
        control = control_of.get(place)
        asked = [
            (number, x)
            for number, x in enumerate(tables)
            if x.commands is not None and control is not None and x.commands.control == control
        ]
        if control is None or not asked:
            yield mine
            continue
        fun = _nearest_function(w, control, asked, ends)
        states = [e for _, x in asked for e in estimate_leaves(w, problem, x)]
        yield w.call_of(fun, mine, other, w.end_times(), w.window_start(), *states)


def _nearest_function(
    w: ShieldWriter, control: int, tables: Sequence[tuple[int, GroupTable]], ends: t.FunSymbol
) -> t.FunSymbol:
    """The function `fun nearest(mine, other, times, since, x0, ...): float` with the search."""
    name = f"{w.name}_toward{control}"
    mine, other, since = (w.variable(v, "parameter", FLOAT) for v in ("mine", "other", "since"))
    times = w.variable("times", "parameter", w.topic.type)
    states = [
        [w.variable(f"x{number}_{k}", "parameter", FLOAT) for k in range(len(x.edges))]
        for number, x in tables
    ]
    begin, to, sign, cell = (w.variable(v, "let", INT) for v in ("own", "to", "sign", "cell"))
    step = w.variable("step", "loop", INT)
    lasting = [_lasting_function(w, x, f"{name}_lasting{number}") for number, x in tables]

    def permitted(at: t.Variable) -> list[t.TypedExpr]:
        both = w.acting_cells(control, ends, w.read(times), w.read(at), w.read(since))
        return [
            _equals_one_expression(
                w, w.call_of(w.permission_function(x, number), *map(w.read, xs), both)
            )
            for (number, x), xs in zip(tables, states, strict=True)
        ]

    last_too = [
        _equals_one_expression(w, w.call_of(fun, *map(w.read, xs), w.read(cell)))
        for fun, xs in zip(lasting, states, strict=True)
    ]
    distance = w.op("-", w.read(to), w.read(begin))
    in_reach = w.op("<=", w.read(step), w.op("*", w.read(sign), distance))
    fine = w.chain("&&", [in_reach, *last_too, *permitted(cell)])
    gone = w.op("+", w.read(begin), w.op("*", w.read(sign), w.read(step)))
    entrance = _conditional(
        w,
        w.op("==", w.read(cell), w.read(begin)),
        w.read(mine),
        _conditional(
            w, w.op(">", w.read(sign), w.integer(0)), *_cell_end_expressions(w, name, control, cell)
        ),
    )
    outside = w.chain("||", [w.op("<", w.read(v), w.integer(0)) for v in (begin, to)])
    up = w.op(">", w.read(to), w.read(begin))
    body: list[t.TypedStmt] = [
        w.declare(begin, w.call_of(w.places[control], w.read(mine))),
        w.declare(to, w.call_of(w.places[control], w.read(other))),
        _if_statement(w, outside, w.result(w.read(mine))),
        w.declare(sign, _conditional(w, up, w.integer(1), w.integer(-1))),
        t.ForRange(
            w.span,
            step,
            0,
            w.cells,
            (w.declare(cell, gone), _if_statement(w, fine, w.result(entrance))),
        ),
        w.result(_conditional(w, w.chain("&&", permitted(to)), w.read(other), w.read(mine))),
    ]
    inputs = (mine, other, times, since, *(x for xs in states for x in xs))
    return t.FunSymbol(name, w.span, inputs, FLOAT, tuple(body), False, None)


def _lasting_function(w: ShieldWriter, table: GroupTable, name: str) -> t.FunSymbol:
    """A function that gives 1 if commands of a cell may act for longer at an estimate, else 0."""
    assert table.commands is not None
    assert table.commands.lasting is not None
    inputs = [w.variable(f"x{k}", "parameter", FLOAT) for k in range(len(table.edges))]
    command = w.variable("command", "parameter", INT)
    body, cell = cell_number(w, name, inputs, table.edges)
    every = tuple(int(v) for v in table.commands.lasting.ravel())
    packed = w.array(f"{name}_TABLE", IntType(0, 255), every)
    at = w.op("+", w.op("*", cell, w.integer(w.cells)), w.read(command))
    return w.function(name, (*inputs, command), [*body, w.result(w.element_at(packed, at))])


def _cell_end_expressions(
    w: ShieldWriter, name: str, control: int, cell: t.Variable
) -> tuple[t.TypedExpr, t.TypedExpr]:
    """The expressions for the least and the greatest number that belongs to a cell."""
    edges = w.edges[control]
    least = edges[:-1]
    inner = (max(nextafter(high, -inf), low) for low, high in pairwise(edges[:-1]))
    greatest = (*inner, edges[-1])
    tables = (("UP", least), ("DOWN", greatest))
    up, down = (
        w.element_at(w.array(f"{name}_{x}", FLOAT, tuple(v)), w.read(cell)) for x, v in tables
    )
    return up, down


def _equals_one_expression(w: ShieldWriter, value: t.TypedExpr) -> t.TypedExpr:
    return w.op("==", value, w.integer(1))


def _if_statement(w: ShieldWriter, condition: t.TypedExpr, then: t.TypedStmt) -> t.TypedStmt:
    return t.TypedIf(w.span, ((condition, (then,)),), ())


def _conditional(
    w: ShieldWriter, condition: t.TypedExpr, then: t.TypedExpr, otherwise: t.TypedExpr
) -> t.TypedExpr:
    return t.Conditional(then.type, w.span, condition, then, otherwise)


SLACK_NS = 1_000


class ShieldWriter(Writer):
    """Builds the expressions of one module's shield.

    For each control, `edges` has the edges of its cells, and `places` the function to find a cell.
    """

    def __init__(self, problem: Problem, system: System, shield: Shield) -> None:
        symbol = problem.module.symbol
        super().__init__(symbol.span)
        self.problem = problem
        self.name = symbol.name
        self.cells = shield.cells
        self.topic = system.topics[shield.topic]
        self.now = t.TimeRead(FLOAT, self.span)
        self._reach: dict[str, t.FunSymbol] = {}
        self.edges = [command_edges(r.low, r.high, self.cells) for r in problem.controls]
        self.places = [
            place_function(self, f"{self.name}_command{k}", edges)
            for k, edges in enumerate(self.edges)
        ]

    def held_command(self, control: int) -> t.TypedExpr:
        """The expression for a control's value in the held command."""
        leaf = self.problem.quantities.controls[control]
        output = self.problem.system.topics[leaf.owner]
        return self.leaf_of(output.symbol, leaf.path)

    def held_cell(self, control: int) -> t.TypedExpr:
        """The expression for the cell of a control's held value; -1 outside its range."""
        return self.call_of(self.places[control], self.held_command(control))

    def times_after_command(self) -> t.TypedExpr:
        """The expression for the shield's next topic value: the held command's cells end now."""
        times = self.variable("times", "parameter", self.topic.type)
        now = self.variable("now", "parameter", FLOAT)
        inputs = [self.variable(f"i{k}", "parameter", INT) for k in range(len(self.places))]
        new = self.variable("new", "var", self.topic.type)
        body: list[t.TypedStmt] = [self.declare(new, self.read(times))]
        for k, i in enumerate(inputs):
            at = self.op("+", self.read(i), self.integer(k * self.cells))
            place = t.Place(new, (at,), FLOAT, self.span)
            inside = self.op(">=", self.read(i), self.integer(0))
            assign = t.TypedAssign(self.span, place, self.read(now))
            body.append(t.TypedIf(self.span, ((inside, (assign,)),), ()))
        body.append(self.result(self.read(new)))
        fun = t.FunSymbol(
            f"{self.name}_held",
            self.span,
            (times, now, *inputs),
            self.topic.type,
            tuple(body),
            False,
            None,
        )
        cells = [self.held_cell(k) for k in range(len(self.places))]
        return self.call_of(fun, self.end_times(), self.now, *cells)

    def end_times(self) -> t.TypedExpr:
        """The expression that reads from the shield's topic when each cell's commands ended."""
        return t.TopicRead(self.topic.type, self.span, self.topic.symbol)

    def ends_function(self) -> t.FunSymbol:
        """A function that finds the least and greatest of cell `own` and those held since `since`.

        It returns least + cells * greatest; its `first` is the index of the command's first time.
        """
        times = self.variable("times", "parameter", self.topic.type)
        first, own_cell = (self.variable(n, "parameter", INT) for n in ("first", "own"))
        since = self.variable("since", "parameter", FLOAT)
        low, high = (self.variable(n, "var", INT) for n in ("low", "high"))
        k = self.variable("k", "loop", INT)
        until = self.element_at(self.read(times), self.op("+", self.read(first), self.read(k)))
        acts = self.op(">=", until, self.read(since))
        lower = self.op("<", self.read(k), self.read(low))
        higher = self.op(">", self.read(k), self.read(high))
        wider: tuple[t.TypedStmt, ...] = (
            t.TypedIf(self.span, ((lower, (self.assign(low, k),)),), ()),
            t.TypedIf(self.span, ((higher, (self.assign(high, k),)),), ()),
        )
        n = self.integer(self.cells)
        body = [
            self.declare(low, self.read(own_cell)),
            self.declare(high, self.read(own_cell)),
            t.ForRange(self.span, k, 0, self.cells, (t.TypedIf(self.span, ((acts, wider),), ()),)),
            self.result(self.op("+", self.read(low), self.op("*", n, self.read(high)))),
        ]
        return self.function(f"{self.name}_ends", (times, first, own_cell, since), body)

    def permission(self, table: GroupTable, ends: t.FunSymbol, number: int) -> t.TypedExpr:
        """The condition that all commands that may act are permitted at a group's estimate."""
        assert table.commands is not None
        arguments = estimate_leaves(self, self.problem, table)
        if table.commands.control is None:
            level = table.function(self, f"{self.name}_shield{number}")
            return self.op(">=", self.call_of(level, *arguments), self.integer(1))
        control = table.commands.control
        times, start = self.end_times(), self.window_start()
        both = self.acting_cells(control, ends, times, self.held_cell(control), start)
        reach = self.permission_function(table, number)
        inside = self.op(">=", self.held_cell(control), self.integer(0))
        return self.op(
            "&&", inside, self.op("==", self.call_of(reach, *arguments, both), self.integer(1))
        )

    def window_start(self) -> t.TypedExpr:
        """The expression t - W, in s: commands held then or later may act on the state read now."""
        window = self.problem.times.replaced_window + SLACK_NS
        back = self.decimal(window / 1e9)
        return self.real_op("-", self.now, back)

    def acting_cells(
        self,
        control: int,
        ends: t.FunSymbol,
        times: t.TypedExpr,
        own_cell: t.TypedExpr,
        since: t.TypedExpr,
    ) -> t.TypedExpr:
        """The expression of the least and greatest cell that may act together with `own_cell`."""
        if self.problem.kind == "map":  # of one instant: no other command moves the state read
            return self.op("*", own_cell, self.integer(1 + self.cells))
        return self.call_of(ends, times, self.integer(control * self.cells), own_cell, since)

    def permission_function(self, table: GroupTable, number: int) -> t.FunSymbol:
        """A function that gives 1 if the cells of `ends` are permitted at an estimate, else 0."""
        name = f"{self.name}_reach{number}"
        if name not in self._reach:
            self._reach[name] = self._make_permission_function(table, name)
        return self._reach[name]

    def _make_permission_function(self, table: GroupTable, name: str) -> t.FunSymbol:
        assert table.commands is not None
        inputs = [self.variable(f"x{k}", "parameter", FLOAT) for k in range(len(table.edges))]
        ends = self.variable("ends", "parameter", INT)
        body, cell = cell_number(self, name, inputs, table.edges)
        n = self.integer(self.cells)
        low, high = (self.op(op, self.read(ends), n) for op in "%/")
        packed = self.table_of_bytes(f"{name}_TABLE", table.commands.tops.tobytes())
        top = self.element_at(packed, self.op("+", self.op("*", cell, n), low))
        fine = t.Conditional(
            INT, self.span, self.op("<", high, top), self.integer(1), self.integer(0)
        )
        return self.function(name, (*inputs, ends), [*body, self.result(fine)])

    def freshness_conditions(self) -> list[t.TypedExpr]:
        """For each topic that the DM sees, the condition that it is fresh enough for a look."""
        maps = topics_of_maps(self.problem.system, self.problem.module)
        shown = {*topics_seen_by_dm(self.problem).values(), *maps}
        conditions: list[t.TypedExpr] = []
        for topic in self.problem.system.topics:
            if topic.symbol in shown and topic.max_age_ns is not None:
                age = t.AgeRead(FLOAT, self.span, topic.symbol)
                most = self.decimal(topic.max_age_ns / 1e9)
                conditions.append(t.TypedBinary(BOOL, self.span, "<=", age, most))
        return conditions


def command_edges(low: float, high: float, cells: int) -> tuple[float, ...]:
    """The edges of a command's cells: equally spaced but for rounding, with exact ends."""
    inner = [low + (high - low) * (k / cells) for k in range(1, cells)]
    return (low, *inner, high)


def shield_expressions(
    problem: Problem, system: System, shield: Shield, tables: Sequence[GroupTable]
) -> tuple[t.TypedExpr, t.TypedExpr, t.TypedExpr]:
    """The expressions `held`, `permits` and `ttf` of a shield; `ttf` ignores ages.

    If the shield moves commands, this also sets `shield.moved`.
    """
    w = ShieldWriter(problem, system, shield)
    ends = w.ends_function()
    permitted = w.chain("&&", [w.permission(table, ends, k) for k, table in enumerate(tables)])
    ttf = t.TypedUnary(BOOL, w.span, "!", permitted)
    if shield.proposed is not None:
        numbers = moved_commands(w, system.topics[shield.proposed], tables, ends)
        shield.moved = w.floats([*numbers, w.decimal(1.0)])
    return w.times_after_command(), w.chain("&&", [*w.freshness_conditions(), permitted]), ttf

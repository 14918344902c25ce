"""A shield as functions of the program: which commands it permits, and to which one it moves AC's.

Purpose: `shield_expressions` writes checked expressions for the new value of the shield's topic
when a command is published, and for whether all commands that may still act are permitted; `ttf` is
the same about the command that is held. `moved_commands` writes, for a number of a command that is
not permitted, the search for the number nearest to AC's, toward SC's, that may act longer than a
judgement asks.
Non-goals: which commands are permitted (`verify/grid/estimate_sets.py`), when they are judged
(`semantics/shields.py`). What it finds is judged like any other command, so no claim depends on
the search.

The search goes cell by cell, in one pass of at most as many steps as there are cells, and takes the
nearest number of a cell. Floats are looked up and compared, never calculated with. If no cell on
the way is fine SC's command is taken if it is permitted, else AC's stays.

Cells are closed and their ends are compared exactly, so a command lies in the cell that was looked
up. Of each cell the topic holds the time until which a command of it was held: what was held at t -
W or later may act on the state behind an estimate (`verify/problem/schedule.py`); of a plant that
moves in steps no other does. Times are floats of whole nanoseconds; a microsecond is added to W.
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
    """A proposal for each number of AC's command, as expressions, in the order of `topic`."""
    read = t.TopicRead(topic.type, w.span, topic.symbol)
    problem = w.problem
    places = [
        (i, path)
        for i in problem.module.outputs
        for path, _ in leaves(problem.system.topics[i].type)
    ]
    control_of = {(c.owner, c.path): k for k, c in enumerate(problem.quantities.controls)}
    for at, place in enumerate(places):
        mine, other = (w.element(read, w.number(n)) for n in (at, at + len(places)))
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
        yield w.call(fun, mine, other, w.times(), w.since(), *states)


def _nearest_function(
    w: ShieldWriter, control: int, tables: Sequence[tuple[int, GroupTable]], ends: t.FunSymbol
) -> t.FunSymbol:
    """`fun nearest(mine, other, times, since, x0, ...): float`, which does the search."""
    name = f"{w.name}_toward{control}"
    mine, other, since = (w.variable(v, "parameter", FLOAT) for v in ("mine", "other", "since"))
    times = w.variable("times", "parameter", w.topic.type)
    states = [
        [w.variable(f"x{number}_{k}", "parameter", FLOAT) for k in range(len(x.edges))]
        for number, x in tables
    ]
    own, to, sign, cell = (w.variable(v, "let", INT) for v in ("own", "to", "sign", "cell"))
    step = w.variable("step", "loop", INT)
    lasting = [_lasting_function(w, x, f"{name}_lasting{number}") for number, x in tables]

    def permitted(at: t.Variable) -> list[t.TypedExpr]:
        both = w.acting_cells(control, ends, w.read(times), w.read(at), w.read(since))
        return [
            _is_one(w, w.call(w.permission_function(x, number), *map(w.read, xs), both))
            for (number, x), xs in zip(tables, states, strict=True)
        ]

    last_too = [
        _is_one(w, w.call(fun, *map(w.read, xs), w.read(cell)))
        for fun, xs in zip(lasting, states, strict=True)
    ]
    there = w.op("<=", w.read(step), w.op("*", w.read(sign), w.op("-", w.read(to), w.read(own))))
    fine = w.chain("&&", [there, *last_too, *permitted(cell)])
    gone = w.op("+", w.read(own), w.op("*", w.read(sign), w.read(step)))
    entrance = _conditional(
        w,
        w.op("==", w.read(cell), w.read(own)),
        w.read(mine),
        _conditional(w, w.op(">", w.read(sign), w.number(0)), *_entrances(w, name, control, cell)),
    )
    outside = w.op("||", w.op("<", w.read(own), w.number(0)), w.op("<", w.read(to), w.number(0)))
    up = w.op(">", w.read(to), w.read(own))
    body: list[t.TypedStmt] = [
        w.declare(own, w.call(w.places[control], w.read(mine))),
        w.declare(to, w.call(w.places[control], w.read(other))),
        _if_statement(w, outside, w.give(w.read(mine))),
        w.declare(sign, _conditional(w, up, w.number(1), w.number(-1))),
        t.ForRange(
            w.span,
            step,
            0,
            w.cells,
            (w.declare(cell, gone), _if_statement(w, fine, w.give(entrance))),
        ),
        w.give(_conditional(w, w.chain("&&", permitted(to)), w.read(other), w.read(mine))),
    ]
    inputs = (mine, other, times, since, *(x for xs in states for x in xs))
    return t.FunSymbol(name, w.span, inputs, FLOAT, tuple(body), False, None)


def _lasting_function(w: ShieldWriter, table: GroupTable, name: str) -> t.FunSymbol:
    """A function: 1 where commands of a cell may act for longer at an estimate, else 0."""
    assert table.commands is not None
    assert table.commands.lasting is not None
    inputs = [w.variable(f"x{k}", "parameter", FLOAT) for k in range(len(table.edges))]
    command = w.variable("command", "parameter", INT)
    body, cell = cell_number(w, name, inputs, table.edges)
    every = tuple(int(v) for v in table.commands.lasting.ravel())
    packed = w.array(f"{name}_TABLE", IntType(0, 255), every)
    at = w.op("+", w.op("*", cell, w.number(w.cells)), w.read(command))
    return w.function(name, (*inputs, command), [*body, w.give(w.element(packed, at))])


def _entrances(
    w: ShieldWriter, name: str, control: int, cell: t.Variable
) -> tuple[t.TypedExpr, t.TypedExpr]:
    """Expressions for the least and the greatest number that is looked up in a cell."""
    edges = w.edges[control]
    least = edges[:-1]
    inner = (max(nextafter(high, -inf), low) for low, high in pairwise(edges[:-1]))
    greatest = (*inner, edges[-1])
    tables = (("UP", least), ("DOWN", greatest))
    up, down = (w.element(w.array(f"{name}_{x}", FLOAT, tuple(v)), w.read(cell)) for x, v in tables)
    return up, down


def _is_one(w: ShieldWriter, value: t.TypedExpr) -> t.TypedExpr:
    return w.op("==", value, w.number(1))


def _if_statement(w: ShieldWriter, condition: t.TypedExpr, then: t.TypedStmt) -> t.TypedStmt:
    return t.TypedIf(w.span, ((condition, (then,)),), ())


def _conditional(
    w: ShieldWriter, condition: t.TypedExpr, then: t.TypedExpr, otherwise: t.TypedExpr
) -> t.TypedExpr:
    return t.Conditional(then.type, w.span, condition, then, otherwise)


SLACK_NS = 1_000


class ShieldWriter(Writer):
    """Builds the expressions of one module's shield.

    `edges`, `places`: for each control the edges of its cells, and the function that finds a cell.
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

    def held_number(self, control: int) -> t.TypedExpr:
        """The number of the held command that belongs to a control."""
        leaf = self.problem.quantities.controls[control]
        output = self.problem.system.topics[leaf.owner]
        return self.leaf(output.symbol, leaf.path)

    def held_cell(self, control: int) -> t.TypedExpr:
        """The command cell of the number that is held for a control; -1 outside of its range."""
        return self.call(self.places[control], self.held_number(control))

    def new_times(self) -> t.TypedExpr:
        """The new value of the shield's topic: the commands held so far end now."""
        times = self.variable("times", "parameter", self.topic.type)
        now = self.variable("now", "parameter", FLOAT)
        inputs = [self.variable(f"i{k}", "parameter", INT) for k in range(len(self.places))]
        new = self.variable("new", "var", self.topic.type)
        body: list[t.TypedStmt] = [self.declare(new, self.read(times))]
        for k, i in enumerate(inputs):
            at = self.op("+", self.read(i), self.number(k * self.cells))
            place = t.Place(new, (at,), FLOAT, self.span)
            inside = self.op(">=", self.read(i), self.number(0))
            assign = t.TypedAssign(self.span, place, self.read(now))
            body.append(t.TypedIf(self.span, ((inside, (assign,)),), ()))
        body.append(self.give(self.read(new)))
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
        return self.call(fun, self.times(), self.now, *cells)

    def times(self) -> t.TypedExpr:
        """The shield's topic."""
        return t.TopicRead(self.topic.type, self.span, self.topic.symbol)

    def ends_function(self) -> t.FunSymbol:
        """A function: the least and the greatest cell among `own` and those held since `since`.

        It returns least + cells * greatest. `first`: where the times of the command begin.
        """
        times = self.variable("times", "parameter", self.topic.type)
        first, own = (self.variable(n, "parameter", INT) for n in ("first", "own"))
        since = self.variable("since", "parameter", FLOAT)
        low, high = (self.variable(n, "var", INT) for n in ("low", "high"))
        k = self.variable("k", "loop", INT)
        until = self.element(self.read(times), self.op("+", self.read(first), self.read(k)))
        acts = self.op(">=", until, self.read(since))
        lower = self.op("<", self.read(k), self.read(low))
        higher = self.op(">", self.read(k), self.read(high))
        wider: tuple[t.TypedStmt, ...] = (
            t.TypedIf(self.span, ((lower, (self.assign(low, k),)),), ()),
            t.TypedIf(self.span, ((higher, (self.assign(high, k),)),), ()),
        )
        body = [
            self.declare(low, self.read(own)),
            self.declare(high, self.read(own)),
            t.ForRange(self.span, k, 0, self.cells, (t.TypedIf(self.span, ((acts, wider),), ()),)),
            self.give(
                self.op("+", self.read(low), self.op("*", self.number(self.cells), self.read(high)))
            ),
        ]
        return self.function(f"{self.name}_ends", (times, first, own, since), body)

    def permitted(self, table: GroupTable, ends: t.FunSymbol, number: int) -> t.TypedExpr:
        """The expression that the commands that may act are permitted at one group's estimate."""
        assert table.commands is not None
        arguments = estimate_leaves(self, self.problem, table)
        if table.commands.control is None:
            level = table.function(self, f"{self.name}_shield{number}")
            return self.op(">=", self.call(level, *arguments), self.number(1))
        control = table.commands.control
        both = self.acting_cells(control, ends, self.times(), self.held_cell(control), self.since())
        reach = self.permission_function(table, number)
        inside = self.op(">=", self.held_cell(control), self.number(0))
        return self.op(
            "&&", inside, self.op("==", self.call(reach, *arguments, both), self.number(1))
        )

    def since(self) -> t.TypedExpr:
        """The time t - W, in s: commands held then or later may act on the state read now."""
        window = self.problem.times.acted + SLACK_NS
        back = self.decimal(window / 1e9)
        return self.real_op("-", self.now, back)

    def acting_cells(
        self,
        control: int,
        ends: t.FunSymbol,
        times: t.TypedExpr,
        own: t.TypedExpr,
        since: t.TypedExpr,
    ) -> t.TypedExpr:
        """The least and greatest cell that may act together with the cell `own`."""
        if self.problem.kind == "map":  # of one instant: no other command moves the state read
            return self.op("*", own, self.number(1 + self.cells))
        return self.call(ends, times, self.number(control * self.cells), own, since)

    def permission_function(self, table: GroupTable, number: int) -> t.FunSymbol:
        """A function: 1 where commands of the cells `ends` are permitted at an estimate, else 0."""
        name = f"{self.name}_reach{number}"
        if name not in self._reach:
            self._reach[name] = self._make_permission_function(table, name)
        return self._reach[name]

    def _make_permission_function(self, table: GroupTable, name: str) -> t.FunSymbol:
        assert table.commands is not None
        inputs = [self.variable(f"x{k}", "parameter", FLOAT) for k in range(len(table.edges))]
        ends = self.variable("ends", "parameter", INT)
        body, cell = cell_number(self, name, inputs, table.edges)
        n = self.number(self.cells)
        low, high = (self.op(op, self.read(ends), n) for op in "%/")
        packed = self.table_of_bytes(f"{name}_TABLE", table.commands.tops.tobytes())
        top = self.element(packed, self.op("+", self.op("*", cell, n), low))
        fine = t.Conditional(
            INT, self.span, self.op("<", high, top), self.number(1), self.number(0)
        )
        return self.function(name, (*inputs, ends), [*body, self.give(fine)])

    def fresh_reads(self) -> list[t.TypedExpr]:
        """A condition for each topic of the DM: that it is not stale, as the DM's look requires."""
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
    """`held` and `permits` of a module's `Shield`, and `ttf`, which does not look at ages.

    Fills in `shield.moved`, where commands are moved.
    """
    w = ShieldWriter(problem, system, shield)
    ends = w.ends_function()
    permitted = w.chain("&&", [w.permitted(table, ends, k) for k, table in enumerate(tables)])
    ttf = t.TypedUnary(BOOL, w.span, "!", permitted)
    if shield.proposed is not None:
        numbers = moved_commands(w, system.topics[shield.proposed], tables, ends)
        shield.moved = w.floats([*numbers, w.decimal(1.0)])
    return w.new_times(), w.chain("&&", [*w.fresh_reads(), permitted]), ttf

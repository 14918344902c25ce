"""Where to a shield moves a command that it does not permit: toward SC's.

Purpose: for each number of a command a function of the program that gives the number nearest to
AC's, on the way to SC's, that may act for longer than a judgement asks.
Non-goals: what is permitted (`shield_tables.py`): what comes out of here is judged like any other
command, so nothing that is claimed hangs on this file.

A way is gone cell by cell, in one pass of at most as many steps as there are cells; of a cell that
is entered its nearest number is taken. Floats are looked up and compared, never calculated with.
Where no cell of the way is fine SC's command is taken if it is permitted, else AC's stays.
"""

from __future__ import annotations

from abc import abstractmethod
from itertools import pairwise
from math import inf, nextafter
from typing import TYPE_CHECKING

from soter.language.model import typed as t
from soter.language.model.types import FLOAT, INT, IntType, leaves
from soter.verify.tables.grid_tables import cell_of, estimate
from soter.verify.tables.typed_tree_builder import Writer

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.language.model.system import Topic
    from soter.verify.problem.problem import Problem
    from soter.verify.tables.grid_tables import GroupTable


class ShieldParts(Writer):
    """What the expressions here are made of; a shield's writer has it.

    `edges`, `places`: of each control between what its cells lie, and the function that finds one.
    """

    problem: Problem
    name: str
    cells: int
    topic: Topic
    edges: list[tuple[float, ...]]
    places: list[t.FunSymbol]

    @abstractmethod
    def times(self) -> t.TypedExpr:
        """The shield's topic."""

    @abstractmethod
    def since(self) -> t.TypedExpr:
        """A command that was held then or later may act on what is read now: t - W, s."""

    @abstractmethod
    def acting(
        self,
        control: int,
        ends: t.FunSymbol,
        times: t.TypedExpr,
        own: t.TypedExpr,
        since: t.TypedExpr,
    ) -> t.TypedExpr:
        """The least cell and the greatest that may act where a command of cell `own` does."""

    @abstractmethod
    def reach(self, table: GroupTable, number: int) -> t.FunSymbol:
        """A function: 1 where commands of the cells `ends` are permitted at an estimate, else 0."""


def moved(
    w: ShieldParts, topic: Topic, tables: Sequence[GroupTable], ends: t.FunSymbol
) -> Iterator[t.TypedExpr]:
    """What AC publishes in the place of each number, in the order of `topic`: proposals."""
    read = t.TopicRead(topic.type, w.span, topic.symbol)
    problem = w.problem
    places = [
        (i, path)
        for i in problem.module.outputs
        for path, _ in leaves(problem.system.topics[i].type)
    ]
    control_of = {(c.owner, c.path): k for k, c in enumerate(problem.quantities.controls)}
    for at, place in enumerate(places):
        mine, other = (w.at(read, w.number(n)) for n in (at, at + len(places)))
        control = control_of.get(place)
        asked = [
            (number, x)
            for number, x in enumerate(tables)
            if x.commands is not None and control is not None and x.commands.control == control
        ]
        if control is None or not asked:
            yield mine
            continue
        fun = _nearest(w, control, asked, ends)
        states = [e for _, x in asked for e in estimate(w, problem, x)]
        yield w.call(fun, mine, other, w.times(), w.since(), *states)


def _nearest(
    w: ShieldParts, control: int, tables: Sequence[tuple[int, GroupTable]], ends: t.FunSymbol
) -> t.FunSymbol:
    """`fun nearest(mine, other, times, since, x0, ...): float`."""
    name = f"{w.name}_toward{control}"
    mine, other, since = (w.variable(v, "parameter", FLOAT) for v in ("mine", "other", "since"))
    times = w.variable("times", "parameter", w.topic.type)
    states = [
        [w.variable(f"x{number}_{k}", "parameter", FLOAT) for k in range(len(x.edges))]
        for number, x in tables
    ]
    own, to, sign, cell = (w.variable(v, "let", INT) for v in ("own", "to", "sign", "cell"))
    step = w.variable("step", "loop", INT)
    lasting = [_lasting(w, x, f"{name}_lasting{number}") for number, x in tables]

    def permitted(at: t.Variable) -> list[t.TypedExpr]:
        both = w.acting(control, ends, w.read(times), w.read(at), w.read(since))
        return [
            _is_one(w, w.call(w.reach(x, number), *map(w.read, xs), both))
            for (number, x), xs in zip(tables, states, strict=True)
        ]

    last_too = [
        _is_one(w, w.call(fun, *map(w.read, xs), w.read(cell)))
        for fun, xs in zip(lasting, states, strict=True)
    ]
    there = w.op("<=", w.read(step), _product(w, sign, w.op("-", w.read(to), w.read(own))))
    fine = w.chain("&&", [there, *last_too, *permitted(cell)])
    gone = w.op("+", w.read(own), _product(w, sign, w.read(step)))
    entrance = _either(
        w,
        w.op("==", w.read(cell), w.read(own)),
        w.read(mine),
        _either(w, w.op(">", w.read(sign), w.number(0)), *_entrances(w, name, control, cell)),
    )
    outside = w.op("||", w.op("<", w.read(own), w.number(0)), w.op("<", w.read(to), w.number(0)))
    up = w.op(">", w.read(to), w.read(own))
    body: list[t.TypedStmt] = [
        w.declare(own, w.call(w.places[control], w.read(mine))),
        w.declare(to, w.call(w.places[control], w.read(other))),
        _if(w, outside, w.give(w.read(mine))),
        w.declare(sign, _either(w, up, w.number(1), w.number(-1))),
        t.ForRange(
            w.span, step, 0, w.cells, (w.declare(cell, gone), _if(w, fine, w.give(entrance)))
        ),
        w.give(_either(w, w.chain("&&", permitted(to)), w.read(other), w.read(mine))),
    ]
    inputs = (mine, other, times, since, *(x for xs in states for x in xs))
    return t.FunSymbol(name, w.span, inputs, FLOAT, tuple(body), False, None)


def _lasting(w: ShieldParts, table: GroupTable, name: str) -> t.FunSymbol:
    """A function: 1 where commands of a cell may act for longer at an estimate, else 0."""
    assert table.commands is not None
    assert table.commands.lasting is not None
    inputs = [w.variable(f"x{k}", "parameter", FLOAT) for k in range(len(table.edges))]
    command = w.variable("command", "parameter", INT)
    body, cell = cell_of(w, name, inputs, table.edges)
    every = tuple(int(v) for v in table.commands.lasting.ravel())
    packed = w.array(f"{name}_TABLE", IntType(0, 255), every)
    at = w.op("+", w.op("*", cell, w.number(w.cells)), w.read(command))
    return w.function(name, (*inputs, command), [*body, w.give(w.at(packed, at))])


def _entrances(
    w: ShieldParts, name: str, control: int, cell: t.Variable
) -> tuple[t.TypedExpr, t.TypedExpr]:
    """Of a cell the least number that is looked up there, and the greatest."""
    edges = w.edges[control]
    least = edges[:-1]
    inner = (max(nextafter(high, -inf), low) for low, high in pairwise(edges[:-1]))
    greatest = (*inner, edges[-1])
    tables = (("UP", least), ("DOWN", greatest))
    up, down = (w.at(w.array(f"{name}_{x}", FLOAT, tuple(v)), w.read(cell)) for x, v in tables)
    return up, down


def _product(w: ShieldParts, sign: t.Variable, value: t.TypedExpr) -> t.TypedExpr:
    return w.op("*", w.read(sign), value)


def _is_one(w: ShieldParts, value: t.TypedExpr) -> t.TypedExpr:
    return w.op("==", value, w.number(1))


def _if(w: ShieldParts, condition: t.TypedExpr, then: t.TypedStmt) -> t.TypedStmt:
    return t.TypedIf(w.span, ((condition, (then,)),), ())


def _either(
    w: ShieldParts, condition: t.TypedExpr, then: t.TypedExpr, otherwise: t.TypedExpr
) -> t.TypedExpr:
    return t.Conditional(then.type, w.span, condition, then, otherwise)

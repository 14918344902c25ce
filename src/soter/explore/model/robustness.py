"""How far a condition is from changing: its robustness, as Core made of Core.

Purpose: for a condition one number in place of a truth: positive where it holds, negative where it
does not, and the smaller the nearer the values are to changing that. `a < b` is how far apart they
are, in parts of the widest distance seen so far; && is the least, || the greatest, ! the negation;
what has no distance (a bool, an equality that holds) is 1 or -1.
Non-goals: C (`robustness_functions.py`), what is done with it (`soter_explore_falsify.c`).

Every bool temporary gets a float one beside it, and every function that gives a bool one that
gives its margin: so conditions keep their distance through functions, `let` and `return`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.core import core
from soter.core.read_write_footprint import walk
from soter.language.model.types import BOOL, FLOAT, FloatType, IntType
from soter.language.syntax.node import node

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import TypeGuard

SUFFIX = "_margin"
COMPARISONS = frozenset(("<", "<=", ">", ">=", "==", "!="))
YES, NO = core.Const(FLOAT, 1.0), core.Const(FLOAT, -1.0)


@node()
class Margin(core.Expr):
    """How far two numbers are from comparing otherwise; `holds` is the comparison.

    `site`: which comparison of the program it is; each has a scale of its own.
    """

    holds: core.Binary
    site: int


class RobustnessTable:
    """Margins of the conditions of one system; `functions` are made as they are needed.

    `sites`: how many comparisons there are. `functions`: callees first.
    """

    def __init__(self, functions: Iterable[core.Function]) -> None:
        self._known = {f.name: f for f in functions}
        self._made: dict[str, str] = {}
        self._beside: dict[str, str] = {}
        self.functions: list[core.Function] = []
        self.sites = 0

    def of(self, p: core.Predicate) -> core.Predicate:
        """The margin of a predicate: its `value` is a float."""
        return replace(p, body=self._body(p.body, ()), value=self._margin(p.value))

    # ------------------------------------------------------------ expressions

    def _margin(self, e: core.Expr) -> core.Expr:
        if isinstance(e, core.Binary):
            return self._compared(e)
        if isinstance(e, core.Unary) and e.op == "not":
            return core.Unary(FLOAT, "neg", self._margin(e.operand))
        if isinstance(e, core.Select):
            then, otherwise = self._margin(e.then), self._margin(e.otherwise)
            return core.Select(FLOAT, e.condition, then, otherwise)
        if isinstance(e, core.Var) and e.name in self._beside:
            return core.Var(FLOAT, self._beside[e.name])
        if isinstance(e, core.Const):
            return YES if e.value else NO
        return core.Select(FLOAT, e, YES, NO)

    def _compared(self, e: core.Binary) -> core.Expr:
        if e.op in {"&&", "||"}:
            op = "min" if e.op == "&&" else "max"
            return core.Extreme(FLOAT, op, self._margin(e.left), self._margin(e.right))
        if isinstance(e.left.type, (FloatType, IntType)):
            self.sites += 1
            return Margin(FLOAT, e, self.sites - 1)
        return core.Select(FLOAT, e, YES, NO)

    # ------------------------------------------------------------ statements

    def _body(self, body: tuple[core.Stmt, ...], more: tuple[str, ...]) -> tuple[core.Stmt, ...]:
        """The statements of one function, each with what keeps margins; names are its own."""
        taken = {x.name for x in walk(body) if isinstance(x, (core.Let, core.Call, core.Checked))}
        taken |= {x.variable for x in walk(body) if isinstance(x, core.Loop)} | set(more)
        self._beside = {}
        for x in walk(body):
            if self._has_margin(x):
                self._beside[x.name] = _free(x.name + SUFFIX, taken)
        return self._block(body, None)

    def _has_margin(self, x: object) -> TypeGuard[core.Let | core.Call]:
        """Whether it makes a bool temporary out of what is known; an extern function is not."""
        if isinstance(x, core.Call):
            return x.type == BOOL and self._known[x.function].result is not None
        return isinstance(x, core.Let) and x.value.type == BOOL

    def _block(self, body: tuple[core.Stmt, ...], under: core.Expr | None) -> tuple[core.Stmt, ...]:
        """`under`: the condition of the `if` whose first side this is."""
        return tuple(x for s in body for x in self._statement(s, under))

    def _statement(self, s: core.Stmt, under: core.Expr | None) -> tuple[core.Stmt, ...]:
        if isinstance(s, core.Let) and s.name in self._beside:
            value = self._margin(s.value)
            return (s, core.Let(s.span, self._beside[s.name], value, s.mutable))
        if isinstance(s, core.Set) and s.name in self._beside and not s.path:
            name = self._beside[s.name]
            value = self._joined(core.Var(FLOAT, name), self._margin(s.value), s, under)
            return (core.Set(s.span, name, FLOAT, (), value), s)
        if isinstance(s, core.Call) and s.name in self._beside:
            return (s, replace(s, name=self._beside[s.name], function=self._function(s.function),
                               type=FLOAT))  # fmt: skip
        if isinstance(s, core.If):
            then, otherwise = self._block(s.then, s.condition), self._block(s.otherwise, None)
            return (replace(s, then=then, otherwise=otherwise),)
        if isinstance(s, core.Loop):
            return (replace(s, body=self._block(s.body, None)),)
        return (s,)

    def _joined(
        self, before: core.Expr, value: core.Expr, s: core.Set, under: core.Expr | None
    ) -> core.Expr:
        """`a && b` whose right side may fault is `if a { a = b }`: both sides count."""
        if isinstance(under, core.Var) and under.name == s.name:
            return core.Extreme(FLOAT, "min", before, value)
        if isinstance(under, core.Unary) and under.op == "not":
            operand = under.operand
            if isinstance(operand, core.Var) and operand.name == s.name:
                return core.Extreme(FLOAT, "max", before, value)
        return value

    # ------------------------------------------------------------ functions

    def _function(self, name: str) -> str:
        """The function that gives the margin of a function's result."""
        if name not in self._made:
            f, outside = self._known[name], self._beside
            assert f.result is not None
            own = _free(name + SUFFIX, set(self._known) | set(self._made.values()))
            self._made[name] = own
            body = self._body(f.body, tuple(p.name for p in f.parameters))
            made = replace(f, name=own, body=body, result=self._margin(f.result), result_type=FLOAT)
            self.functions.append(made)
            self._beside = outside
        return self._made[name]


def _free(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    taken.add(name)
    return name

"""Checked trees built by hand, all standing at one place of the program.

Purpose: what tables and half-spaces are written with as functions of the program.
Non-goals: which functions (`tables.py`, `facets.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program.model import typed as t
from soter.program.model.types import BOOL, INT, ArrayType, RecordType

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.span import Span
    from soter.program.model.types import Type, Value


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

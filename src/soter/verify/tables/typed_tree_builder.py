"""Checked trees built by hand, all standing at one place of the program.

Purpose: what tables and half-spaces are written with as functions of the program.
Non-goals: which functions (`tables.py`, `polytope_tables.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.language.model import typed as t
from soter.language.model.data_table import Table, is_table
from soter.language.model.types import BOOL, FLOAT, INT, ArrayType, IntType, RecordType

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.span import Span
    from soter.language.model.types import Type, Value


class Writer:
    """Builds checked trees that stand at one place of the program."""

    def __init__(self, span: Span) -> None:
        self.span = span

    def number(self, value: int) -> t.TypedExpr:
        """An int."""
        return t.Literal(INT, self.span, value)

    def decimal(self, value: float) -> t.TypedExpr:
        """A float."""
        return t.Literal(FLOAT, self.span, value)

    def real(self, op: str, left: t.TypedExpr, right: t.TypedExpr) -> t.TypedExpr:
        """Arithmetic on floats."""
        return t.TypedBinary(FLOAT, self.span, op, left, right)

    def variable(self, name: str, kind: str, type_: Type) -> t.Variable:
        """A variable."""
        return t.Variable(name, type_, kind, self.span, used=True)

    def read(self, variable: t.Variable) -> t.TypedExpr:
        """A variable's value."""
        return t.VarRead(variable.type, self.span, variable)

    def op(self, op: str, left: t.TypedExpr, right: t.TypedExpr) -> t.TypedExpr:
        """Arithmetic on ints, or a comparison, or a connective."""
        return t.TypedBinary(INT if op in "+-*/%" else BOOL, self.span, op, left, right)

    def chain(self, op: str, terms: Sequence[t.TypedExpr]) -> t.TypedExpr:
        """Several booleans joined."""
        first, *rest = terms
        for term in rest:
            first = self.op(op, first, term)
        return first

    def at(self, array: t.TypedExpr, index: t.TypedExpr) -> t.TypedExpr:
        """An element."""
        assert isinstance(array.type, ArrayType)
        return t.Index(array.type.element, self.span, array, index)

    def array(self, name: str, element: Type, values: tuple[Value, ...]) -> t.TypedExpr:
        """A constant table."""
        return t.Literal(ArrayType(element, len(values)), self.span, values, name)

    def table_of_bytes(self, name: str, values: bytes) -> t.TypedExpr:
        """A constant table of ints in [0, 255]; as data where there are many."""
        element = IntType(0, 255)
        of = ArrayType(element, len(values))
        if not is_table(of):
            return self.array(name, element, tuple(values))
        numbers = np.frombuffer(values, dtype=np.uint8).astype("<i8")
        return t.Literal(of, self.span, Table(element, numbers.tobytes()), name)

    def leaf(self, topic: t.TopicSymbol, path: Sequence[str]) -> t.TypedExpr:
        """One leaf of a topic."""
        e: t.TypedExpr = t.TopicRead(topic.type, self.span, topic)
        for part in path:
            if isinstance(e.type, RecordType):
                index = e.type.index(part)
                assert index is not None
                e = t.TypedField(e.type.fields[index][1], self.span, e, index)
            else:
                e = self.at(e, self.number(int(part[1:-1])))
        return e

    def declare(self, variable: t.Variable, value: t.TypedExpr) -> t.TypedStmt:
        """`let` or `var`."""
        return t.TypedDeclare(self.span, variable, value)

    def assign(self, variable: t.Variable, value: t.Variable) -> t.TypedStmt:
        """`variable = value;`."""
        place = t.Place(variable, (), variable.type, self.span)
        return t.TypedAssign(self.span, place, self.read(value))

    def give(self, value: t.TypedExpr) -> t.TypedStmt:
        """`return value;`."""
        return t.TypedReturn(self.span, value)

    def function(
        self, name: str, parameters: tuple[t.Variable, ...], body: list[t.TypedStmt]
    ) -> t.FunSymbol:
        """A function with an int result."""
        return t.FunSymbol(name, self.span, parameters, INT, tuple(body), False, None)

    def call(self, fun: t.FunSymbol, *arguments: t.TypedExpr) -> t.TypedExpr:
        """A call."""
        return t.TypedCall(fun.result, self.span, fun, arguments)

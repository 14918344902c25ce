"""What a DM holds of one group, and how functions of the program are built for it by hand.

Purpose: `LevelTable`: what is asked of a table of levels, however it is read; `Writer`: checked
trees, all standing at one place of the program, with which tables and half-spaces are written.
Non-goals: tables of cells (`grid_tables.py`), half-spaces
(`verify/polytope/tables.py`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.language.model import typed as t
from soter.language.model.types import BOOL, FLOAT, INT, ArrayType, IntType, RecordType
from soter.language.model.values import Table, is_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.diagnostics.diagnostic import Span
    from soter.language.model.typed import FunSymbol, TypedExpr
    from soter.language.model.types import Type, Value
    from soter.verify.problem.problem import Group, Problem


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


@dataclass(frozen=True, eq=False)
class EstimateSamples:
    """Estimates on which the compiled DM is tried.

    `points` (n, states); `surely` (n,): the level that each has; `least` (n,): the level that it
    must be given at least. `whole`: one for every cell that there is.
    """

    points: NDArray[np.float64]
    surely: NDArray[np.uint8]
    least: NDArray[np.uint8]
    whole: bool


class LevelTable(ABC):
    """Levels of estimates of a group: 0 (`ttf`), 1 (in S_0), 2 (in S_(m-2)).

    `states`: those that the DM sees, which the function takes in this order.
    """

    states: tuple[int, ...]
    two_levels = False
    """Whether there is no level 1."""

    @property
    @abstractmethod
    def ends(self) -> tuple[tuple[float, ...], ...]:
        """Per state the numbers between which inputs are told apart."""

    @abstractmethod
    def share(self, group: Group) -> float:
        """Share of the volume of its group's ranges that S_0 is, of estimates."""

    @property
    @abstractmethod
    def full(self) -> tuple[float, ...] | None:
        """A point of S_(m-2), well inside; None where there is none."""

    @property
    @abstractmethod
    def samples(self) -> EstimateSamples | None:
        """What to try the compiled function on; None where there is nothing to tell apart."""

    @abstractmethod
    def function(self, w: Writer, name: str) -> FunSymbol:
        """`fun level(x0: float, ...): int`: the level of an estimate."""

    def more(self, w: Writer, problem: Problem) -> list[TypedExpr]:
        """What it is read with beside an estimate."""
        del w, problem
        return []

    @abstractmethod
    def entry(self, names: Sequence[str], stem: str, files: dict[str, bytes]) -> dict[str, object]:
        """The table in a certificate; `names` of all states."""

"""The interface of a DM's tables of levels, and a builder of checked trees to write them with.

Purpose: `LevelTable` is what every table of levels offers, however it is read; `Writer` builds
checked expressions and functions of the program, which all stand at one place of its text.
Non-goals: tables of cells (`grid_tables.py`), half-spaces (`verify/polytope/tables.py`).
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
        """An int literal."""
        return t.Literal(INT, self.span, value)

    def decimal(self, value: float) -> t.TypedExpr:
        """A float literal."""
        return t.Literal(FLOAT, self.span, value)

    def real(self, op: str, left: t.TypedExpr, right: t.TypedExpr) -> t.TypedExpr:
        """An arithmetic operation on floats."""
        return t.TypedBinary(FLOAT, self.span, op, left, right)

    def variable(self, name: str, kind: str, type_: Type) -> t.Variable:
        """A new variable."""
        return t.Variable(name, type_, kind, self.span, used=True)

    def read(self, variable: t.Variable) -> t.TypedExpr:
        """The value of a variable."""
        return t.VarRead(variable.type, self.span, variable)

    def op(self, op: str, left: t.TypedExpr, right: t.TypedExpr) -> t.TypedExpr:
        """An arithmetic operation on ints, a comparison, or a connective."""
        return t.TypedBinary(INT if op in "+-*/%" else BOOL, self.span, op, left, right)

    def chain(self, op: str, terms: Sequence[t.TypedExpr]) -> t.TypedExpr:
        """Several booleans joined by a connective."""
        first, *rest = terms
        for term in rest:
            first = self.op(op, first, term)
        return first

    def at(self, array: t.TypedExpr, index: t.TypedExpr) -> t.TypedExpr:
        """An element of an array."""
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
        """The statement `let` or `var`, by the variable's kind."""
        return t.TypedDeclare(self.span, variable, value)

    def assign(self, variable: t.Variable, value: t.Variable) -> t.TypedStmt:
        """The statement `variable = value;`."""
        place = t.Place(variable, (), variable.type, self.span)
        return t.TypedAssign(self.span, place, self.read(value))

    def give(self, value: t.TypedExpr) -> t.TypedStmt:
        """The statement `return value;`."""
        return t.TypedReturn(self.span, value)

    def function(
        self, name: str, parameters: tuple[t.Variable, ...], body: list[t.TypedStmt]
    ) -> t.FunSymbol:
        """A function with an int result."""
        return t.FunSymbol(name, self.span, parameters, INT, tuple(body), False, None)

    def call(self, fun: t.FunSymbol, *arguments: t.TypedExpr) -> t.TypedExpr:
        """A call of a function."""
        return t.TypedCall(fun.result, self.span, fun, arguments)


@dataclass(frozen=True, eq=False)
class EstimateSamples:
    """Estimates on which the compiled DM is tried.

    `points` (n, states); `surely` (n,): the level of each; `least` (n,): the least level that it
    must be given. `whole`: whether there is one for every cell.
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
        """For each state the numbers that divide its values into classes of input."""

    @abstractmethod
    def share(self, group: Group) -> float:
        """The share of the volume of its group's ranges that S_0 has."""

    @property
    @abstractmethod
    def full(self) -> tuple[float, ...] | None:
        """A point well inside S_(m-2); None where there is none."""

    @property
    @abstractmethod
    def samples(self) -> EstimateSamples | None:
        """The estimates to try the compiled function on; None where all have one level."""

    @abstractmethod
    def function(self, w: Writer, name: str) -> FunSymbol:
        """The function `fun level(x0: float, ...): int`, which finds the level of an estimate."""

    def more(self, w: Writer, problem: Problem) -> list[TypedExpr]:
        """Further arguments with which it is read, beside an estimate."""
        del w, problem
        return []

    @abstractmethod
    def entry(self, names: Sequence[str], stem: str, files: dict[str, bytes]) -> dict[str, object]:
        """The table's entry in a certificate; `names`: those of all states."""

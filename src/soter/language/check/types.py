"""Check type expressions.

Purpose: what a type expression means, with sizes that a machine can hold.
Non-goals: declarations of types (`declarations.py`), storage.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fix import replace, the_other_way
from soter.language.model.data_table import TABLE_MAX, VALUE_MAX
from soter.language.model.types import (
    BOOL,
    DURATION,
    ERROR,
    FLOAT,
    INT,
    MODE,
    ArrayType,
    DurationType,
    ErrorType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    Type,
    leaf_count,
    leaves,
    with_unit,
)
from soter.language.syntax import tree

if TYPE_CHECKING:
    from soter.diagnostics.span import Span
    from soter.language.check.checker_interface import Shared
    from soter.language.check.expression_context import Context
    from soter.language.check.scope import FileScope

UNIT_MAX = 16
"""Characters of a unit."""
BUILTIN_TYPES: dict[str, Type] = {
    "bool": BOOL,
    "int": INT,
    "float": FLOAT,
    "duration": DURATION,
}


class TypeChecker:
    """Checks type expressions of one program."""

    def __init__(self, shared: Shared) -> None:
        self.shared = shared
        self.diagnostics = shared.diagnostics
        self._around: Context | None = None

    def check(
        self,
        expr: tree.TypeExpr,
        scope: FileScope,
        around: Context | None = None,
        *,
        duration: bool = False,
        table: bool = False,
    ) -> Type:
        """The type it means, ERROR after a report; `duration` where one may stand (T014).

        `around` is the place it stands in, where that has locals: sizes cannot mention them.
        `table`: it is the type of data, which is read in place, so an array or list may be large.
        """
        outer, self._around = self._around, around
        t = self._dispatch(expr, scope, TABLE_MAX if table else VALUE_MAX)
        self._around = outer
        if isinstance(t, DurationType) and not duration:
            self.diagnostics.error(
                "T014",
                "`duration` is for constants and parameters only",
                expr.span,
                notes=("a running program keeps times as `float` seconds",),
                helps=(replace(expr.span, "float", "write `float`; `seconds(d)` converts"),),
            )
            return ERROR
        return t

    def _dispatch(self, expr: tree.TypeExpr, scope: FileScope, most: int) -> Type:
        if isinstance(expr, tree.BuiltinType):
            return BUILTIN_TYPES[expr.name]
        if isinstance(expr, tree.RangedIntType):
            return self._ranged(expr, scope)
        if isinstance(expr, tree.NamedType):
            return self._named(expr, scope)
        if isinstance(expr, tree.RecordTypeExpr):
            return self._bounded(self._record(expr, scope), expr, VALUE_MAX)
        if isinstance(expr, (tree.ArrayTypeExpr, tree.ListTypeExpr)):
            return self._bounded(self._array(expr, scope, most), expr, most)
        if isinstance(expr, tree.UnitTypeExpr):
            return self._with_unit(expr, scope, most)
        self.shared.names.losses += 1  # what could not be parsed
        return ERROR

    def _with_unit(self, expr: tree.UnitTypeExpr, scope: FileScope, most: int) -> Type:
        """T030 where there is no number that could have it, or where it is no short text."""
        t = self._dispatch(expr.base, scope, most)
        numbers = any(isinstance(leaf, (FloatType, IntType)) for _, leaf in leaves(t))
        problem = ""
        if not isinstance(t, ErrorType) and not numbers:
            problem = f"`{t}` has no number that a unit could belong to"
        elif not (1 <= len(expr.unit) <= UNIT_MAX and expr.unit.isprintable()):
            problem = f"a unit is 1 to {UNIT_MAX} characters that can be seen"
        if problem:
            self.diagnostics.error(
                "T030", problem, expr.unit_span, helps=('a unit is written `float unit "m/s"`',)
            )
            return ERROR
        return with_unit(t, expr.unit)

    def _bounded(self, t: Type, expr: tree.TypeExpr, most: int) -> Type:
        """T011 for a type of too many scalars: a value is copied as a whole, a table compiled."""
        count = 0 if isinstance(t, ErrorType) else leaf_count(t)
        if count <= most:
            return t
        note = f"a value has at most {VALUE_MAX} numbers, as steps copy values whole"
        if most == TABLE_MAX:
            note = f"a table of data has at most {TABLE_MAX} numbers"
        self.diagnostics.error(
            "T011",
            "this type is too large",
            expr.span,
            f"{count} numbers",
            notes=(note,),
            helps=()
            if most == TABLE_MAX or count > TABLE_MAX or isinstance(t, RecordType)
            else ('a constant may have more where it is read: `const NAME: T[n] = data "file";`',),
        )
        return ERROR

    def _constant(self, expr: tree.SyntaxExpr, scope: FileScope, what: str) -> int | None:
        value = self.shared.constant(expr, scope, INT, what, self._around)
        return value if isinstance(value, int) else None

    def _ranged(self, expr: tree.RangedIntType, scope: FileScope) -> Type:
        what = "the bound of a type"
        low = self._constant(expr.interval.low, scope, what)
        high = self._constant(expr.interval.high, scope, what)
        if low is None or high is None:
            return ERROR
        if low > high:
            self.diagnostics.error(
                "V001",
                f"[{low}, {high}] is empty",
                expr.interval.span,
                "the lower bound is above the upper one",
                helps=(the_other_way(expr.interval.low.span, expr.interval.high.span),),
            )
            return ERROR
        return IntType(low, high)

    def _named(self, expr: tree.NamedType, scope: FileScope) -> Type:
        name = expr.ref.name.text
        if expr.ref.qualifier is None and name == "Mode" and name not in scope.entries:
            return MODE
        entry = self.shared.names.find_ref(scope, expr.ref, "type")
        if entry is None:
            return ERROR
        if entry.kind != "type":
            self.diagnostics.error(
                "N003",
                f"`{expr.ref.text}` is a {entry.kind}, not a type",
                expr.span,
                also=((entry.decl.name.span, "declared here"),),
                helps=entry.instead("type", expr.span),
            )
            return ERROR
        t = self.shared.resolve(entry, expr.span)
        return t if isinstance(t, Type) else ERROR

    def _record(self, expr: tree.RecordTypeExpr, scope: FileScope) -> Type:
        fields: dict[str, Type] = {}
        spans: dict[str, Span] = {}
        failed = False
        for name, field_type in expr.fields:
            t = self.check(field_type, scope, self._around)
            failed = failed or isinstance(t, ErrorType)
            if name.text in fields:
                self.shared.names.twice(name.text, name.span, spans[name.text], "field")
                failed = True
                continue
            fields[name.text] = t
            spans[name.text] = name.span
        return ERROR if failed else RecordType(tuple(fields.items()))

    def _array(
        self, expr: tree.ArrayTypeExpr | tree.ListTypeExpr, scope: FileScope, most: int
    ) -> Type:
        element = self.check(expr.element, scope, self._around)
        is_array = isinstance(expr, tree.ArrayTypeExpr)
        what = "the size of an array" if is_array else "the capacity of a list"
        size_expr = expr.size if isinstance(expr, tree.ArrayTypeExpr) else expr.capacity
        size = self._constant(size_expr, scope, what)
        if size is None or isinstance(element, ErrorType):
            return ERROR
        if not 1 <= size <= most:
            self.diagnostics.error(
                "T011",
                f"{what} cannot be {size}",
                size_expr.span,
                f"1 to {most} are possible",
            )
            return ERROR
        return ArrayType(element, size) if is_array else ListType(element, size)

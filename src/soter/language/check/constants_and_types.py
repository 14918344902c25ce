"""Evaluates constant expressions, and resolves type expressions, at compile time.

Purpose: `ConstantChecker` computes constants, sizes, bounds of loops and data files within a
budget, so that a check always ends; `TypeChecker` resolves type expressions, with limits of size.
Non-goals: numbers that depend on parameters (`system_numbers.py`), the operations
(`language/evaluate/statements.py`), declarations of types (`declarations.py`), storage.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics
from soter.diagnostics.fixes import exchange_bounds, replace
from soter.language.check.checker_interface import Context
from soter.language.check.expression_base import CheckerPart, error_expr
from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.environment import BudgetExceeded
from soter.language.evaluate.statements import Evaluator
from soter.language.load.identified_data import DataError
from soter.language.load.named_files import ReadError, near_name_helps
from soter.language.model import typed
from soter.language.model.tree_walk import calls_in
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
from soter.language.model.values import TABLE_MAX, VALUE_MAX
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Span
    from soter.language.check.checker_interface import Because, Shared
    from soter.language.check.scope import FileScope
    from soter.language.load.loader import LoadedProgram
    from soter.language.model.system import Module
    from soter.language.model.types import Value


PROGRAM_BUDGET = 100_000_000
"""Most operations for all constants of a program together: some twenty seconds."""
CONSTANT_BUDGET = 50_000_000
"""Most operations for one constant."""
NUMBERS_BUDGET = 2_000_000
"""Most operations for all numbers of a system, which each choice of parameters computes again."""
MILLION = 1_000_000

WHY = {
    FaultKind.OVERFLOW: "an int leaves its range",
    FaultKind.INDEX: "an index lies outside",
    FaultKind.DIVIDE: "a division by zero",
    FaultKind.CONVERT: "this float is no 64-bit int",
    FaultKind.ASSERT: "an assertion fails",
    FaultKind.CAPACITY: "a full list is pushed to",
    FaultKind.EXTERN: "an extern is called",
}
OUTSIDE = "of files outside of the program's folder nothing is told"


class Calculator:
    """Evaluates expressions over constants and parameters, all within one budget of operations."""

    def __init__(
        self,
        diagnostics: Diagnostics,
        params: Mapping[typed.ParamSymbol, Value] | None = None,
        budgets: tuple[int, int] | None = None,
    ) -> None:
        """`budgets`: the most operations that one value, and all values together, may take."""
        self.diagnostics = diagnostics
        self._per_value, self.left = budgets or (NUMBERS_BUDGET // 2, NUMBERS_BUDGET)
        self._total = self.left
        self._evaluator = Evaluator(params or {}, None, self.left)

    def remembered_value(
        self, name: str, expr: typed.TypedExpr, subject: str, known: dict[str, tuple[Value, int]]
    ) -> Value | None:
        """Gives a declared constant's value, if it can from `known` (name -> value, operations)."""
        value, spent = known.get(name, (None, 0))
        if name in known and spent <= min(self.left, self._per_value):
            self.left -= spent
            return value
        left = self.left
        value = self.value(expr, subject)
        if value is not None:
            known[name] = value, left - self.left
        return value

    def value(self, expr: typed.TypedExpr, subject: str) -> Value | None:
        """Gives the value of an expression; None after reporting T020, which names `subject`."""
        if isinstance(expr, typed.Literal):
            return expr.value
        if self.left <= 0:
            return None  # this was reported when the budget ran out
        allowed = min(self.left, self._per_value)
        self._evaluator.set_budget(allowed)
        self._evaluator.tell = lambda n: self.diagnostics.tell(
            f"{subject}: {n / MILLION:.0f} million operations"
        )
        try:
            return self._evaluator.value(expr)
        except StepFault as fault:
            self._report_fault(fault, expr, subject)
        except BudgetExceeded:
            self.diagnostics.error(
                "T020",
                f"{subject} takes too long to compute",
                expr.span,
                notes=(f"one constant may take {self._per_value} operations, all {self._total}",),
                helps=('compute a large table once and read it: `data "file.json"`',),
            )
        finally:
            self.left -= min(self._evaluator.operations_spent, allowed)
        return None

    def _report_fault(self, fault: StepFault, expr: typed.TypedExpr, subject: str) -> None:
        why = WHY.get(fault.kind, fault.kind.name.lower())
        why += f": {fault.detail}" if fault.detail else ""
        at = fault.span or expr.span
        outside = at.source is not expr.span.source or not (
            expr.span.start <= at.start and at.end <= expr.span.end
        )
        self.diagnostics.error(
            "T020",
            f"{subject} has no value: {why}",
            expr.span if outside else at,
            also=((at, "it happens here"),) if outside else (),
        )


def declared_ns(module: Module, expr: typed.TypedExpr | None) -> int:
    """Gives a time of a module's `verify` block in ns; 0 if the block does not say it."""
    ns = Calculator(Diagnostics(), module.scope.params).value(expr, "a time") if expr else 0
    return ns if isinstance(ns, int) else 0


class ConstantChecker(CheckerPart):
    """Computes the constant expressions of one program."""

    def __init__(self, shared: Shared, loaded: LoadedProgram) -> None:
        super().__init__(shared)
        budgets = (CONSTANT_BUDGET, PROGRAM_BUDGET)
        self.calculator = Calculator(shared.diagnostics, None, budgets)
        self._loaded = loaded

    def const_value(
        self,
        expr: tree.SyntaxExpr,
        scope: FileScope,
        expected: Type,
        subject: str,
        around: Context | None = None,
        code: Code = "T008",
    ) -> Value | None:
        """Gives the value of a constant expression; None after a reported error.

        `around` is the place around the expression; a use of its locals is reported as `code`.
        """
        context = Context(scope, subject, constant=code, hidden=around)
        checked = self.shared.check_expr(expr, context, expected)
        return self.evaluate(checked, subject)

    def declared_value(
        self, decl: tree.ConstDecl, scope: FileScope, expected: Type, subject: str
    ) -> Value | None:
        """Gives the value of a declared constant; None after a reported error."""
        assert decl.value is not None
        context = Context(scope, subject, constant="T008")
        checked = self.shared.check_expr(decl.value, context, expected)
        if not self._is_computable(checked, subject):
            return None
        known = self._loaded.reading.known_constants(scope.loaded)
        return self.calculator.remembered_value(decl.name.text, checked, subject, known)

    def evaluate(self, checked: typed.TypedExpr, subject: str) -> Value | None:
        """Gives the value of an expression over constants alone; None after a reported error."""
        return (
            self.calculator.value(checked, subject)
            if self._is_computable(checked, subject)
            else None
        )

    def _is_computable(self, checked: typed.TypedExpr, subject: str) -> bool:
        if isinstance(checked.type, ErrorType):
            self.shared.names.losses += 1
            return False
        return self._may_be_evaluated(checked, subject)

    def check_number(
        self,
        expr: tree.SyntaxExpr,
        context: Context,
        expected: Type | None,
        subject: str,
        because: Because | None = None,
    ) -> typed.TypedExpr:
        """Gives the typed expression of a number, of type `expected`; ERROR after a report."""
        checked = self.shared.check_expr(expr, context, expected, because)
        if isinstance(checked.type, ErrorType):
            return checked
        sound = [self._is_computable_call(call, subject) for call in calls_in(checked)]
        return checked if all(sound) else error_expr(expr.span)

    def _may_be_evaluated(self, checked: typed.TypedExpr, subject: str) -> bool:
        """Whether all functions that an expression calls can be run now; reports one if not."""
        for call in calls_in(checked):
            if not self._is_computable_call(call, subject):
                return False
            param = self.shared.calls.param_read_by(call.fun)
            if param is not None:
                symbol, span = param
                self.diagnostics.error(
                    "T008",
                    f"{subject} cannot depend on the parameter `{symbol.name}`",
                    call.span,
                    "through this call",
                    also=((span, "read here"),),
                    notes=("parameters are set when a system is run, constants are not",),
                )
                return False
        return True

    def _is_computable_call(self, call: typed.TypedCall, subject: str) -> bool:
        """Whether the functions of a call have no errors and are no externs (reported as T008)."""
        calls = self.shared.calls
        if not calls.is_complete(call.fun):
            self.shared.names.losses += 1
            return False
        extern = calls.extern_called_by(call.fun)
        if extern is not None:
            self.diagnostics.error(
                "T008",
                f"{subject} cannot be computed by the extern `{extern.name}`",
                call.span,
                also=((extern.span, "declared here"),),
                notes=("externs run in the running program only",),
            )
        return extern is None

    def value_of_data_file(self, decl: tree.ConstDecl, t: Type, scope: FileScope) -> Value | None:
        """Gives the value in a constant's data file; None after reporting D001, D004 or D005."""
        assert decl.data is not None
        path = scope.loaded.path.parent / decl.data
        try:
            value, raw = self._loaded.reading.data_value(path, t, self.diagnostics.tell)
            self._loaded.add_data(decl.data, path, raw)
        except ReadError as error:
            if error.missing:
                self.diagnostics.error(
                    "D001",
                    f"cannot find the data file `{decl.data}`",
                    decl.data_span,
                    notes=("paths start at the folder of the file that names them",),
                    helps=near_name_helps(path),
                )
            else:
                self.diagnostics.error(
                    "D005",
                    f"cannot read the data file `{decl.data}`: {error}",
                    decl.data_span,
                )
            return None
        except DataError as error:
            self.diagnostics.error(
                "D004",
                f"`{decl.data}` is not a `{t}`",
                decl.data_span,
                str(error) if self._loaded.may_quote(path) else OUTSIDE,
                also=((decl.type.span, "this type is expected"),),
            )
            return None
        return value


UNIT_MAX = 16
"""Most characters of a unit."""
BUILTIN_TYPES: dict[str, Type] = {"bool": BOOL, "int": INT, "float": FLOAT, "duration": DURATION}


class TypeChecker(CheckerPart):
    """Checks type expressions of one program."""

    def __init__(self, shared: Shared) -> None:
        super().__init__(shared)
        self._around: Context | None = None

    def resolve_type(
        self,
        expr: tree.TypeExpr,
        scope: FileScope,
        around: Context | None = None,
        *,
        duration: bool = False,
        table: bool = False,
    ) -> Type:
        """Gives the type that a type expression means; ERROR after a reported error.

        `duration` allows a duration (else T014). `around` is the place around the expression, whose
        locals no size may use. `table` allows the large type of data that is only read in parts.
        """
        outer, self._around = self._around, around
        t = self._type_of_expr(expr, scope, TABLE_MAX if table else VALUE_MAX)
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

    def _type_of_expr(self, expr: tree.TypeExpr, scope: FileScope, most: int) -> Type:
        if isinstance(expr, tree.BuiltinType):
            return BUILTIN_TYPES[expr.name]
        if isinstance(expr, tree.RangedIntType):
            return self._int_type(expr, scope)
        if isinstance(expr, tree.NamedType):
            return self._named_type(expr, scope)
        if isinstance(expr, tree.RecordTypeExpr):
            return self._limited_type(self._record_type(expr, scope), expr, VALUE_MAX)
        if isinstance(expr, (tree.ArrayTypeExpr, tree.ListTypeExpr)):
            return self._limited_type(self._array_type(expr, scope, most), expr, most)
        if isinstance(expr, tree.UnitTypeExpr):
            return self._unit_type(expr, scope, most)
        self.shared.names.losses += 1  # the parser could not read this
        return ERROR

    def _unit_type(self, expr: tree.UnitTypeExpr, scope: FileScope, most: int) -> Type:
        """Gives a type with its unit; reports T030 for a wrong unit or a type without numbers."""
        t = self._type_of_expr(expr.base, scope, most)
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

    def _limited_type(self, t: Type, expr: tree.TypeExpr, most: int) -> Type:
        """Gives the type; reports T011 and gives ERROR if it has more than `most` scalars."""
        count = 0 if isinstance(t, ErrorType) else leaf_count(t)
        if count <= most:
            return t
        note = (
            f"a table of data has at most {TABLE_MAX} numbers"
            if most == TABLE_MAX
            else f"a value has at most {VALUE_MAX} numbers, as steps copy values whole"
        )
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

    def _array_size(self, expr: tree.SyntaxExpr, scope: FileScope, subject: str) -> int | None:
        value = self.shared.const_value(expr, scope, INT, subject, self._around)
        return value if isinstance(value, int) else None

    def _int_type(self, expr: tree.RangedIntType, scope: FileScope) -> Type:
        subject = "the bound of a type"
        low = self._array_size(expr.interval.low, scope, subject)
        high = self._array_size(expr.interval.high, scope, subject)
        if low is None or high is None:
            return ERROR
        if low > high:
            self.diagnostics.error(
                "V001",
                f"[{low}, {high}] is empty",
                expr.interval.span,
                "the lower bound is above the upper one",
                helps=(exchange_bounds(expr.interval.low.span, expr.interval.high.span),),
            )
            return ERROR
        return IntType(low, high)

    def _named_type(self, expr: tree.NamedType, scope: FileScope) -> Type:
        name = expr.ref.name.text
        if expr.ref.qualifier is None and name == "Mode" and name not in scope.entries:
            return MODE
        return self.referred_symbol(expr.ref, scope, "type", Type) or ERROR

    def _record_type(self, expr: tree.RecordTypeExpr, scope: FileScope) -> Type:
        fields: dict[str, Type] = {}
        spans: dict[str, Span] = {}
        failed = False
        for name, field_type in expr.fields:
            t = self.resolve_type(field_type, scope, self._around)
            failed = failed or isinstance(t, ErrorType)
            if self.shared.names.enter_if_new(name, spans, "field"):
                fields[name.text] = t
            else:
                failed = True
        if failed:
            return ERROR
        t = RecordType(tuple(fields.items()))
        self.shared.names.note_syntax_of_fields(t.fields, expr)
        return t

    def _array_type(
        self, expr: tree.ArrayTypeExpr | tree.ListTypeExpr, scope: FileScope, most: int
    ) -> Type:
        element = self.resolve_type(expr.element, scope, self._around)
        is_array = isinstance(expr, tree.ArrayTypeExpr)
        subject = "the size of an array" if is_array else "the capacity of a list"
        size_expr = expr.size if isinstance(expr, tree.ArrayTypeExpr) else expr.capacity
        size = self._array_size(size_expr, scope, subject)
        if size is None or isinstance(element, ErrorType):
            return ERROR
        if not 1 <= size <= most:
            self.diagnostics.error(
                "T011", f"{subject} cannot be {size}", size_expr.span, f"1 to {most} are possible"
            )
            return ERROR
        return ArrayType(element, size) if is_array else ListType(element, size)

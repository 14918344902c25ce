"""Constant expressions: what is computed when the program is compiled.

Purpose: values of constants, sizes, bounds of loops, data files; within a budget, so that
checking always ends.
Non-goals: numbers that depend on parameters (`elaborator.py`), the operations
(`language/evaluate/statements.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.expression_base import error_expr
from soter.language.check.expression_context import Context
from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.statements import BudgetExceeded, Evaluator
from soter.language.load.bounded_read import ReadError, near_names
from soter.language.load.data_files import DataError
from soter.language.model import typed
from soter.language.model.tree_walk import calls_in
from soter.language.model.types import ErrorType

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.check.checker_interface import Because, Shared
    from soter.language.check.scope import FileScope
    from soter.language.load.loader import LoadedProgram
    from soter.language.model.types import Type, Value
    from soter.language.syntax import tree

PROGRAM_BUDGET = 100_000_000
"""Operations that all constants of a program may take together: some twenty seconds."""
CONSTANT_BUDGET = 50_000_000
"""And one of them alone."""
NUMBERS_BUDGET = 2_000_000
"""And all numbers of one system: they are computed again for every choice of parameters."""
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
    """Evaluates closed expressions over some parameters, all within one budget of operations."""

    def __init__(
        self,
        diagnostics: Diagnostics,
        params: Mapping[typed.ParamSymbol, Value] | None = None,
        budgets: tuple[int, int] | None = None,
    ) -> None:
        """`budgets`: of operations, of one value and of all; those of a system by default."""
        self.diagnostics = diagnostics
        self._most, self.left = budgets or (NUMBERS_BUDGET // 2, NUMBERS_BUDGET)
        self._all = self.left
        self._evaluator = Evaluator(params or {}, None, self.left)

    def value_of(
        self, name: str, expr: typed.TypedExpr, what: str, known: dict[str, tuple[Value, int]]
    ) -> Value | None:
        """The value of a declared constant: as `value`, or as it is `known`, at the same price."""
        value, spent = known.get(name, (None, 0))
        if name in known and spent <= min(self.left, self._most):
            self.left -= spent
            return value
        left = self.left
        value = self.value(expr, what)
        if value is not None:
            known[name] = value, left - self.left
        return value

    def value(self, expr: typed.TypedExpr, what: str) -> Value | None:
        """The value, or None after a report (T020) that begins with `what`."""
        if isinstance(expr, typed.Literal):
            return expr.value
        if self.left <= 0:
            return None  # reported when the budget ran out
        allowed = min(self.left, self._most)
        self._evaluator.allow(allowed)
        self._evaluator.tell = lambda n: self.diagnostics.tell(
            f"{what}: {n / MILLION:.0f} million operations"
        )
        try:
            return self._evaluator.value(expr)
        except StepFault as fault:
            self._fault(fault, expr, what)
        except BudgetExceeded:
            self.diagnostics.error(
                "T020",
                f"{what} takes too long to compute",
                expr.span,
                notes=(f"one constant may take {self._most} operations, all {self._all}",),
                helps=('compute a large table once and read it: `data "file.json"`',),
            )
        finally:
            self.left -= min(self._evaluator.spent, allowed)
        return None

    def _fault(self, fault: StepFault, expr: typed.TypedExpr, what: str) -> None:
        why = WHY.get(fault.kind, fault.kind.name.lower())
        why += f": {fault.detail}" if fault.detail else ""
        at = fault.span or expr.span
        outside = at.source is not expr.span.source or not (
            expr.span.start <= at.start and at.end <= expr.span.end
        )
        self.diagnostics.error(
            "T020",
            f"{what} has no value: {why}",
            expr.span if outside else at,
            also=((at, "it happens here"),) if outside else (),
        )


class ConstantChecker:
    """Constant expressions of one program."""

    def __init__(self, shared: Shared, loaded: LoadedProgram) -> None:
        self.shared = shared
        self.diagnostics = shared.diagnostics
        budgets = (CONSTANT_BUDGET, PROGRAM_BUDGET)
        self.calculator = Calculator(shared.diagnostics, None, budgets)
        self._loaded = loaded

    def constant(
        self,
        expr: tree.SyntaxExpr,
        scope: FileScope,
        expected: Type,
        what: str,
        around: Context | None = None,
        code: Code = "T008",
    ) -> Value | None:
        """The value of a constant expression, or None after a report.

        `around` is the place it stands in; its locals are known too late, which is `code`.
        """
        context = Context(scope, what, constant=code, hidden=around)
        checked = self.shared.check_expr(expr, context, expected)
        return self.value(checked, what)

    def declared(
        self, decl: tree.ConstDecl, scope: FileScope, expected: Type, what: str
    ) -> Value | None:
        """The value of a declared constant, or None after a report."""
        assert decl.value is not None
        context = Context(scope, what, constant="T008")
        checked = self.shared.check_expr(decl.value, context, expected)
        if not self._computable(checked, what):
            return None
        known = self._loaded.reading.constants(scope.loaded)
        return self.calculator.value_of(decl.name.text, checked, what, known)

    def value(self, checked: typed.TypedExpr, what: str) -> Value | None:
        """Evaluate a checked expression without locals, topics and parameters of its own."""
        return self.calculator.value(checked, what) if self._computable(checked, what) else None

    def _computable(self, checked: typed.TypedExpr, what: str) -> bool:
        if isinstance(checked.type, ErrorType):
            self.shared.names.losses += 1
            return False
        return self._callable(checked, what)

    def number(
        self,
        expr: tree.SyntaxExpr,
        context: Context,
        expected: Type | None,
        what: str,
        because: Because | None = None,
    ) -> typed.TypedExpr:
        """An expression over constants and parameters, to be evaluated for each system.

        It has type `expected`, or ERROR after a report.
        """
        checked = self.shared.check_expr(expr, context, expected, because)
        if isinstance(checked.type, ErrorType):
            return checked
        sound = [self._sound(call, what) for call in calls_in(checked)]
        return checked if all(sound) else error_expr(expr.span)

    def _callable(self, checked: typed.TypedExpr, what: str) -> bool:
        """Whether every function it calls can be run now."""
        for call in calls_in(checked):
            if not self._sound(call, what):
                return False
            param = self.shared.calls.param_below(call.fun)
            if param is not None:
                symbol, span = param
                self.diagnostics.error(
                    "T008",
                    f"{what} cannot depend on the parameter `{symbol.name}`",
                    call.span,
                    "through this call",
                    also=((span, "read here"),),
                    notes=("parameters are set when a system is run, constants are not",),
                )
                return False
        return True

    def _sound(self, call: typed.TypedCall, what: str) -> bool:
        """Whether a function and all it calls are without errors and of Soter code."""
        calls = self.shared.calls
        if not calls.complete(call.fun):
            self.shared.names.losses += 1
            return False
        extern = calls.extern_below(call.fun)
        if extern is not None:
            self.diagnostics.error(
                "T008",
                f"{what} cannot be computed by the extern `{extern.name}`",
                call.span,
                also=((extern.span, "declared here"),),
                notes=("externs run in the running program only",),
            )
        return extern is None

    def data(self, decl: tree.ConstDecl, t: Type, scope: FileScope) -> Value | None:
        """The value of `data "file"`; D001, D004, D005 when it cannot be had."""
        assert decl.data is not None
        path = scope.loaded.path.parent / decl.data
        try:
            value, raw = self._loaded.reading.data(path, t, self.diagnostics.tell)
        except ReadError as error:
            if error.missing:
                self.diagnostics.error(
                    "D001",
                    f"cannot find the data file `{decl.data}`",
                    decl.data_span,
                    notes=("paths start at the folder of the file that names them",),
                    helps=near_names(path),
                )
            else:
                self.diagnostics.error(
                    "D005", f"cannot read the data file `{decl.data}`: {error}", decl.data_span
                )
            return None
        except DataError as error:
            self.diagnostics.error(
                "D004",
                f"`{decl.data}` is not a `{t}`",
                decl.data_span,
                str(error) if self._loaded.shows(path) else OUTSIDE,
                also=((decl.type.span, "this type is expected"),),
            )
            return None
        self._loaded.add_data(decl.data, path, raw)
        return value

"""The meaning of `ttf` and `safer`: what they compare has to be a number.

Purpose: the closures of `expressions.py`, but that a comparison whose operand is NaN is a fault,
`min`, `max` and `saturate` included, also in functions that the predicate calls. Unknown is unsafe.
Non-goals: functions of the prelude, which answer NaN with NaN; conditions elsewhere, which are
IEEE's; which comparisons may meet a NaN at all (`numbers_in_predicates.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.expressions import ExpressionEvaluator
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed as t
from soter.language.model.types import FloatType

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.language.evaluate.environment import Environment
    from soter.language.evaluate.expressions import Compiled, Extern
    from soter.language.model.types import Value

COMPARISONS = frozenset(("<", "<=", ">", ">=", "==", "!="))


def compared_operands(e: t.TypedExpr) -> tuple[t.TypedExpr, ...]:
    """The floats, or records and arrays of floats, that an expression itself compares."""
    if isinstance(e, t.TypedBinary) and e.op in COMPARISONS:
        return (e.left, e.right) if isinstance(e.left.type, FloatType) else ()
    if isinstance(e, t.Builtin) and (
        e.name == "saturate" or (e.name in ("min", "max") and isinstance(e.type, FloatType))
    ):
        return e.arguments
    return ()


@dataclass(eq=False, repr=False)
class _Operand(t.TypedExpr):
    """Its value, looked at as soon as it is evaluated."""

    value: t.TypedExpr


class PredicateEvaluator(Evaluator):
    """Compiles `ttf` and `safer` of one scope; arguments as those of `Evaluator`.

    A closure raises `StepFault` of the kind `NONFINITE` where a NaN is compared.
    """

    def __init__(
        self,
        params: Mapping[t.ParamSymbol, Value],
        externs: Mapping[t.FunSymbol, Extern] | None = None,
        budget: int | None = None,
        **names: Any,  # noqa: ANN401 - as `Evaluator` has them
    ) -> None:
        super().__init__(params, externs, budget, **names)
        self._prelude = Evaluator({})
        self.looked_at: frozenset[t.TypedExpr] | None = None
        """Only these operands are looked at; None: all. Set before anything is compiled."""

    def function(self, fun: t.FunSymbol) -> Callable[[Environment, Sequence[Value]], Value]:
        """As `Evaluator` says; of the prelude its own."""
        return self._prelude.function(fun) if fun.prelude else super().function(fun)

    def _comparing(self, e: Any) -> Compiled:  # noqa: ANN401 - a binary or a builtin operation
        compared = compared_operands(e)
        if self.looked_at is not None:
            compared = tuple([x for x in compared if x in self.looked_at])
        if isinstance(e, t.Builtin):
            e = replace(e, arguments=_looked_at(e.arguments, compared))
        else:
            left, right = _looked_at((e.left, e.right), compared)
            e = replace(e, left=left, right=right)
        return ExpressionEvaluator._EXPRESSIONS[type(e)](self, e)  # noqa: SLF001

    def _operand(self, e: _Operand) -> Compiled:
        value, span = self._expr(e.value), e.span

        def number(env: Environment) -> Value:
            found = value(env)
            if has_nan(found):
                raise StepFault(FaultKind.NONFINITE, span, "a NaN is compared")
            return found

        return number

    _EXPRESSIONS: ClassVar[
        dict[type[t.TypedExpr], Callable[[ExpressionEvaluator, Any], Compiled]]
    ] = {
        **ExpressionEvaluator._EXPRESSIONS,  # noqa: SLF001 - the table that it extends
        t.TypedBinary: _comparing,  # type: ignore[dict-item]
        t.Builtin: _comparing,  # type: ignore[dict-item]
        _Operand: _operand,  # type: ignore[dict-item]
    }


def _looked_at(
    operands: tuple[t.TypedExpr, ...], compared: tuple[t.TypedExpr, ...]
) -> tuple[t.TypedExpr, ...]:
    return tuple([_Operand(e.type, e.span, e) if e in compared else e for e in operands])


def has_nan(value: Value) -> bool:
    """Whether a number, or one of a record, array or list, is NaN."""
    if isinstance(value, tuple):
        return any(has_nan(v) for v in value)
    return bool(value != value)  # noqa: PLR0124  only NaN differs from itself

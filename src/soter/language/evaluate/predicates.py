"""Predicates: their parts, whether two expressions are alike, and the meaning of `ttf` and `safer`.

Purpose: `conjuncts` takes `a && b` apart, also where it stands in a function that only returns it;
`premise_of` says what an implication asks for; `same_expression` tells that `x - 1 < x - 1` has one
value on both sides. `PredicateEvaluator` judges `ttf` and `safer`: there a comparison whose operand
is NaN is a fault, also in functions that the predicate calls. Unknown is unsafe.
Non-goals: any other rewriting; expressions that are equal and written otherwise; functions of the
prelude, which answer NaN with NaN; which comparisons may meet a NaN (`numbers_in_predicates.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.expressions import ExpressionEvaluator
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed
from soter.language.model import typed as t
from soter.language.model.tree_walk import children, nodes, rewritten
from soter.language.model.types import FloatType

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.language.evaluate.environment import Environment
    from soter.language.evaluate.expressions import Compiled, Extern
    from soter.language.model.types import Value


PARTS_MAX = 16


def conjuncts(predicate: typed.TypedExpr) -> list[typed.TypedExpr]:
    """Expressions whose conjunction is the predicate, from left to right; at most `PARTS_MAX`."""
    parts = _parts(predicate)
    return parts if len(parts) <= PARTS_MAX else [predicate]


def disjuncts(predicate: typed.TypedExpr) -> list[typed.TypedExpr]:
    """Expressions whose disjunction is the predicate: `a || b`, and `!e` by the parts of e."""
    inner = returned(predicate) if isinstance(predicate, typed.TypedCall) else None
    if inner is not None and len(parts := disjuncts(inner)) > 1:
        return parts
    if isinstance(predicate, typed.TypedBinary) and predicate.op == "||":
        return [*disjuncts(predicate.left), *disjuncts(predicate.right)]
    if isinstance(predicate, typed.TypedUnary) and predicate.op == "!":
        return [replace(predicate, operand=part) for part in _parts(predicate.operand)]
    return [predicate]


def premise_of(predicate: typed.TypedExpr) -> typed.TypedExpr | None:
    """Of an implication, `!p || q`, `q || !p` or `p ? q : true`, the p; None of anything else."""
    e = returned(predicate) if isinstance(predicate, typed.TypedCall) else predicate
    if isinstance(e, typed.Conditional) and isinstance(e.otherwise, typed.Literal):
        return e.condition if e.otherwise.value is True else None
    if not isinstance(e, typed.TypedBinary) or e.op != "||":
        return None
    negated = [
        x.operand for x in (e.left, e.right) if isinstance(x, typed.TypedUnary) and x.op == "!"
    ]
    return negated[0] if len(negated) == 1 else None


def _parts(e: typed.TypedExpr) -> list[typed.TypedExpr]:
    if isinstance(e, typed.TypedBinary) and e.op == "&&":
        return [*_parts(e.left), *_parts(e.right)]
    if isinstance(e, typed.TypedCall):
        inner = returned(e)
        if inner is not None and len(parts := _parts(inner)) > 1:
            return parts
    return [e]


def returned(call: typed.TypedCall) -> typed.TypedExpr | None:
    """What a call stands for, where the function is nothing but one `return`."""
    body = call.fun.body
    if body is None or len(body) != 1 or not isinstance(body[0], typed.TypedReturn):
        return None
    given = dict(zip(call.fun.parameters, call.arguments, strict=True))

    def argument(e: typed.TypedExpr) -> typed.TypedExpr:
        return given.get(e.variable, e) if isinstance(e, typed.VarRead) else e

    expansion: typed.TypedExpr = rewritten(body[0].value, argument)
    return expansion


def same_expression(a: t.TypedExpr, b: t.TypedExpr) -> bool:
    """Whether two expressions are written alike, and so have one value where they are judged."""
    return _form(a) == _form(b)


def _form(e: Any) -> object:  # noqa: ANN401 - any part of an expression
    """What an expression is made of, but for where it stands.

    A choice, and what an extern answers, is alike to nothing.
    """
    if isinstance(e, t.TypedChoose) or (isinstance(e, t.TypedCall) and _may_differ(e.fun)):
        return object()
    own: list[object] = [type(e).__name__]
    for name in ("op", "name", "index", "instance"):
        value = getattr(e, name, None)
        own += [name, value] if isinstance(value, (str, int)) else []
    for name in ("variable", "topic", "param", "module", "fun"):
        value = getattr(e, name, None)
        own += [name, value if isinstance(value, str) else id(value)]
    if isinstance(e, t.Literal):
        own.append(repr(e.value))
    return (*own, *[_form(child) for child in children(e)])


def _may_differ(fun: t.FunSymbol) -> bool:
    """Whether two calls with equal arguments may differ: an extern may keep something."""
    todo, seen = [fun], {fun}
    while todo:
        body = todo.pop().body
        if body is None:
            return True
        for n in nodes(body):
            if isinstance(n, t.TypedChoose):
                return True
            if isinstance(n, t.TypedCall) and n.fun not in seen and not n.fun.prelude:
                seen.add(n.fun)
                todo.append(n.fun)
    return False


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

"""Evaluates `ttf` and `safer`, where a NaN is a fault, and finds which operands may be NaN.

Purpose: `PredicateEvaluator` evaluates `ttf` and `safer`, in which a comparison with a NaN is a
fault, also in functions that the predicate calls: what is unknown counts as unsafe. `maybe_nan`
decides once, from declared sets and types, which compared operands may be NaN in a step of the DM;
C, proofs and the re-checker check only these.
Non-goals: prelude functions, which answer NaN with NaN; enclosing conditions, which refine nothing;
the parts of predicates (`language/model/tree_walk.py`).

Topics hold finite numbers in their sets, as the gate refuses all others; results of extern
functions are unknown. Prelude functions follow the domains of `function_error_bounds.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.expressions import ExpressionEvaluator
from soter.language.evaluate.range_evaluation import (
    ELEMENTS,
    UNKNOWN,
    RangeEvaluator,
    ReadPlace,
    TooHardError,
    all_values,
)
from soter.language.evaluate.ranges import ANY_FLOAT, TOTAL, Range, range_of_prelude
from soter.language.evaluate.statements import Evaluator
from soter.language.evaluate.topic_ranges import MOST, range_in_set
from soter.language.model import typed as t
from soter.language.model.tree_walk import nodes
from soter.language.model.types import (
    ArrayType,
    FloatType,
    ListType,
    RecordType,
    has_list,
    leaf_count,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.language.evaluate.environment import Environment
    from soter.language.evaluate.expressions import Compiled, Extern
    from soter.language.evaluate.range_evaluation import Known
    from soter.language.model.system import Module, System
    from soter.language.model.types import Type, Value


COMPARISONS = frozenset(("<", "<=", ">", ">=", "==", "!="))


def compared_operands(e: t.TypedExpr) -> tuple[t.TypedExpr, ...]:
    """Gives the floats, or records and arrays of floats, that `e` directly compares."""
    if isinstance(e, t.TypedBinary) and e.op in COMPARISONS:
        return (e.left, e.right) if isinstance(e.left.type, FloatType) else ()
    if isinstance(e, t.Builtin) and (
        e.name == "saturate" or (e.name in ("min", "max") and isinstance(e.type, FloatType))
    ):
        return e.arguments
    return ()


@dataclass(eq=False, repr=False)
class _Operand(t.TypedExpr):
    """A compared operand, whose evaluation raises a StepFault if its value is NaN."""

    value: t.TypedExpr


class PredicateEvaluator(Evaluator):
    """Compiles `ttf` and `safer` of one scope; has the arguments of `Evaluator`.

    A closure raises `StepFault` of the kind `NONFINITE` if a NaN is compared.
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
        self.nan_checks: frozenset[t.TypedExpr] | None = None
        """The operands that are checked for NaN; None: all. Set this before compiling."""

    def closure_of(self, fun: t.FunSymbol) -> Callable[[Environment, Sequence[Value]], Value]:
        """Gives a function's closure as `Evaluator` does; the prelude's have no checks for NaN."""
        return self._prelude.closure_of(fun) if fun.prelude else super().closure_of(fun)

    def _compile_compared(self, e: Any) -> Compiled:  # noqa: ANN401 - binary or builtin
        compared = compared_operands(e)
        if self.nan_checks is not None:
            compared = tuple([x for x in compared if x in self.nan_checks])
        if isinstance(e, t.Builtin):
            e = replace(e, arguments=_with_nan_checks(e.arguments, compared))
        else:
            left, right = _with_nan_checks((e.left, e.right), compared)
            e = replace(e, left=left, right=right)
        return ExpressionEvaluator._EXPRESSIONS[type(e)](self, e)  # noqa: SLF001

    def _compile_operand(self, e: _Operand) -> Compiled:
        value, span = self._compile(e.value), e.span

        def value_without_nan(env: Environment) -> Value:
            found = value(env)
            if has_nan(found):
                raise StepFault(FaultKind.NONFINITE, span, "a NaN is compared")
            return found

        return value_without_nan

    _EXPRESSIONS: ClassVar[
        dict[type[t.TypedExpr], Callable[[ExpressionEvaluator, Any], Compiled]]
    ] = {
        **ExpressionEvaluator._EXPRESSIONS,  # noqa: SLF001 - the table that it extends
        t.TypedBinary: _compile_compared,  # type: ignore[dict-item]
        t.Builtin: _compile_compared,  # type: ignore[dict-item]
        _Operand: _compile_operand,  # type: ignore[dict-item]
    }


def _with_nan_checks(
    operands: tuple[t.TypedExpr, ...], compared: tuple[t.TypedExpr, ...]
) -> tuple[t.TypedExpr, ...]:
    return tuple([_Operand(e.type, e.span, e) if e in compared else e for e in operands])


def has_nan(value: Value) -> bool:
    """Whether a value is NaN or, if it is a record, array or list, contains one."""
    if isinstance(value, tuple):
        return any(has_nan(v) for v in value)
    return bool(value != value)  # noqa: PLR0124  only NaN differs from itself


BUDGET = 20_000
TURNS = 3
"""Rounds of a loop; variables that change even later may have any value of their type."""
TIMES = Range(0.0, 1e10)
"""The range of times in seconds: more than 64 bits of nanoseconds hold."""


def maybe_nan(system: System, module: Module, *more: t.TypedExpr) -> frozenset[t.TypedExpr]:
    """Gives the compared operands in `ttf`, `safer` and `progress` that may be NaN.

    It also looks at the expressions `more`. An operand in a called function counts in all calls.
    """
    symbol = module.symbol
    found: set[t.TypedExpr] = set()
    for predicate in (symbol.ttf, symbol.safer, *symbol.verify.progress, *more):
        if predicate is None:
            continue
        looking = _NanFinder(system, module)
        try:
            looking.evaluate(predicate)
            found |= looking.found
        except TooHardError:
            found |= operands_compared_in(predicate)
    return frozenset(found)


def operands_compared_by(fun: t.FunSymbol) -> set[t.TypedExpr]:
    """Gives the operands that a function or its callees compare; none for the prelude."""
    return set() if fun.prelude else operands_compared_in(*(fun.body or ()))


def operands_compared_in(*roots: object) -> set[t.TypedExpr]:
    """Gives operands compared in code and its callees, without literals and prelude operands."""
    found: set[t.TypedExpr] = set()
    todo, seen = list(roots), set()
    while todo:
        for n in nodes([todo.pop()]):
            if isinstance(n, t.TypedExpr):
                found |= {e for e in compared_operands(n) if not _is_number_literal(e)}
            if isinstance(n, t.TypedCall) and n.fun not in seen and not n.fun.prelude:
                seen.add(n.fun)
                todo += n.fun.body or ()
    return found


def _is_number_literal(e: t.TypedExpr) -> bool:
    return isinstance(e, t.Literal) and not has_nan(e.value)


class _NanFinder(RangeEvaluator):
    """Evaluates code over ranges, and collects compared operands that may be NaN in `found`."""

    def __init__(self, system: System, module: Module) -> None:
        super().__init__(module.scope, module.period_ns, lambda place: _range_at(system, place))
        self.system = system
        self.left = BUDGET
        self.compared: set[t.TypedExpr] = set()
        self.found: set[t.TypedExpr] = set()

    def evaluate(self, e: t.TypedExpr) -> Known:
        """Gives the range of `e`; adds `e` to `found` if it is compared and may be NaN."""
        known = super().evaluate(e)
        if e in self.compared and any(r.nan for r in self._leaves(known, e.type)):
            self.found.add(e)
        return known

    def _range_compared(self, e: Any) -> Known:  # noqa: ANN401 - binary or builtin
        self.compared |= set(compared_operands(e))
        return RangeEvaluator.EXPRESSIONS[type(e)](self, e)

    # ------------------------------------------------------------ calls

    def _range_of_call(self, e: t.TypedCall) -> Known:
        if e.fun.body is not None and not e.fun.prelude:
            return super()._range_of_call(e)
        values = [self.evaluate(a) for a in e.arguments]
        if e.fun.body is None:
            return all_values(e.type)
        if e.fun.name in TOTAL:
            arguments = [self._range(g, a.type) for g, a in zip(values, e.arguments, strict=True)]
            return range_of_prelude(e.fun.name, arguments)
        outside, self.variables = self.variables, dict(zip(e.fun.parameters, values, strict=True))
        compared, found, self.compared, self.found = self.compared, self.found, set(), set()
        try:
            returned, _ = self._run_body(e.fun.body, None, e.type)
        finally:
            self.variables, self.compared, self.found = outside, compared, found
        return all_values(e.type) if returned is None else returned

    # ------------------------------------------------------------ arrays and lists

    def _range_of_literal(self, e: t.Literal) -> Known:
        if leaf_count(e.type) <= ELEMENTS:
            return super()._range_of_literal(e)
        return UNKNOWN

    def _range_of_index(self, e: t.Index) -> Known:
        target = e.target
        if isinstance(target, t.Literal) and isinstance(e.type, FloatType):
            self.bounds(e.index)
            return self._table_range(target)
        known, of = self.evaluate(target), target.type
        long = isinstance(of, ListType) or (isinstance(of, ArrayType) and of.size > ELEMENTS)
        if long and isinstance(known, ReadPlace) and known.kind == "topic":
            self.bounds(e.index)
            return _finite_values(e.type)
        return super()._range_of_index(e)

    def _table_range(self, table: t.Literal) -> Range:
        known = self._literals.get(table)
        if known is None:
            values = [float(v) for v in table.value]
            clear = not any(math.isnan(v) for v in values) and values
            known = Range(min(values), max(values)) if clear else ANY_FLOAT
            self._literals[table] = known
        return known

    def _range_of_length(self, e: t.TypedLength) -> Known:
        if isinstance(e.target.type, ListType):
            self.evaluate(e.target)
        return super()._range_of_length(e)

    def _run_plain(self, s: t.TypedStmt) -> bool:
        if not isinstance(s, (t.TypedAssign, t.TypedPush)):
            return super()._run_plain(s)
        variable, path = s.place.variable, s.place.path
        steps = [Range(k, k) if isinstance(k, int) else self.bounds(k) for k in path]
        value = self.evaluate(s.value)
        if isinstance(s, t.TypedAssign):
            old = self.variables.get(variable, UNKNOWN)
            self.variables[variable] = self._with_part(old, variable.type, steps, value)
        else:
            self.variables[variable] = all_values(variable.type)
        return True

    def _with_part(self, old: Known, of: Type, steps: list[Range], value: Known) -> Known:
        """Gives `old` in which the part at one of the places `steps` may now be `value`."""
        if not steps:
            return value
        (at, *rest), parts = steps, []
        if isinstance(of, ListType):
            return UNKNOWN
        for k, (part, t_) in enumerate(self._split(old, of)):
            if not at.holds(k):
                parts.append(part)
                continue
            new = self._with_part(part, t_, rest, value)
            parts.append(new if at.single else self._hull(part, new, t_))
        return tuple(parts)

    def _run_loop(self, s: t.ForRange | t.ForEach, returned: Known, of: Type) -> tuple[Known, bool]:
        """Runs the body until the ranges before each round no longer change."""
        if isinstance(s, t.ForRange):
            item: Known = Range(s.low, s.high - 1)
            if s.high <= s.low:
                return returned, True
        else:
            item = self._element_range(self.evaluate(s.sequence), s.sequence.type)
        turns = 0
        while True:
            before = dict(self.variables)
            self.variables[s.variable] = item
            returned, falls = self._run_body(s.body, returned, of)
            after = self._merged_variables([before, *([self.variables] if falls else [])], before)
            if after == before:
                self.variables = before
                return returned, True
            turns += 1
            if turns >= TURNS:
                after = {v: k if k == before[v] else all_values(v.type) for v, k in after.items()}
            self.variables = after

    def _element_range(self, whole: Known, of: Type) -> Known:
        """Gives the range of an element of an array or a list."""
        assert isinstance(of, (ArrayType, ListType))
        if isinstance(whole, ReadPlace) and whole.kind == "topic":
            return _finite_values(of.element)
        if not isinstance(whole, tuple) or not whole or isinstance(of, ListType):
            return all_values(of.element)
        return self._hull_of_all(whole, of.element)

    EXPRESSIONS: ClassVar[dict[type[t.TypedExpr], Callable[[Any, Any], Known]]] = {
        **RangeEvaluator.EXPRESSIONS,
        t.TypedBinary: _range_compared,
        t.Builtin: _range_compared,
        t.TypedCall: _range_of_call,
        t.Literal: _range_of_literal,
        t.Index: _range_of_index,
        t.TypedLength: _range_of_length,
    }


def _range_at(system: System, place: ReadPlace) -> Range:
    """Gives the range of the values that a place may have; topics keep to their sets."""
    if place.kind == "topic" and not has_list(system.topics[place.index].type):
        return range_in_set(system.topics[place.index], place)
    if place.kind in ("time", "age", "margin"):
        return TIMES
    known = all_values(place.type) if place.kind == "truth" else _finite_values(place.type)
    if not isinstance(known, Range):
        raise TooHardError
    return known


def _finite_values(of: Type) -> Known:
    """Gives the range of all values of a topic of this type, whose numbers are finite."""
    if isinstance(of, FloatType):
        return Range(-MOST, MOST)
    if isinstance(of, RecordType) and of.scalars <= ELEMENTS:
        return tuple([_finite_values(f) for _, f in of.fields])
    if isinstance(of, ArrayType) and of.size <= ELEMENTS:
        return (_finite_values(of.element),) * of.size
    return all_values(of)

"""Lowers statements to Core, and the functions that they call.

Purpose: early returns become a single exit. Functions are lowered on demand, callees first, under
unique names.
Non-goals: expressions (`lower_expressions.py`), what steps consist of (`steps.py`, `plants.py`),
C names.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core_check import broken_promises
from soter.core.lower_expressions import ExpressionBuilder
from soter.language.check.statements import always_returns
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.evaluate.predicates import operands_compared_by
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import BOOL, INT, ArrayType, ListType, RecordType, default_value
from soter.language.model.values import Table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Scope, System
    from soter.language.model.types import Type, Value


def _if_with_rest(s: typed.TypedIf, rest: tuple[typed.TypedStmt, ...]) -> typed.TypedIf | None:
    """Gives an `if` with `rest` appended to its only arm that does not return; or None.

    None if several arms do not return, or if that arm may return.
    """
    arms = [*(b for _, b in s.arms), s.otherwise]
    falling = [i for i, b in enumerate(arms) if not always_returns(b)]
    if len(falling) > 1 or any(may_return(x) for i in falling for x in arms[i]):
        return None
    *appended, otherwise = [(*b, *rest) if i in falling else b for i, b in enumerate(arms)]
    conditions = [condition for condition, _ in s.arms]
    return typed.TypedIf(s.span, tuple(zip(conditions, appended, strict=True)), otherwise)


class Builder(ExpressionBuilder):
    """Lowers the body of one function, step or predicate."""

    def __init__(
        self,
        functions: FunctionTable,
        system: System,
        scope: Scope | None,
        params: Mapping[typed.ParamSymbol, Value] | None = None,
    ) -> None:
        super().__init__(functions, system, scope, params)
        self.outputs: dict[typed.TopicSymbol, int] = {}
        self._result: tuple[str, Type] | None = None
        self.leave: str | None = None
        """The name of the flag that is set once the function has returned; None: there is none."""

    # ------------------------------------------------------------ statements

    def lower_block(self, statements: tuple[typed.TypedStmt, ...]) -> None:
        """Lowers statements; those after a possible return run only if it did not happen."""
        for position, s in enumerate(statements):
            rest = statements[position + 1 :]
            if self._result is not None and may_return(s):
                self._lower_with_return(s, rest)
                return
            self.lower_statement(s)

    def _lower_with_return(self, s: typed.TypedStmt, rest: tuple[typed.TypedStmt, ...]) -> None:
        if isinstance(s, typed.TypedReturn):
            self.lower_statement(s)
            return
        if isinstance(s, typed.TypedIf) and (whole := _if_with_rest(s, rest)) is not None:
            self._lower_if(whole)
            return
        if self.leave is None:
            self.leave = self.unused_name("done")
            self._blocks[0].insert(0, core.Let(s.span, self.leave, core.Const(BOOL, False), True))
        self.lower_statement(s)
        if rest:
            inner, _ = self.statements_of(lambda: self.lower_block(rest))
            if inner:
                undone = core.Unary(BOOL, "not", core.Var(BOOL, self.leave))
                self.emit(core.If(rest[0].span, undone, inner, ()))

    def lower_statement(self, s: typed.TypedStmt) -> None:
        """Lowers one statement."""
        if isinstance(s, typed.TypedDeclare):
            value = self.expr(s.value)
            name = self.name_variable(s.variable)
            self.emit(core.Let(s.span, name, value, s.variable.kind == "var"))
        elif isinstance(s, typed.TypedAssign):
            path = self._lowered_path(s.place)
            value = self.expr(s.value)
            variable = s.place.variable
            self.emit(core.Set(s.span, self.names[variable], variable.type, path, value))
        elif isinstance(s, typed.TypedPush):
            path = self._lowered_path(s.place)
            value = self.expr(s.value)
            variable = s.place.variable
            self.emit(core.Push(s.span, self.names[variable], variable.type, path, value))
        elif isinstance(s, typed.TypedPublish):
            self.emit(core.Publish(s.span, self.outputs[s.topic], self.expr(s.value), s.limit))
        elif isinstance(s, typed.TypedReturn):
            assert self._result is not None
            value = self.expr(s.value)
            self.emit(core.Set(s.span, self._result[0], self._result[1], (), value))
            if self.leave is not None:
                self.emit(core.Set(s.span, self.leave, BOOL, (), core.Const(BOOL, True)))
        elif isinstance(s, typed.Assert):
            self.emit(core.Guard(s.span, self.expr(s.condition), FaultKind.ASSERT))
        elif isinstance(s, typed.TypedIf):
            self._lower_if(s)
        elif isinstance(s, typed.ForRange):
            self._lower_for_range(s)
        else:
            assert isinstance(s, typed.ForEach)
            self._lower_for_each(s)

    def _lowered_path(self, place: typed.Place) -> tuple[int | core.Expr, ...]:
        path: list[int | core.Expr] = []
        prefix: core.Expr = core.Var(place.variable.type, self.names[place.variable])
        for step in place.path:
            t = prefix.type
            if isinstance(step, int):
                assert isinstance(t, RecordType)
                path.append(step)
                prefix = core.Field(t.fields[step][1], prefix, step)
            else:
                index = self.index_inside(prefix, self.expr(step), step.span)
                assert isinstance(t, (ArrayType, ListType))
                path.append(index)
                prefix = core.Element(t.element, prefix, index)
        return tuple(path)

    def _lower_if(self, s: typed.TypedIf) -> None:
        (condition, body), *more = s.arms
        c = self.expr(condition)
        if isinstance(c, core.Const):  # a parameter decides: the other branch is not there
            if c.value:
                self.lower_block(body)
            elif more:
                self._lower_if(typed.TypedIf(more[0][0].span, tuple(more), s.otherwise))
            else:
                self.lower_block(s.otherwise)
            return
        then, _ = self.statements_of(lambda: self.lower_block(body))
        if more:
            rest = typed.TypedIf(more[0][0].span, tuple(more), s.otherwise)
            otherwise, _ = self.statements_of(lambda: self._lower_if(rest))
        else:
            otherwise, _ = self.statements_of(lambda: self.lower_block(s.otherwise))
        self.emit(core.If(s.span, c, then, otherwise))

    def _lower_guarded_body(self, body: tuple[typed.TypedStmt, ...], span: Span) -> None:
        """Lowers the body of a loop; the emitted code skips it once the function has returned."""
        if self.leave is None or self._result is None or not any(may_return(x) for x in body):
            self.lower_block(body)
            return
        inner, _ = self.statements_of(lambda: self.lower_block(body))
        self.emit(core.If(span, core.Unary(BOOL, "not", core.Var(BOOL, self.leave)), inner, ()))

    def _lower_for_range(self, s: typed.ForRange) -> None:
        name = self.name_variable(s.variable)
        body, _ = self.statements_of(lambda: self._lower_guarded_body(s.body, s.span))
        if s.low < s.high:
            self.emit(core.Loop(s.span, name, s.low, s.high, body))

    def _lower_for_each(self, s: typed.ForEach) -> None:
        sequence = self.expr(s.sequence)
        if not isinstance(sequence, core.Const) or not isinstance(sequence.value, Table):
            sequence = self.let(s.span, "items", sequence)
        t = sequence.type
        index = self.unused_name("k")
        i = core.Var(INT, index)
        assert isinstance(t, (ArrayType, ListType))

        def lower_round() -> None:
            name = self.name_variable(s.variable)
            self.emit(core.Let(s.span, name, core.Element(t.element, sequence, i)))
            self._lower_guarded_body(s.body, s.span)

        block, _ = self.statements_of(lower_round)
        limit = t.size if isinstance(t, ArrayType) else t.capacity
        if isinstance(t, ListType):
            inside = core.Binary(BOOL, "<", i, core.Length(INT, sequence))
            block = (core.If(s.span, inside, block, ()),)
        self.emit(core.Loop(s.span, index, 0, limit, block))

    # ------------------------------------------------------------ functions

    def function_body(
        self, body: tuple[typed.TypedStmt, ...], result: Type, span: Span
    ) -> tuple[tuple[core.Stmt, ...], core.Expr]:
        """Gives the statements and the result of a function; the function has a single exit."""
        straight = (
            body
            and isinstance(body[-1], typed.TypedReturn)
            and not any(may_return(s) for s in body[:-1])
        )
        if straight:
            last = body[-1]
            assert isinstance(last, typed.TypedReturn)
            for s in body[:-1]:
                self.lower_statement(s)
            value = self.expr(last.value)
            return self.take_statements(), value
        name = self.unused_name("result")
        self.emit(core.Let(span, name, core.Const(result, default_value(result)), True))
        self._result = (name, result)
        if needs_return_flag(body):
            self.leave = self.unused_name("done")
            self.emit(core.Let(span, self.leave, core.Const(BOOL, False), True))
        self.lower_block(body)
        return self.take_statements(), core.Var(result, name)


def may_return(s: typed.TypedStmt) -> bool:
    """Whether a statement contains a `return`."""
    if isinstance(s, typed.TypedReturn):
        return True
    if isinstance(s, typed.TypedIf):
        return any(may_return(x) for b in (*(b for _, b in s.arms), s.otherwise) for x in b)
    if isinstance(s, (typed.ForRange, typed.ForEach)):
        return any(may_return(x) for x in s.body)
    return False


def needs_return_flag(body: tuple[typed.TypedStmt, ...]) -> bool:
    """Whether a loop in the body may return, so that the function needs a flag for that."""
    for s in body:
        if isinstance(s, (typed.ForRange, typed.ForEach)) and may_return(s):
            return True
        if isinstance(s, typed.TypedIf) and any(
            needs_return_flag(b) for b in (*(b for _, b in s.arms), s.otherwise)
        ):
            return True
    return False


class FunctionTable:
    """The lowered functions of one system."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.by_name: dict[str, core.Function] = {}
        self._made: dict[object, core.Function] = {}
        self._meanings: dict[object, str] = {}
        self._reads: dict[typed.FunSymbol, frozenset[typed.ParamSymbol]] = {}

    def unique_name(self, base: str) -> str:
        """Gives a name made from `base` that no other function has."""
        name, n = base.replace(".", "_"), 2
        while name in self.by_name:
            name = f"{base.replace('.', '_')}_{n}"
            n += 1
        return name

    def enter_function(self, function: core.Function) -> None:
        """Enters a function in the table, which already has its callees."""
        assert not (found := broken_promises(self.system, self.by_name, function)), found
        self.by_name[function.name] = function

    def lowered_function(
        self,
        fun: typed.FunSymbol,
        params: Mapping[typed.ParamSymbol, Value],
        maybe_nan: frozenset[typed.TypedExpr] = frozenset(),
    ) -> core.Function:
        """Gives the Core function of a source function for these values of parameters.

        Calls share the function if the parameters that it reads are equal, and if the same compared
        operands are checked for NaN.
        """
        nan_checks = maybe_nan & operands_compared_by(fun) if maybe_nan else maybe_nan
        plain = fun, *sorted((p.name, repr(params[p])) for p in self._params_of(fun))
        key = nan_checks, *plain
        known = self._made.get(key)
        if known is not None:
            return known
        builder = Builder(self, self.system, None, params)
        builder.maybe_nan = nan_checks
        parameters = tuple(core.Parameter(builder.name_variable(p), p.type) for p in fun.parameters)
        if fun.body is None:
            body: tuple[core.Stmt, ...] = ()
            result: core.Expr | None = None
            can_fault = True
        else:
            body, result = builder.function_body(fun.body, fun.result, fun.span)
            can_fault = builder.can_fault
        name = self.unique_name(fun.name)
        function = core.Function(
            name=name,
            source_name=fun.name,
            parameters=parameters,
            result_type=fun.result,
            body=body,
            result=result,
            span=fun.span,
            source=fun.source,
            can_fault=can_fault,
            leave=builder.leave,
            meaning=self._meanings.setdefault(plain, name),
        )
        self._made[key] = function
        self.enter_function(function)
        return function

    def _params_of(self, fun: typed.FunSymbol) -> frozenset[typed.ParamSymbol]:
        """Gives the parameters that a function reads, itself or in its callees."""
        known = self._reads.get(fun)
        if known is None:
            body = list(nodes(fun.body or ()))
            params = {n.param for n in body if isinstance(n, typed.ParamRead)}
            params |= {
                p for n in body if isinstance(n, typed.TypedCall) for p in self._params_of(n.fun)
            }
            known = self._reads[fun] = frozenset(params)
        return known

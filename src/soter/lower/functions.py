"""The functions a system uses, lowered on demand, callees first.

Purpose: one table from source functions to Core functions, with unique names.
Non-goals: expressions (`builder.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.lower import core
from soter.lower.builder import Builder
from soter.program.evaluate import Evaluator

if TYPE_CHECKING:
    from soter.program import typed
    from soter.program.system import System


class FunctionTable:
    """Lowered functions of one system."""

    def __init__(self, system: System) -> None:
        self.system = system
        params = {p: system.params[p.name] for p in system.program.params.values()}
        self.evaluator = Evaluator(params)
        self.by_name: dict[str, core.Function] = {}
        self._by_symbol: dict[typed.FunSymbol, core.Function] = {}

    def unique(self, base: str) -> str:
        """A function name not taken yet."""
        name, n = base.replace(".", "_"), 2
        while name in self.by_name:
            name = f"{base.replace('.', '_')}_{n}"
            n += 1
        return name

    def add(self, function: core.Function) -> None:
        """Enter a function that did not come from a `fun` declaration."""
        self.by_name[function.name] = function

    def require(self, fun: typed.FunSymbol) -> core.Function:
        """The Core function of a source function."""
        known = self._by_symbol.get(fun)
        if known is not None:
            return known
        builder = Builder(self, self.system, None)
        parameters = tuple(core.Parameter(builder.bind(p), p.type) for p in fun.parameters)
        if fun.body is None:
            body: tuple[core.Stmt, ...] = ()
            result: core.Expr | None = None
            can_fault = True
        else:
            body, result = builder.function_body(fun.body, fun.result, fun.span)
            can_fault = builder.can_fault
        function = core.Function(
            self.unique(fun.name),
            fun.name,
            parameters,
            fun.result,
            body,
            result,
            fun.span,
            fun.source,
            can_fault,
        )
        self._by_symbol[fun] = function
        self.by_name[function.name] = function
        return function

"""How many rounds of loops a step may take: absurd numbers are T007.

Purpose: every loop has a bound, but a loop in a loop in a loop may still never end in practice;
an upper bound on the rounds of every step, calls included.
Non-goals: execution times (they need a machine), costs of single operations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.types import ArrayType, ListType
from soter.program.walk import calls_in

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span

MAX_ROUNDS = 100_000_000
"""Rounds a step may take: a tenth of a second of the fastest possible loop."""


def check_rounds(program: typed.Program, diagnostics: Diagnostics) -> None:
    """T007 for functions, steps and predicates that may take more rounds than `MAX_ROUNDS`."""
    counter = _Counter(diagnostics)
    for fun in program.funs.values():
        counter.function(fun)
    for node in program.nodes.values():
        counter.body((*node.step, *(node.takeover or ())), node.name, node.span)
    for plant in program.plants.values():
        exprs = [e for _, e in plant.lets]
        exprs += [*plant.der.values(), *plant.next.values(), *(e for _, e in plant.drives)]
        counter.expressions(exprs, plant.name, plant.span)
    for module in program.modules.values():
        predicates = (module.safe, module.ttf, module.safer)
        counter.expressions([e for e in predicates if e], module.name, module.span)


class _Counter:
    """Counts rounds; every function once, callees before callers."""

    def __init__(self, diagnostics: Diagnostics) -> None:
        self.diagnostics = diagnostics
        self.rounds: dict[typed.FunSymbol, int] = {}
        self._said = False

    def function(self, root: typed.FunSymbol) -> None:
        path = [(root, iter(_callees(root)))]
        while path:
            fun, callees = path[-1]
            callee = next((c for c in callees if c not in self.rounds), None)
            if callee is not None:
                path.append((callee, iter(_callees(callee))))
                continue
            path.pop()
            self.rounds[fun] = self.body(fun.body or (), fun.name, fun.span)

    def body(self, statements: tuple[typed.Stmt, ...], name: str, span: Span) -> int:
        """The rounds of a body; reported, and then no longer counted, where they are absurd."""
        for call in calls_in(*statements):
            if call.fun not in self.rounds:
                self.function(call.fun)
        self._said = False  # one report a body: the loops around it are absurd too
        count = self._block(statements)
        return self._bounded(count, f"`{name}`", span)

    def expressions(self, exprs: Iterable[typed.Expr], name: str, span: Span) -> None:
        statements = tuple(typed.Return(e.span, e) for e in exprs)
        self.body(statements, name, span)

    def _bounded(self, count: int, what: str, span: Span) -> int:
        if count <= MAX_ROUNDS or self._said:
            return min(count, MAX_ROUNDS)
        self._said = True
        self.diagnostics.error(
            "T007",
            f"{what} may take {_shown(count)} rounds of loops",
            span,
            f"at most {_shown(MAX_ROUNDS)} are possible",
            notes=("a step has to end long before its period does",),
        )
        return MAX_ROUNDS

    def _block(self, statements: Iterable[typed.Stmt]) -> int:
        return sum(self._statement(s) for s in statements)

    def _statement(self, s: typed.Stmt) -> int:
        if isinstance(s, typed.If):
            conditions = sum(self._calls(c) for c, _ in s.arms)
            bodies = [self._block(body) for _, body in s.arms]
            return conditions + max([*bodies, self._block(s.otherwise)])
        if isinstance(s, typed.ForRange):
            times = max(0, s.high - s.low)
            return self._bounded(times * (1 + self._block(s.body)), "this loop", s.span)
        if isinstance(s, typed.ForEach):
            t = s.sequence.type
            times = t.size if isinstance(t, ArrayType) else 0
            times = t.capacity if isinstance(t, ListType) else times
            own = self._calls(s.sequence)
            return own + self._bounded(times * (1 + self._block(s.body)), "this loop", s.span)
        return self._calls(s)

    def _calls(self, root: object) -> int:
        return sum(self.rounds.get(call.fun, 0) for call in calls_in(root))


def _callees(fun: typed.FunSymbol) -> list[typed.FunSymbol]:
    return [call.fun for call in calls_in(*(fun.body or ()))]


def _shown(count: int) -> str:
    return f"{count:,}".replace(",", " ") if count < 10**12 else f"about 10^{len(str(count)) - 1}"

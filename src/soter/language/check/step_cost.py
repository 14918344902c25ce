"""What a step may cost at worst: operations and bytes; absurd numbers are T007.

Purpose: every loop has a bound and nothing is recursive, yet loops in loops, or calls of calls of
calls, may still never end in practice; upper bounds for every step, calls included.
Non-goals: execution times and the machine's stack: they need a machine and its compiler.

An operation is a statement, a round of a loop, a call, an operator, a built-in function, an index
or a choice; what handles a value of n numbers counts n. Of branches the dearest counts, of `&&` and
`||` both sides. The bytes are those of named values where the calls nest deepest: locals, what is
published, the sequences of loops, arguments and results, eight a number. An argument counts eight
numbers at most: what has more is passed by address (decision 109). Code of externs is counted in
neither.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics
from soter.language.model import typed
from soter.language.model.tree_walk import calls_in, children, nodes
from soter.language.model.types import ArrayType, ListType, leaf_count
from soter.language.model.values import is_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from soter.diagnostics.diagnostic import Span

MAX_OPERATIONS = 100_000_000
"""Operations of a step: a tenth of a second of the fastest possible machine."""
BYTES = 8
"""Of a number in memory, at most."""
ARGUMENT = 8
"""Numbers of an argument: more are passed by address."""
FREE = (
    typed.Literal,
    typed.ParamRead,
    typed.VarRead,
    typed.TopicRead,
    typed.TruthRead,
    typed.TypedField,
    typed.TypedLength,
    typed.Place,
)
"""Expressions that only say where a value is."""
MOVING = (
    typed.TypedDeclare,
    typed.TypedAssign,
    typed.TypedPush,
    typed.TypedPublish,
    typed.TypedReturn,
)


def count_costs(program: typed.TypedProgram, diagnostics: Diagnostics) -> None:
    """Fill in `program.costs`; T007 for what may take more than `MAX_OPERATIONS`."""
    counter = _Counter(diagnostics)
    for fun in program.funs.values():
        counter.function(fun)
    for node in program.nodes.values():
        cost = counter.node(node)
        if not node.extern:
            program.costs[node] = cost
    for plant in program.plants.values():
        counter.plant(plant)
    for module in program.modules.values():
        cost = counter.module(module)
        if module.ttf is not None and module.safer is not None:
            program.costs[module] = cost
    properties = [p for s in program.systems.values() for p in s.properties]
    properties += [p for t in program.tests.values() for p in t.properties]
    for p in properties:
        asked = [e for e in (p.premise, p.condition) if e is not None]
        counter.expressions(asked, "this property", p.span)


def cost_of(fun: typed.FunSymbol) -> typed.Cost:
    """The cost of a call of a function that was checked."""
    counter = _Counter(Diagnostics())
    counter.function(fun)
    return counter.costs[fun]


class _Counter:
    """Counts; every function once, callees before callers."""

    def __init__(self, diagnostics: Diagnostics) -> None:
        self.diagnostics = diagnostics
        self.costs: dict[typed.FunSymbol, typed.Cost] = {}
        self._absurd: set[typed.FunSymbol] = set()
        self._said = False

    def node(self, node: typed.NodeSymbol) -> typed.Cost:
        """The cost of a step of a node, and of its takeover."""
        kept = [v.type for v in node.locals] + [t for _, t in node.answers]
        size = BYTES * sum(leaf_count(t) for t in kept)
        body = (*(node.takeover or ()), *node.step)
        cost = self.body(body, f"`{node.name}`", node.span, size)
        self.expressions((*node.assumes, *node.guarantees), f"`{node.name}`", node.span)
        return cost

    def plant(self, plant: typed.PlantSymbol) -> None:
        """Hold a step of a plant against the limit."""
        exprs = [e for _, e in plant.lets]
        exprs += [*plant.der.values(), *plant.next.values(), *(e for _, e in plant.drives)]
        self.expressions(exprs, f"`{plant.name}`", plant.span)

    def module(self, module: typed.ModuleSymbol) -> typed.Cost:
        """The cost of a decision; what only a proof evaluates is held against the limit, too."""
        decided = [e for e in (module.ttf, module.safer) if e is not None]
        others = [e for e in module.expressions if e not in decided]
        blocks = (module.verify, *(v.block for v in module.verify.views))
        links = [link for block in blocks for link in block.abstracts]
        others += [link.value for link in links if link.value is not None]
        cost = self.expressions(decided, f"`{module.name}`", module.span)
        self.expressions(others, f"`{module.name}`", module.span)
        return cost

    def function(self, root: typed.FunSymbol) -> None:
        """Count a function and, before it, what it calls, however deep that nests."""
        path = [(root, iter(_callees(root)))]
        while path:
            fun, callees = path[-1]
            callee = next((c for c in callees if c not in self.costs), None)
            if callee is not None:
                path.append((callee, iter(_callees(callee))))
                continue
            path.pop()
            size = BYTES * (leaf_count(fun.result) + _passed(fun.parameters))
            cost = self.body(fun.body or (), f"`{fun.name}`", fun.span, size)
            self.costs[fun] = cost if fun.body is not None else typed.Cost(0, size, (fun.name,))
            if self._said:
                self._absurd.add(fun)

    def body(self, body: Sequence[typed.TypedStmt], what: str, span: Span, size: int) -> typed.Cost:
        """The cost of a body, whose other values have `size` bytes.

        Reported where it is absurd, once for a chain of calls and of loops.
        """
        called = dict.fromkeys(_callees_in(body))
        for fun in called:
            if fun not in self.costs:
                self.function(fun)
        self._said = any(f in self._absurd for f in called)
        operations = self._bounded(self._block(body), what, span)
        below = [self.costs[f] for f in called]
        size += BYTES * sum(_declared(s) for s in nodes(body))
        externs = dict.fromkeys(name for c in below for name in c.externs)
        return typed.Cost(
            operations, size + max((c.bytes for c in below), default=0), tuple(externs)
        )

    def expressions(self, exprs: Iterable[typed.TypedExpr], what: str, span: Span) -> typed.Cost:
        """The cost of evaluating all of them."""
        return self.body([typed.TypedReturn(e.span, e) for e in exprs], what, span, 0)

    def _bounded(self, count: int, what: str, span: Span) -> int:
        if count <= MAX_OPERATIONS or self._said:
            return min(count, MAX_OPERATIONS)
        self._said = True
        self.diagnostics.error(
            "T007",
            f"{what} may take {_shown(count)} operations",
            span,
            f"at most {_shown(MAX_OPERATIONS)} are possible",
            notes=("a step has to end long before its period does",),
        )
        return MAX_OPERATIONS

    def _block(self, statements: Iterable[typed.TypedStmt]) -> int:
        return sum(self._statement(s) for s in statements)

    def _statement(self, s: typed.TypedStmt) -> int:
        if isinstance(s, typed.TypedIf):
            conditions = sum(self._expr(c) for c, _ in s.arms)
            bodies = [self._block(body) for _, body in s.arms]
            return 1 + conditions + max([*bodies, self._block(s.otherwise)])
        if isinstance(s, typed.ForRange):
            return 1 + self._loop(max(0, s.high - s.low), 1, s)
        if isinstance(s, typed.ForEach):
            t = s.sequence.type
            assert isinstance(t, (ArrayType, ListType))
            times = t.size if isinstance(t, ArrayType) else t.capacity
            return 1 + self._expr(s.sequence) + self._loop(times, leaf_count(t.element), s)
        moved = leaf_count(s.value.type) if isinstance(s, MOVING) else 1
        return moved + sum(self._expr(e) for e in children(s))

    def _loop(self, times: int, start: int, s: typed.ForRange | typed.ForEach) -> int:
        return self._bounded(times * (start + self._block(s.body)), "this loop", s.span)

    def _expr(self, e: object) -> int:
        """Operations of an expression, or of the path of a place."""
        if isinstance(e, typed.Conditional):
            sides = (self._expr(e.then), self._expr(e.otherwise))
            return 1 + self._expr(e.condition) + max(sides)
        parts = sum(self._expr(p) for p in children(e))
        if isinstance(e, typed.TypedCall):
            return parts + 1 + _passed(e.fun.parameters) + self.costs[e.fun].operations
        if isinstance(e, typed.Builtin):
            return parts + max(leaf_count(a.type) for a in e.arguments)
        if isinstance(e, (typed.TypedUnary, typed.Vector, typed.Aggregate)):
            return parts + leaf_count(e.type)
        return parts + (0 if isinstance(e, FREE) else 1)


def _callees_in(body: Iterable[typed.TypedStmt]) -> list[typed.FunSymbol]:
    return [call.fun for call in calls_in(*body)]


def _callees(fun: typed.FunSymbol) -> list[typed.FunSymbol]:
    return _callees_in(fun.body or ())


def _passed(parameters: Iterable[typed.Variable]) -> int:
    """The numbers that a call hands over."""
    return sum(min(leaf_count(p.type), ARGUMENT) for p in parameters)


def _declared(s: object) -> int:
    """The numbers that a statement makes room for."""
    if isinstance(s, (typed.TypedDeclare, typed.ForRange)):
        return leaf_count(s.variable.type)
    if isinstance(s, typed.ForEach):
        copied = 0 if is_table(s.sequence.type) else leaf_count(s.sequence.type)
        return leaf_count(s.variable.type) + copied
    return 0


def _shown(count: int) -> str:
    return f"{count:,}".replace(",", " ") if count < 10**12 else f"about 10^{len(str(count)) - 1}"

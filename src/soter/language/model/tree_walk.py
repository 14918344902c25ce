"""Walks over checked trees: what an expression or a body contains, and what a step may cost.

Purpose: defines the parts of a node once, and answers the questions that later passes have.
`conjuncts` splits `a && b`, also in a function that only returns it; `premise_of` gives the premise
of an implication; `are_same_expression` recognizes that both sides of `x - 1 < x - 1` have one
value. Every loop has a bound and nothing is recursive, yet nested loops or calls may never end in
practice. So `count_costs` computes upper bounds for every step, calls included, in operations and
bytes; too large ones are T007.
Non-goals: meaning; any other rewriting; equal expressions that are written differently; execution
times and the machine's stack, which need a machine and its compiler.

An operation is a statement, a round of a loop, a call, an operator, a built-in function, an index
or a choice; one that handles a value of n numbers counts n. Of branches the most costly one counts,
of `&&` and `||` both sides. The bytes are those of named values at the deepest nesting of calls:
locals, publications, sequences of loops, arguments and results, eight for each number. An argument
counts eight numbers at most, as larger ones are passed by address (decision 109). Code of externs
is not counted.
"""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache, reduce
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostics
from soter.language.model import typed
from soter.language.model.types import BOOL, ArrayType, ListType, leaf_count
from soter.language.model.values import is_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from soter.diagnostics.diagnostic import Span


_SKIPPED = {"type", "span", "fun", "param", "topic", "module", "variable"}
PARTS_MAX = 16
"""A predicate with more `conjuncts` than this counts as a single one."""


@cache
def _names_of_part_fields(kind: type) -> tuple[str, ...]:
    """Gives the names of those fields of a class that may hold nodes of a syntax tree."""
    if issubclass(kind, typed.Literal):
        return ()  # a literal's value may be large, and is no code
    return tuple(n for n in getattr(kind, "__dataclass_fields__", {}) if n not in _SKIPPED)


def children(node: object) -> list[object]:
    """Gives the typed nodes directly below an expression, statement or place, in written order."""
    sub_nodes: list[object] = []
    kind: Any = type(node)
    for name in _names_of_part_fields(kind):
        part = getattr(node, name)
        if isinstance(part, (typed.TypedExpr, typed.TypedStmt, typed.Place)):
            sub_nodes.append(part)
        elif isinstance(part, tuple):
            stack = [*reversed(part)]
            while stack:
                v = stack.pop()
                if isinstance(v, (typed.TypedExpr, typed.TypedStmt, typed.Place)):
                    sub_nodes.append(v)
                elif isinstance(v, tuple):
                    stack.extend(reversed(v))
    return sub_nodes


def nodes(roots: Iterable[object]) -> Iterator[object]:
    """Yields every typed node below `roots`, each before its parts, in written order."""
    todo = list(roots)
    todo.reverse()
    while todo:
        node = todo.pop()
        yield node
        todo.extend(reversed(children(node)))


def rewritten(node: Any, instead: Callable[[Any], Any]) -> Any:  # noqa: ANN401 - any part of a tree
    """Gives the code with expressions replaced by `instead`; expressions have no side effects.

    `instead` gets each expression after its parts, and gives this expression or another.
    """
    if isinstance(node, tuple):
        parts_ = tuple(rewritten(x, instead) for x in node)
        return node if all(a is b for a, b in zip(node, parts_, strict=True)) else parts_
    if not isinstance(node, (typed.TypedExpr, typed.TypedStmt, typed.Place)):
        return node
    names = [f.name for f in fields(node) if f.name not in ("type", "span", "fun")]
    parts = {name: rewritten(getattr(node, name), instead) for name in names}
    same = all(parts[name] is getattr(node, name) for name in names)
    new_node = node if same else replace(node, **parts)
    return instead(new_node) if isinstance(node, typed.TypedExpr) else new_node


def calls_in(*roots: object) -> list[typed.TypedCall]:
    """Gives all calls of declared functions below `roots`."""
    return [n for n in nodes(roots) if isinstance(n, typed.TypedCall)]


def topic_reads(*roots: object) -> dict[typed.TopicSymbol, typed.TypedExpr]:
    """Maps each topic read below `roots` to the first expression that reads it."""
    read_by_topic: dict[typed.TopicSymbol, typed.TypedExpr] = {}
    for node in nodes(roots):
        if isinstance(node, (typed.TopicRead, typed.AgeRead)):
            read_by_topic.setdefault(node.topic, node)
    return read_by_topic


def mode_reads(*roots: object) -> dict[typed.ModuleSymbol | str, typed.TypedExpr]:
    """Maps each module to the first expression below `roots` that reads its mode or margin."""
    read_by_module: dict[typed.ModuleSymbol | str, typed.TypedExpr] = {}
    for node in nodes(roots):
        if isinstance(node, (typed.ModeRead, typed.MarginRead)):
            read_by_module.setdefault(node.module, node)
    return read_by_module


def margin_reads(*roots: object) -> set[typed.ModuleSymbol | str]:
    """Gives the modules whose margin is read below `roots`."""
    return {n.module for n in nodes(roots) if isinstance(n, typed.MarginRead)}


def topics_mentioned(symbol: object) -> list[typed.TopicSymbol]:
    """Gives the topics that a plant, a node or a module reads or writes, some more than once."""
    if isinstance(symbol, typed.NodeSymbol):
        return [*(s.topic for s in symbol.subscribes), *symbol.publishes]
    if isinstance(symbol, typed.PlantSymbol):
        return [*symbol.reads, *(t for t, _ in symbol.drives)]
    if isinstance(symbol, typed.ModuleSymbol):
        nodes_ = [*topics_mentioned(symbol.ac), *topics_mentioned(symbol.sc)]
        reads = [*symbol.topics_read, *topic_reads(*symbol.expressions), *symbol.moved_topics]
        return [*nodes_, *reads, *symbol.acknowledgements]
    return []


def topics_of_instances(system: typed.SystemSymbol) -> list[typed.TopicSymbol]:
    """Gives the topics that a system's instances read or write, with the names that wires set."""
    topics: dict[typed.TopicSymbol, None] = {}
    for instance in system.instances:
        if isinstance(instance.what, typed.SystemSymbol):
            for outer in instance.renames.values():
                topics.setdefault(outer)
        for topic in topics_mentioned(instance.what):
            topics.setdefault(instance.renames.get(topic, topic))
    return list(topics)


def chooses(*roots: object) -> bool:
    """Whether code below `roots` has a `choose`."""
    return any(isinstance(n, typed.TypedChoose) for n in nodes(roots))


def plant_code(plant: typed.PlantSymbol) -> list[typed.TypedExpr]:
    """Gives every expression that a step of a plant evaluates."""
    lets, drives = [e for _, e in plant.lets], [e for _, e in plant.drives]
    return [*lets, *plant.next.values(), *plant.der.values(), *drives]


def lets_that_choose(plant: typed.PlantSymbol) -> tuple[typed.Variable, ...]:
    """Gives the variables of a plant's lets that contain a `choose`; a step evaluates them once."""
    return tuple([v for v, e in plant.lets if chooses(e)])


def lets_run_first(plant: typed.PlantSymbol) -> tuple[tuple[typed.Variable, typed.TypedExpr], ...]:
    """Gives the lets that a step evaluates first: all up to the last one with a `choose`."""
    last = max((i for i, (_, e) in enumerate(plant.lets) if chooses(e)), default=-1)
    return plant.lets[: last + 1]


MAX_OPERATIONS = 400_000_000
"""Most operations of a step: some tenths of a second on the fastest possible machine."""
BYTES = 8
"""Most bytes of a number in memory."""
ARGUMENT = 8
"""Most numbers of an argument that is passed by value; larger ones are passed by address."""
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
"""Expressions that cost nothing, as they only name a value."""
MOVING = (
    typed.TypedDeclare,
    typed.TypedAssign,
    typed.TypedPush,
    typed.TypedPublish,
    typed.TypedReturn,
)


def count_costs(program: typed.TypedProgram, diagnostics: Diagnostics) -> None:
    """Fills in `program.costs`; reports T007 for code that may take over `MAX_OPERATIONS`."""
    counter = _Counter(diagnostics)
    for fun in program.funs.values():
        counter.count_function(fun)
    for node in program.nodes.values():
        cost = counter.cost_of_node(node)
        if not node.extern:
            program.costs[node] = cost
    for plant in program.plants.values():
        counter.compare_cost_of_plant(plant)
    for module in program.modules.values():
        cost = counter.cost_of_module(module)
        if module.ttf is not None and module.safer is not None:
            program.costs[module] = cost
    properties = [p for s in program.systems.values() for p in s.properties]
    properties += [p for t in program.tests.values() for p in t.properties]
    for p in properties:
        asked = [e for e in (p.premise, p.condition) if e is not None]
        counter.cost_of_all(asked, "this property", p.span)


def cost_of(fun: typed.FunSymbol) -> typed.Cost:
    """Gives the cost of a call of a checked function."""
    counter = _Counter(Diagnostics())
    counter.count_function(fun)
    return counter.costs[fun]


class _Counter:
    """Counts the cost of every function once: called functions before their callers."""

    def __init__(self, diagnostics: Diagnostics) -> None:
        self.diagnostics = diagnostics
        self.costs: dict[typed.FunSymbol, typed.Cost] = {}
        self._over_limit: set[typed.FunSymbol] = set()
        self._is_reported = False

    def cost_of_node(self, node: typed.NodeSymbol) -> typed.Cost:
        """Gives the cost of a node's takeover and step together."""
        kept = [v.type for v in node.locals] + [t for _, t in node.answers]
        size = BYTES * sum(leaf_count(t) for t in kept)
        body = (*(node.takeover or ()), *node.step)
        cost = self.cost_of_body(body, f"`{node.name}`", node.span, size)
        self.cost_of_all((*node.assumes, *node.guarantees), f"`{node.name}`", node.span)
        return cost

    def compare_cost_of_plant(self, plant: typed.PlantSymbol) -> None:
        """Reports T007 if the cost of a plant's step exceeds the limit."""
        self.cost_of_all(plant_code(plant), f"`{plant.name}`", plant.span)

    def cost_of_module(self, module: typed.ModuleSymbol) -> typed.Cost:
        """Gives the cost of a decision; also checks the cost of code that only proofs use."""
        decided = [e for e in (module.ttf, module.safer) if e is not None]
        others = [e for e in module.expressions if e not in decided]
        blocks = (module.verify, *(v.block for v in module.verify.views))
        links = [link for block in blocks for link in block.abstracts]
        others += [link.value for link in links if link.value is not None]
        cost = self.cost_of_all(decided, f"`{module.name}`", module.span)
        self.cost_of_all(others, f"`{module.name}`", module.span)
        return cost

    def count_function(self, root: typed.FunSymbol) -> None:
        """Counts the cost of a function, after that of all functions that it calls."""
        path = [(root, iter(_callees(root)))]
        while path:
            fun, callees = path[-1]
            callee = next((c for c in callees if c not in self.costs), None)
            if callee is not None:
                path.append((callee, iter(_callees(callee))))
                continue
            path.pop()
            size = BYTES * (leaf_count(fun.result) + _copied_number_count(fun.parameters))
            cost = self.cost_of_body(fun.body or (), f"`{fun.name}`", fun.span, size)
            self.costs[fun] = cost if fun.body is not None else typed.Cost(0, size, (fun.name,))
            if self._is_reported:
                self._over_limit.add(fun)

    def cost_of_body(
        self, body: Sequence[typed.TypedStmt], owner: str, span: Span, size: int
    ) -> typed.Cost:
        """Gives the cost of a body; `size` is the bytes of values that exist besides its variables.

        If a chain of calls and loops exceeds the limit, this is reported once.
        """
        called = dict.fromkeys(_callees_in(body))
        for fun in called:
            if fun not in self.costs:
                self.count_function(fun)
        self._is_reported = any(f in self._over_limit for f in called)
        operations = self._count_within_limit(self._block_cost(body), owner, span)
        below = [self.costs[f] for f in called]
        size += BYTES * sum(_declared_number_count(s) for s in nodes(body))
        externs = dict.fromkeys(name for c in below for name in c.externs)
        return typed.Cost(
            operations, size + max((c.bytes for c in below), default=0), tuple(externs)
        )

    def cost_of_all(self, exprs: Iterable[typed.TypedExpr], owner: str, span: Span) -> typed.Cost:
        """Gives the cost of evaluating all of the expressions."""
        return self.cost_of_body([typed.TypedReturn(e.span, e) for e in exprs], owner, span, 0)

    def _count_within_limit(self, count: int, owner: str, span: Span) -> int:
        if count <= MAX_OPERATIONS or self._is_reported:
            return min(count, MAX_OPERATIONS)
        self._is_reported = True
        self.diagnostics.error(
            "T007",
            f"{owner} may take {_count_text(count)} operations",
            span,
            f"at most {_count_text(MAX_OPERATIONS)} are possible",
            notes=("a step has to end long before its period does",),
        )
        return MAX_OPERATIONS

    def _block_cost(self, statements: Iterable[typed.TypedStmt]) -> int:
        return sum(self._statement_cost(s) for s in statements)

    def _statement_cost(self, s: typed.TypedStmt) -> int:
        if isinstance(s, typed.TypedIf):
            conditions = sum(self._cost(c) for c, _ in s.arms)
            bodies = [self._block_cost(body) for _, body in s.arms]
            return 1 + conditions + max([*bodies, self._block_cost(s.otherwise)])
        if isinstance(s, typed.ForRange):
            return 1 + self._loop_cost(max(0, s.high - s.low), 1, s)
        if isinstance(s, typed.ForEach):
            t = s.sequence.type
            assert isinstance(t, (ArrayType, ListType))
            times = t.size if isinstance(t, ArrayType) else t.capacity
            return 1 + self._cost(s.sequence) + self._loop_cost(times, leaf_count(t.element), s)
        moved = leaf_count(s.value.type) if isinstance(s, MOVING) else 1
        return moved + sum(self._cost(e) for e in children(s))

    def _loop_cost(self, times: int, start: int, s: typed.ForRange | typed.ForEach) -> int:
        return self._count_within_limit(
            times * (start + self._block_cost(s.body)), "this loop", s.span
        )

    def _cost(self, e: object) -> int:
        """Gives the number of operations of an expression, or of the path of a place."""
        if isinstance(e, typed.Conditional):
            sides = (self._cost(e.then), self._cost(e.otherwise))
            return 1 + self._cost(e.condition) + max(sides)
        parts = sum(self._cost(p) for p in children(e))
        if isinstance(e, typed.TypedCall):
            return parts + 1 + _copied_number_count(e.fun.parameters) + self.costs[e.fun].operations
        if isinstance(e, typed.Builtin):
            return parts + max(leaf_count(a.type) for a in e.arguments)
        if isinstance(e, (typed.TypedUnary, typed.Vector, typed.Aggregate)):
            return parts + leaf_count(e.type)
        return parts + (0 if isinstance(e, FREE) else 1)


def _callees_in(body: Iterable[typed.TypedStmt]) -> list[typed.FunSymbol]:
    return [call.fun for call in calls_in(*body)]


def _callees(fun: typed.FunSymbol) -> list[typed.FunSymbol]:
    return _callees_in(fun.body or ())


def _copied_number_count(parameters: Iterable[typed.Variable]) -> int:
    return sum(min(leaf_count(p.type), ARGUMENT) for p in parameters)


def _declared_number_count(s: object) -> int:
    if isinstance(s, (typed.TypedDeclare, typed.ForRange)):
        return leaf_count(s.variable.type)
    if isinstance(s, typed.ForEach):
        copied = 0 if is_table(s.sequence.type) else leaf_count(s.sequence.type)
        return leaf_count(s.variable.type) + copied
    return 0


def _count_text(count: int) -> str:
    return f"{count:,}".replace(",", " ") if count < 10**12 else f"about 10^{len(str(count)) - 1}"


def joined(op: str, parts: Sequence[typed.TypedExpr], span: Span) -> typed.TypedExpr:
    """Gives one expression that joins the parts by `op`; of no parts true for `&&`, else false."""
    if not parts:
        return typed.Literal(BOOL, span, op == "&&")
    return reduce(lambda a, b: typed.TypedBinary(BOOL, span, op, a, b), parts)


def conjuncts(predicate: typed.TypedExpr) -> list[typed.TypedExpr]:
    """Gives the parts of a predicate that `&&` joins; itself alone if over `PARTS_MAX` parts."""
    parts = _all_conjuncts(predicate)
    return parts if len(parts) <= PARTS_MAX else [predicate]


def disjuncts(predicate: typed.TypedExpr) -> list[typed.TypedExpr]:
    """Gives the parts of a predicate that `||` joins; those of `!(a && b)` are `!a` and `!b`."""
    inner = returned(predicate) if isinstance(predicate, typed.TypedCall) else None
    if inner is not None and len(parts := disjuncts(inner)) > 1:
        return parts
    if isinstance(predicate, typed.TypedBinary) and predicate.op == "||":
        return [*disjuncts(predicate.left), *disjuncts(predicate.right)]
    if isinstance(predicate, typed.TypedUnary) and predicate.op == "!":
        return [replace(predicate, operand=part) for part in _all_conjuncts(predicate.operand)]
    return [predicate]


def premise_of(predicate: typed.TypedExpr) -> typed.TypedExpr | None:
    """Gives p of an implication `!p || q`, `q || !p` or `p ? q : true`; None for others."""
    e = returned(predicate) if isinstance(predicate, typed.TypedCall) else predicate
    if isinstance(e, typed.Conditional) and isinstance(e.otherwise, typed.Literal):
        return e.condition if e.otherwise.value is True else None
    if not isinstance(e, typed.TypedBinary) or e.op != "||":
        return None
    negated = [
        x.operand for x in (e.left, e.right) if isinstance(x, typed.TypedUnary) and x.op == "!"
    ]
    return negated[0] if len(negated) == 1 else None


def _all_conjuncts(e: typed.TypedExpr) -> list[typed.TypedExpr]:
    if isinstance(e, typed.TypedBinary) and e.op == "&&":
        return [*_all_conjuncts(e.left), *_all_conjuncts(e.right)]
    if isinstance(e, typed.TypedCall):
        inner = returned(e)
        if inner is not None and len(parts := _all_conjuncts(inner)) > 1:
            return parts
    return [e]


def returned(call: typed.TypedCall) -> typed.TypedExpr | None:
    """Gives a call's `return` expression, arguments put in; None if the function has more code."""
    body = call.fun.body
    if body is None or len(body) != 1 or not isinstance(body[0], typed.TypedReturn):
        return None
    argument_of = dict(zip(call.fun.parameters, call.arguments, strict=True))

    def argument_or_itself(e: typed.TypedExpr) -> typed.TypedExpr:
        return argument_of.get(e.variable, e) if isinstance(e, typed.VarRead) else e

    expansion: typed.TypedExpr = rewritten(body[0].value, argument_or_itself)
    return expansion


def are_same_expression(a: typed.TypedExpr, b: typed.TypedExpr) -> bool:
    """Whether two expressions are written alike, and so have the same value at one moment."""
    return _comparable_form(a) == _comparable_form(b)


def _comparable_form(e: Any) -> object:  # noqa: ANN401 - any part of an expression
    """Gives an expression's structure without its place in the source, for comparisons.

    The structure of a choice, or of a call of an extern, equals no other structure.
    """
    if isinstance(e, typed.TypedChoose) or (isinstance(e, typed.TypedCall) and _may_differ(e.fun)):
        return object()
    form: list[object] = [type(e).__name__]
    for name in ("op", "name", "index", "instance"):
        value = getattr(e, name, None)
        form += [name, value] if isinstance(value, (str, int)) else []
    for name in ("variable", "topic", "param", "module", "fun"):
        value = getattr(e, name, None)
        form += [name, value if isinstance(value, str) else id(value)]
    if isinstance(e, typed.Literal):
        form.append(repr(e.value))
    return (*form, *[_comparable_form(child) for child in children(e)])


def _may_differ(fun: typed.FunSymbol) -> bool:
    """Whether two calls with equal arguments may differ, by a `choose` or an extern's memory."""
    todo, seen = [fun], {fun}
    while todo:
        body = todo.pop().body
        if body is None:
            return True
        for n in nodes(body):
            if isinstance(n, typed.TypedChoose):
                return True
            if isinstance(n, typed.TypedCall) and n.fun not in seen and not n.fun.prelude:
                seen.add(n.fun)
                todo.append(n.fun)
    return False

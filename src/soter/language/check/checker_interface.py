"""What the checkers of one program ask of each other: `Shared`, with the graph of declarations.

Purpose: `Shared` has the few operations that checking a declaration may need of the rest, and what
is known of the whole program; `checker.py` fills them in. `Context` says which locals, topics and
specials are in reach, so that the checker of expressions has one rule for every place. Declarations
are put into an order in which what is needed comes first, so that no chain nests deeper than Python
allows; the graph of calls grows while bodies are checked, and a cycle in it is T006. Declarations
that nothing uses are W001 and W004, said when every use is known.
Non-goals: how any of the checkers works; names of declarations (`scope.py`), cycles of them
(`checker.py`); costs of steps (`language/model/tree_walk.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol

from soter.diagnostics.diagnostic import insert, remove
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Diagnostics, Help, Span
    from soter.language.check.scope import Entry, FileScope, Names
    from soter.language.model import typed
    from soter.language.model.typed import (
        FunSymbol,
        InstanceSymbol,
        NodeSymbol,
        ParamSymbol,
        TopicSymbol,
        Variable,
    )
    from soter.language.model.types import Type, Value

    Circle = tuple[list[Entry], Span]
    CheckBody = Callable[[FunSymbol, tree.FunDecl, FileScope], bool]
    Because = tuple[Span, str]

    # entries that need each other in turn, and where the last needs the first

SHORT = 50
"""A program of so few declarations cannot have a long chain."""

CHAINING = {"type", "constant", "parameter", "function", "system"}
"""Declarations that can need one of their own kind."""


def in_order_of_need(entries: list[Entry], names: Names) -> tuple[list[Entry], list[Circle]]:
    """The entries, each after the ones it mentions, and the circles that stand in the way.

    Functions may mention names that are locals of theirs, so circles through them are left to
    the checker.
    """
    if len(entries) <= SHORT:
        return entries, []
    ordered: list[Entry] = []
    circles: list[Circle] = []
    seen: set[int] = set()
    for root in entries:
        if id(root) in seen:
            continue
        seen.add(id(root))
        open_ = {id(root)}
        path = [(root, _needs(root, names))]
        while path:
            entry, needs = path[-1]
            need = next(needs, None)
            if need is None:
                ordered.append(entry)
                open_.discard(id(entry))
                path.pop()
                continue
            needed, span = need
            if id(needed) not in seen:
                seen.add(id(needed))
                open_.add(id(needed))
                path.append((needed, _needs(needed, names)))
            elif id(needed) in open_:
                stack = [e for e, _ in path]
                circle = stack[next(i for i, e in enumerate(stack) if e is needed) :]
                if all(e.kind != "function" for e in circle):
                    circles.append((circle, span))
    return ordered, circles


def _needs(entry: Entry, names: Names) -> Iterator[tuple[Entry, Span]]:
    """Entries that a declaration mentions and that could lead to a long chain, and where."""
    if entry.kind not in CHAINING:
        return
    for qualifier, name, span in mentioned(entry.decl):
        scope: FileScope | None = entry.scope
        if qualifier is not None:
            scope = entry.scope.imports.get(qualifier)
        dependency = scope.entries.get(name) if scope is not None else None
        if dependency is None and qualifier is None:
            dependency = names.prelude.get(name)
        if (
            dependency is not None
            and dependency.kind in CHAINING
            and not dependency.scope.loaded.prelude
        ):
            yield dependency, span


def mentioned(root: object) -> Iterator[tuple[str | None, str, Span]]:
    """`(qualifier, name, place)` of all names below a piece of syntax that may be declared."""
    todo = [root]
    while todo:
        node = todo.pop()
        if isinstance(node, tuple):
            todo.extend(reversed(node))
        elif isinstance(node, tree.Ref):
            yield (node.qualifier.text if node.qualifier else None), node.name.text, node.span
        elif isinstance(node, tree.NameExpr):
            yield None, node.name.text, node.span
        elif hasattr(node, "__dataclass_fields__"):
            if isinstance(node, tree.FieldExpr) and isinstance(node.target, tree.NameExpr):
                yield node.target.name.text, node.field.text, node.span
            fields = node.__dataclass_fields__
            todo.extend(getattr(node, f) for f in reversed(fields) if not f.endswith("span"))

    # checks the body of a function; whether it is without errors


MAX_CALLS_SHOWN = 4


class CallGraph:
    """Functions, the calls in them, and their bodies, which are checked once and on demand."""

    def __init__(self, diagnostics: Diagnostics, check_body: CheckBody) -> None:
        self.diagnostics = diagnostics
        self._check_body = check_body
        self.current: FunSymbol | None = None
        """The function whose body is being checked."""
        self._calls: dict[FunSymbol, list[tuple[FunSymbol, Span]]] = {}
        self._params: dict[FunSymbol, tuple[ParamSymbol, Span]] = {}
        self._unchecked: dict[FunSymbol, tuple[tree.FunDecl, FileScope]] = {}
        self._lazy: dict[FunSymbol, tuple[tree.FunDecl, FileScope]] = {}
        self._broken: set[FunSymbol] = set()
        self._walked: set[FunSymbol] = set()
        self._recursive: set[FunSymbol] = set()

    # ------------------------------------------------------------ bodies

    def add(self, fun: FunSymbol, decl: tree.FunDecl, scope: FileScope) -> None:
        """Remember a body for later; bodies of the prelude are only checked when called."""
        (self._lazy if scope.loaded.prelude else self._unchecked)[fun] = (decl, scope)

    def mark_invalid(self, fun: FunSymbol) -> None:
        """A function whose declaration has an error: constants cannot be made with it."""
        self._broken.add(fun)

    def call(self, fun: FunSymbol, span: Span) -> None:
        """A call was met; the callee's body is needed too."""
        if self.current is not None:
            self._calls.setdefault(self.current, []).append((fun, span))
        lazy = self._lazy.pop(fun, None)
        if lazy is not None:
            self._unchecked[fun] = lazy

    def param(self, param: ParamSymbol, span: Span) -> None:
        """A parameter of the program was read."""
        if self.current is not None:
            self._params.setdefault(self.current, (param, span))

    def check_body(self, fun: FunSymbol) -> None:
        """Check a function's body now if that was not done yet."""
        waiting = self._unchecked.pop(fun, None)
        if waiting is None:
            return
        outer, self.current = self.current, fun
        if not self._check_body(fun, *waiting):
            self._broken.add(fun)
        self.current = outer

    def check_bodies(self) -> bool:
        """Check every body still waiting; whether there was one."""
        some = bool(self._unchecked)
        while self._unchecked:
            self.check_body(next(iter(self._unchecked)))
        return some

    # ------------------------------------------------------------ questions

    def _below(self, fun: FunSymbol) -> Iterator[FunSymbol]:
        """The function and everything it calls, bodies checked."""
        seen = {fun}
        todo = [fun]
        while todo:
            f = todo.pop()
            self.check_body(f)
            yield f
            for callee, _ in self._calls.get(f, ()):
                if callee not in seen:
                    seen.add(callee)
                    todo.append(callee)

    def complete(self, fun: FunSymbol) -> bool:
        """Whether the function and all it calls are free of errors and of recursion."""
        below = list(self._below(fun))
        self._walk(fun)
        return not any(f in self._broken or f in self._recursive for f in below)

    def extern_below(self, fun: FunSymbol) -> FunSymbol | None:
        """An extern function that a call would reach."""
        return next((f for f in self._below(fun) if f.extern), None)

    def param_below(self, fun: FunSymbol) -> tuple[ParamSymbol, Span] | None:
        """A parameter that a call would read, and where."""
        return next((self._params[f] for f in self._below(fun) if f in self._params), None)

    # ------------------------------------------------------------ recursion

    def report_recursion(self) -> None:
        """T006 for every cycle that was not reported yet; all bodies have been checked."""
        for fun in list(self._calls):
            self._walk(fun)

    def _walk(self, root: FunSymbol) -> None:
        """Depth first over what was not walked yet; reports each cycle it meets."""
        if root in self._walked:
            return
        path: dict[FunSymbol, Span | None] = {root: None}
        iterators = [iter(self._calls.get(root, ()))]
        while iterators:
            step = next(iterators[-1], None)
            if step is None:
                iterators.pop()
                self._walked.add(path.popitem()[0])
                continue
            callee, span = step
            if callee in path:
                self._report(path, callee, span)
            elif callee not in self._walked:
                path[callee] = span
                iterators.append(iter(self._calls.get(callee, ())))

    def _report(self, path: dict[FunSymbol, Span | None], again: FunSymbol, closing: Span) -> None:
        funs = list(path)
        cycle = funs[funs.index(again) :]
        if any(f in self._recursive for f in cycle):
            return
        self._recursive.update(cycle)
        through = cycle[1:]
        shown = ", ".join(f"`{f.name}`" for f in through[:MAX_CALLS_SHOWN])
        more = len(through) - MAX_CALLS_SHOWN
        shown += f" and {more} more" if more > 0 else ""
        also = tuple(
            (span, f"calls `{f.name}` here")
            for f in through[:MAX_CALLS_SHOWN]
            if (span := path[f]) is not None
        )
        self.diagnostics.error(
            "T006",
            f"`{again.name}` calls itself" + (f" through {shown}" if through else ""),
            closing,
            "this call closes the circle" if through else "calls itself here",
            also=also,
            notes=("without recursion the time and the stack of every step have a bound",),
            helps=("write a `for` loop with a constant bound",),
        )


ROOTS = {"system", "test"}


class UnusedDeclarations:
    """Warnings waiting for the end of the check."""

    def __init__(self, diagnostics: Diagnostics) -> None:
        self.diagnostics = diagnostics
        self._waiting: list[tuple[Code, str, Span, str, Help]] = []

    def add(self, code: Code, message: str, span: Span, label: str = "", help_: Help = "") -> None:
        """One more, for the end."""
        self._waiting.append((code, message, span, label, help_))

    def variables(self, variables: list[Variable]) -> None:
        """W001 for locals that are never read; a leading `_` says that this is meant."""
        for v in variables:
            if not v.used and not v.name.startswith("_"):
                meant = _meant(v.name) if v.kind == "var" else _renamed(v.name, v.span)
                self.add("W001", f"`{v.name}` is never used", v.span, "declared here", meant)

    def declarations(self, main: FileScope) -> None:
        """W001 for what the main file declares or imports and nobody mentions.

        Only where a system or a test says what the program is: without one the file may be there
        for others to import.
        """
        if not any(e.kind in ROOTS for e in main.entries.values()):
            return
        for entry in main.entries.values():
            name = entry.decl.name
            if entry.kind not in ROOTS and not entry.used and not name.text.startswith("_"):
                message = f"{entry.kind} `{name.text}` is never used"
                meant = _renamed(name.text, name.span)
                self.add("W001", message, name.span, "declared here", meant)
        for imported in main.loaded.file.imports:
            name = imported.name
            if main.imports.get(name.text) is not None and name.text not in main.used_imports:
                whole = remove(imported.span, "remove it")
                self.add("W001", f"import `{name.text}` is never used", name.span, "", whole)

    def report(self) -> None:
        """Say them; `explore/engine/explorer_library.py` leaves them out where there are errors."""
        for code, message, span, label, help_ in self._waiting:
            self.diagnostics.warning(code, message, span, label, helps=(help_,) if help_ else ())


def _renamed(name: str, span: Span) -> Help:
    """For what nothing mentions: its own place is the only one."""
    return insert(span, "_", _meant(name))


def _meant(name: str) -> str:
    return f"remove it, or call it `_{name}` to say that this is meant"


SPECIALS = {
    "in_control": "only the step of a node is in control or not",
    "time": "only nodes, plants and properties see the time",
    "dt": "only nodes and plants have a period",
}
"""Words with a meaning of their own in expressions, and where they have one."""


@dataclass(eq=False)
class Context:
    """A place in the program.

    `where` names the place in messages ("function `f`", "node `Fast`", "the size of an array").
    `constant` is the code to report where only constants may stand (T008; T007 for the bound of
    a loop), else empty; `hidden` is then the place around it, whose locals exist but are not
    known yet. `topics` is None where no topic may be read, "any" where each may (predicates,
    properties), else the readable ones.
    """

    scope: FileScope
    where: str
    constant: Code | Literal[""] = ""
    hidden: Context | None = None
    topics: set[TopicSymbol] | str | None = None
    queues: dict[TopicSymbol, int] = field(default_factory=dict)
    """Topics that are read as the queue of a subscription, and its length."""
    inputs: str = "subscribes"
    """The word that would make a topic readable."""
    has_time: bool = False
    has_period: bool = False
    has_modes: bool = False
    choices: list[Variable] | None = None
    """Where `choose` may stand: the hidden locals of a node's fair choices so far; else None."""
    node: NodeSymbol | None = None
    """The node whose step this is: `in_control`, publish."""
    result: Type | None = None
    """Inside a function: what `return` gives."""
    result_span: Span | None = None
    """Where that is declared."""
    owner: object = None
    """The node or plant whose code this is."""
    instances: dict[str, InstanceSymbol] | None = None
    """Inside a system: `instance.truth`, `mode(instance)`, topics of sub-systems."""
    broken: bool = False
    """The declaration lost a part when it was parsed: names unknown here may have been in it."""
    lost: frozenset[str] = frozenset()
    """Names of instances that could not be made: they were reported."""
    private: dict[str, Variable] = field(default_factory=dict)
    """Locals of a node that its contract cannot speak about."""
    locals: list[dict[str, Variable]] = field(default_factory=list)
    gone: dict[str, Variable] = field(default_factory=dict)
    """Locals of blocks that have ended."""
    topics_read: dict[TopicSymbol, None] = field(default_factory=dict)
    """Topics read so far, in order of first use."""

    def find_local(self, name: str) -> Variable | None:
        """The innermost local called `name`."""
        for frame in reversed(self.locals):
            if name in frame:
                return frame[name]
        return None

    def local_names(self) -> Iterator[str]:
        """The names of all locals in reach."""
        return (name for frame in self.locals for name in frame)


class Shared(Protocol):
    """One checking run, as its parts see it."""

    diagnostics: Diagnostics
    names: Names
    unused: UnusedDeclarations
    calls: CallGraph
    damaged: set[object]
    """Symbols whose declarations have errors: what they lack is no error of others."""
    published: dict[typed.NodeSymbol, set[typed.TopicSymbol]]
    lost: dict[typed.SystemSymbol, frozenset[str]]
    """Names of instances that could not be made."""
    stand_ins: dict[typed.TopicSymbol, tuple[tuple[str, ...], typed.TopicSymbol]]
    """What `stand_in` gave: the path to an instance of a system, and a topic in it."""

    def mark(self) -> tuple[int, int]:
        """Grows when something goes wrong, or turns out to have gone wrong, in what is at hand."""

    def resolve(self, entry: Entry, span: Span, *, use: bool = True) -> object:
        """The symbol of a declaration; cycles are T012; None after an error."""

    def later(self, symbol: object, decl: tree.Decl, scope: FileScope) -> None:
        """Check a body once every signature is known; systems see what is inside the others."""

    def resolve_type(
        self,
        expr: tree.TypeExpr,
        scope: FileScope,
        around: Context | None = None,
        *,
        duration: bool = False,
        table: bool = False,
    ) -> Type:
        """The type it means, ERROR after a report: `TypeChecker.check`."""

    def check_expr(
        self,
        expr: tree.SyntaxExpr,
        context: Context,
        expected: Type | None = None,
        because: Because | None = None,
    ) -> typed.TypedExpr:
        """The typed expression: `ExprBase.check`."""

    def check_block(self, block: tree.Block, context: Context) -> tuple[typed.TypedStmt, ...]:
        """All statements of a block in a scope of its own."""

    def constant(
        self,
        expr: tree.SyntaxExpr,
        scope: FileScope,
        expected: Type,
        what: str,
        around: Context | None = None,
        code: Code = "T008",
    ) -> Value | None:
        """The value of a constant expression, or None after a report."""

    def evaluate(self, checked: typed.TypedExpr, what: str) -> Value | None:
        """The value of a checked constant expression, or None after a report."""

    def number(
        self,
        expr: tree.SyntaxExpr,
        context: Context,
        expected: Type | None,
        what: str,
        because: Because | None = None,
    ) -> typed.TypedExpr:
        """An expression over constants and parameters, to be evaluated for each system."""

    def topic_ref(self, ref: tree.Ref, scope: FileScope) -> typed.TopicSymbol | None:
        """The topic a reference means, or None after a report."""

    def topic_path(
        self, path: tree.DottedPath, scope: FileScope
    ) -> tuple[typed.TopicSymbol, tuple[str, ...], Type] | None:
        """`topic.field...`: the topic, the path below it and the type there."""

    def topics_of(self, system: typed.SystemSymbol) -> list[typed.TopicSymbol]:
        """The topics that stand beside the instances of a system, wires applied."""

    def stand_in(
        self,
        system: typed.SystemSymbol,
        prefix: list[str],
        topic: typed.TopicSymbol,
        span: Span,
    ) -> typed.TopicSymbol:
        """The symbol that means a topic of a sub-system instance, one for each path."""

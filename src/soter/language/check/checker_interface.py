"""The interface between the checkers of one program, and the graph of its declarations.

Purpose: `Shared` has the few operations that the check of a declaration needs from other checkers,
and facts about the whole program; `checker.py` implements it. `Context` says which locals, topics
and special words an expression may use, so that its checker has one rule for every place.
`entries_by_need` puts needed declarations first, so that no chain nests too deep for Python.
`CallGraph` grows while bodies are checked, and reports a cycle as T006. `UnusedDeclarations` keeps
the warnings W001 and W004 until every use is known.
Non-goals: how any of the checkers works; names of declarations (`scope.py`), cycles of them
(`checker.py`); costs of steps (`language/model/tree_walk.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol

from soter.diagnostics.fixes import insert, remove
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

    # entries that need each other in turn, and where the last one needs the first
    Circle = tuple[list[Entry], Span]
    # checks the body of a function, and returns whether it has no errors
    CheckBody = Callable[[FunSymbol, tree.FunDecl, FileScope], bool]
    Because = tuple[Span, str]


SHORT = 50
"""A program with at most this many declarations cannot have a long chain."""

CHAINING = {"type", "constant", "parameter", "function", "system"}
"""Kinds of declarations that can need one of the same kind."""


def entries_by_need(entries: list[Entry], names: Names) -> tuple[list[Entry], list[Circle]]:
    """Gives the entries, each after the entries it mentions, and the circles without functions.

    The checker finds circles with functions later, because a name in a function may be a local.
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
        path = [(root, _chained_entries(root, names))]
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
                path.append((needed, _chained_entries(needed, names)))
            elif id(needed) in open_:
                stack = [e for e, _ in path]
                circle = stack[next(i for i, e in enumerate(stack) if e is needed) :]
                if all(e.kind != "function" for e in circle):
                    circles.append((circle, span))
    return ordered, circles


def _chained_entries(entry: Entry, names: Names) -> Iterator[tuple[Entry, Span]]:
    """Yields each mentioned entry that may itself need others, with the place of its mention."""
    if entry.kind not in CHAINING:
        return
    for qualifier, name, span in names_mentioned(entry.decl):
        scope = entry.scope if qualifier is None else entry.scope.imports.get(qualifier)
        dependency = scope.entries.get(name) if scope is not None else None
        if dependency is None and qualifier is None:
            dependency = names.prelude.get(name)
        if (
            dependency is not None
            and dependency.kind in CHAINING
            and not dependency.scope.loaded.prelude
        ):
            yield dependency, span


def names_mentioned(root: object) -> Iterator[tuple[str | None, str, Span]]:
    """Yields qualifier, name and place of each name in a piece of syntax that may be declared."""
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


MAX_CALLS_SHOWN = 4


class CallGraph:
    """The functions of a program and their calls; each body is checked once, when it is needed."""

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

    def add_body(self, fun: FunSymbol, decl: tree.FunDecl, scope: FileScope) -> None:
        """Queues a body to be checked; a body of the prelude is checked only if it is called."""
        (self._lazy if scope.loaded.prelude else self._unchecked)[fun] = (decl, scope)

    def mark_invalid(self, fun: FunSymbol) -> None:
        """Marks a function whose declaration has an error, so that no constant may call it."""
        self._broken.add(fun)

    def note_call(self, fun: FunSymbol, span: Span) -> None:
        """Records a call in the body that is being checked, and queues the body of the callee."""
        if self.current is not None:
            self._calls.setdefault(self.current, []).append((fun, span))
        lazy = self._lazy.pop(fun, None)
        if lazy is not None:
            self._unchecked[fun] = lazy

    def note_param(self, param: ParamSymbol, span: Span) -> None:
        """Records that the body that is being checked reads a parameter of the program."""
        if self.current is not None:
            self._params.setdefault(self.current, (param, span))

    def check_body(self, fun: FunSymbol) -> None:
        """Checks a function's body now, unless that was done before."""
        waiting = self._unchecked.pop(fun, None)
        if waiting is None:
            return
        outer, self.current = self.current, fun
        if not self._check_body(fun, *waiting):
            self._broken.add(fun)
        self.current = outer

    def check_bodies(self) -> bool:
        """Checks all bodies that are still unchecked; returns whether there were any."""
        had_any = bool(self._unchecked)
        while self._unchecked:
            self.check_body(next(iter(self._unchecked)))
        return had_any

    # ------------------------------------------------------------ calls and reads of functions

    def _fun_and_callees(self, fun: FunSymbol) -> Iterator[FunSymbol]:
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

    def is_complete(self, fun: FunSymbol) -> bool:
        """Whether the function and all functions it calls have neither errors nor recursion."""
        below = list(self._fun_and_callees(fun))
        self._report_cycles(fun)
        return not any(f in self._broken or f in self._recursive for f in below)

    def extern_called_by(self, fun: FunSymbol) -> FunSymbol | None:
        """Gives an extern that the function calls, directly or not; None if it calls no extern."""
        return next((f for f in self._fun_and_callees(fun) if f.extern), None)

    def param_read_by(self, fun: FunSymbol) -> tuple[ParamSymbol, Span] | None:
        """Gives a parameter that the function or a callee reads, and the place; or None."""
        funs = self._fun_and_callees(fun)
        return next((self._params[f] for f in funs if f in self._params), None)

    # ------------------------------------------------------------ recursion

    def report_recursion(self) -> None:
        """Reports T006 for every new cycle; to be called after all bodies have been checked."""
        for fun in list(self._calls):
            self._report_cycles(fun)

    def _report_cycles(self, root: FunSymbol) -> None:
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
                self._report_cycle(path, callee, span)
            elif callee not in self._walked:
                path[callee] = span
                iterators.append(iter(self._calls.get(callee, ())))

    def _report_cycle(self, path: dict[FunSymbol, Span | None], fun: FunSymbol, at: Span) -> None:
        funs = list(path)
        cycle = funs[funs.index(fun) :]
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
            f"`{fun.name}` calls itself" + (f" through {shown}" if through else ""),
            at,
            "this call closes the circle" if through else "calls itself here",
            also=also,
            notes=("without recursion the time and the stack of every step have a bound",),
            helps=("write a `for` loop with a constant bound",),
        )


ROOTS = {"system", "test"}


class UnusedDeclarations:
    """Keeps warnings of unused declarations until the end of the check."""

    def __init__(self, diagnostics: Diagnostics) -> None:
        self.diagnostics = diagnostics
        self._waiting: list[tuple[Code, str, Span, str, Help]] = []

    def keep(self, code: Code, message: str, span: Span, label: str = "", help_: Help = "") -> None:
        """Keeps a warning for the end of the check."""
        self._waiting.append((code, message, span, label, help_))

    def warn_of_variables(self, variables: list[Variable]) -> None:
        """Warns W001 of locals that are never read, except those whose names begin with `_`."""
        for v in variables:
            if not v.used and not v.name.startswith("_"):
                meant = _unused_help(v.name) if v.kind == "var" else _rename_help(v.name, v.span)
                self.keep("W001", f"`{v.name}` is never used", v.span, "declared here", meant)

    def warn_of_declarations(self, main: FileScope) -> None:
        """Warns W001 of unused declarations and imports of the main file.

        It warns of nothing in a file without system and test, as other files may import it.
        """
        if not any(e.kind in ROOTS for e in main.entries.values()):
            return
        for entry in main.entries.values():
            name = entry.decl.name
            if entry.kind not in ROOTS and not entry.used and not name.text.startswith("_"):
                message = f"{entry.kind} `{name.text}` is never used"
                meant = _rename_help(name.text, name.span)
                self.keep("W001", message, name.span, "declared here", meant)
        for imported in main.loaded.file.imports:
            name = imported.name
            if main.imports.get(name.text) is not None and name.text not in main.used_imports:
                removal = remove(imported.span, "remove it")
                self.keep("W001", f"import `{name.text}` is never used", name.span, "", removal)

    def report_kept(self) -> None:
        """Reports the kept warnings; the front end hides warnings if the program has errors."""
        for code, message, span, label, help_ in self._waiting:
            self.diagnostics.warning(code, message, span, label, helps=(help_,) if help_ else ())


def _rename_help(name: str, span: Span) -> Help:
    """Gives the edit that puts `_` before the name of an unused declaration, its only mention."""
    return insert(span, "_", _unused_help(name))


def _unused_help(name: str) -> str:
    return f"remove it, or call it `_{name}` to say that this is meant"


SPECIALS = {
    "in_control": "only the step of a node is in control or not",
    "time": "only nodes, plants and properties see the time",
    "dt": "only nodes and plants have a period",
}
"""Word with a special meaning in expressions -> why it has none in other places."""


@dataclass(eq=False)
class Context:
    """A place in the program, and the names that code at this place may use.

    `where` names the place in messages ("function `f`", "node `Fast`", "the size of an array").
    `constant` is the code to report for a name that is not constant (T008; T007 for the bound of a
    loop), or "" if other names are allowed; `hidden` is then the surrounding place, whose locals
    have no values yet. `topics` is None if no topic may be read, "any" if all may (predicates,
    properties), else the set of readable topics.
    """

    scope: FileScope
    where: str
    constant: Code | Literal[""] = ""
    hidden: Context | None = None
    topics: set[TopicSymbol] | str | None = None
    queues: dict[TopicSymbol, int] = field(default_factory=dict)
    """Topic that is read as the queue of a subscription -> the queue's length."""
    inputs: str = "subscribes"
    """The clause that would make a topic readable: `subscribes` or `reads`."""
    has_time: bool = False
    has_period: bool = False
    has_modes: bool = False
    choices: list[Variable] | None = None
    """The hidden locals of fair choices so far, if `choose` may be used here; else None."""
    node: NodeSymbol | None = None
    """The node whose step this is: `in_control`, publish."""
    result: Type | None = None
    """Inside a function: the type of its result."""
    result_span: Span | None = None
    """Where the function declares that type."""
    owner: object = None
    """The node or plant that the code belongs to."""
    instances: dict[str, InstanceSymbol] | None = None
    """Inside a system: `instance.truth`, `mode(instance)`, topics of sub-systems."""
    broken: bool = False
    """Whether the parser lost a part of the declaration, which may have had unknown names."""
    lost: frozenset[str] = frozenset()
    """Names of instances that could not be made, which has been reported."""
    private: dict[str, Variable] = field(default_factory=dict)
    """Locals of a node, which its contract may not read."""
    locals: list[dict[str, Variable]] = field(default_factory=list)
    gone: dict[str, Variable] = field(default_factory=dict)
    """Locals of blocks that have ended."""
    topics_read: dict[TopicSymbol, None] = field(default_factory=dict)
    """Topics read so far, in order of first use."""

    def find_local(self, name: str) -> Variable | None:
        """Gives the innermost local with this name, or None."""
        for frame in reversed(self.locals):
            if name in frame:
                return frame[name]
        return None

    def local_names(self) -> Iterator[str]:
        """Yields the names of all locals that the place may use."""
        return (name for frame in self.locals for name in frame)


class Shared(Protocol):
    """The functions of the checkers that other checkers call; `checker.py` implements them."""

    diagnostics: Diagnostics
    names: Names
    unused: UnusedDeclarations
    calls: CallGraph
    damaged: set[object]
    """Symbols whose declarations have errors, so that uses of them report no more."""
    published: dict[typed.NodeSymbol, set[typed.TopicSymbol]]
    lost: dict[typed.SystemSymbol, frozenset[str]]
    """System -> names of instances that could not be made."""
    stand_ins: dict[typed.TopicSymbol, tuple[tuple[str, ...], typed.TopicSymbol]]
    """Symbol from `topic_of_instance` -> the path to an instance of a system, and a topic in it."""

    def damage_counts(self) -> tuple[int, int]:
        """Gives two counts that grow when the declaration being checked turns out to be damaged."""

    def resolve(self, entry: Entry, span: Span, *, use: bool = True) -> object:
        """Gives the symbol of a declaration; None after an error (T012 for a cycle)."""

    def check_body_later(self, symbol: object, decl: tree.Decl, scope: FileScope) -> None:
        """Queues a body to be checked once every signature is known; systems come last."""

    def resolve_type(
        self,
        expr: tree.TypeExpr,
        scope: FileScope,
        around: Context | None = None,
        *,
        duration: bool = False,
        table: bool = False,
    ) -> Type:
        """Gives the type that a type expression means; ERROR after a reported error."""

    def check_expr(
        self,
        expr: tree.SyntaxExpr,
        context: Context,
        expected: Type | None = None,
        because: Because | None = None,
    ) -> typed.TypedExpr:
        """Gives the typed expression, of type `expected` if set; ERROR after a reported error."""

    def check_block(self, block: tree.Block, context: Context) -> tuple[typed.TypedStmt, ...]:
        """Gives the typed statements of a block, for which it opens a new scope."""

    def const_value(
        self,
        expr: tree.SyntaxExpr,
        scope: FileScope,
        expected: Type,
        subject: str,
        around: Context | None = None,
        code: Code = "T008",
    ) -> Value | None:
        """Gives the value of a constant expression; None after a reported error."""

    def evaluate(self, checked: typed.TypedExpr, subject: str) -> Value | None:
        """Gives the value of a checked constant expression; None after a reported error."""

    def check_number(
        self,
        expr: tree.SyntaxExpr,
        context: Context,
        expected: Type | None,
        subject: str,
        because: Because | None = None,
    ) -> typed.TypedExpr:
        """Gives the typed expression of a number that each system computes by its parameters."""

    def topic_of_ref(self, ref: tree.Ref, scope: FileScope) -> typed.TopicSymbol | None:
        """Gives the topic that a reference means; None after a reported error."""

    def topic_of_path(
        self, path: tree.DottedPath, scope: FileScope
    ) -> tuple[typed.TopicSymbol, tuple[str, ...], Type] | None:
        """Gives the topic of `topic.field...`, the path of the field and the field's type."""

    def topics_of_system(self, system: typed.SystemSymbol) -> list[typed.TopicSymbol]:
        """Gives the topics that an instance of the system contains, but no topics wired to it."""

    def topic_of_instance(
        self, system: typed.SystemSymbol, prefix: list[str], topic: typed.TopicSymbol, span: Span
    ) -> typed.TopicSymbol:
        """Gives the symbol of a topic of the sub-system at `prefix`; the same one in each call."""

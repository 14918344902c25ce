"""What the checkers of one program ask of each other, and what an expression may mention.

Purpose: `Shared` has the few operations that checking a declaration may need of the rest, and what
is known of the whole program; `checker.py` fills them in. `Context` says which locals, topics and
specials are in reach, so that the checker of expressions has one rule for every place.
Non-goals: how any of the checkers works; resolving names of declarations (`scope.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.check.declaration_graph import CallGraph, UnusedDeclarations
    from soter.language.check.scope import Entry, FileScope, Names
    from soter.language.model import typed
    from soter.language.model.typed import InstanceSymbol, NodeSymbol, TopicSymbol, Variable
    from soter.language.model.types import Type, Value
    from soter.language.syntax import tree

    Because = tuple[Span, str]


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

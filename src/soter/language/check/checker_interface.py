"""What the checkers of one program ask of each other.

Purpose: the few operations that checking any declaration may need of the rest, and what is known
of the whole program; `checker.py` fills them in, and nobody else knows who answers.
Non-goals: how any of them works.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.language.check.call_graph import CallGraph
    from soter.language.check.expression_context import Context
    from soter.language.check.scope import Entry, FileScope, Names
    from soter.language.check.unused import UnusedDeclarations
    from soter.language.model import typed
    from soter.language.model.types import Type, Value
    from soter.language.syntax import tree

    Because = tuple[Span, str]


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

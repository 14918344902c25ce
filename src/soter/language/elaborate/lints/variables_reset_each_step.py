"""Variables of a step that were meant to last longer than it.

Purpose: W029, a variable that counts or collects, and begins anew with every step.
Non-goals: variables that are never read (`check/declaration_graph.py`); functions, whose variables
end with them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.predicates import same_expression
from soter.language.model import typed
from soter.language.model.tree_walk import nodes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Diagnostics

_LOOPS = (typed.ForRange, typed.ForEach)


def doubt_variables(node: typed.NodeSymbol, diagnostics: Diagnostics) -> None:
    """W029 for the step of a node."""
    for block in _blocks(node.step):
        for s in block:
            if isinstance(s, typed.TypedDeclare) and s.variable.kind == "var":
                _begins_anew(s, block, diagnostics)


def _blocks(block: tuple[typed.TypedStmt, ...]) -> Iterator[tuple[typed.TypedStmt, ...]]:
    """A block, and those of its conditions: what stands in a loop lasts from round to round."""
    yield block
    for s in block:
        if isinstance(s, typed.TypedIf):
            for inner in (*(body for _, body in s.arms), s.otherwise):
                yield from _blocks(inner)


def _begins_anew(
    declared: typed.TypedDeclare, block: tuple[typed.TypedStmt, ...], diagnostics: Diagnostics
) -> None:
    variable = declared.variable
    reads = (typed.VarRead, typed.TopicRead, typed.TypedCall, typed.TypedChoose)
    if any(isinstance(n, reads) for n in nodes([declared.value])):
        return
    in_loops = [n for s in nodes(block) if isinstance(s, _LOOPS) for n in nodes(s.body)]
    written = [
        n
        for n in nodes(block)
        if isinstance(n, (typed.TypedAssign, typed.TypedPush)) and n.place.variable is variable
    ]
    changes = [n for n in written if not _begins_again(n, declared.value)]
    if len(changes) != 1 or changes[0] in in_loops or changes[0].place.path:
        return
    (only,) = changes
    if isinstance(only, typed.TypedAssign) and not any(
        isinstance(n, typed.VarRead) and n.variable is variable for n in nodes([only.value])
    ):
        return
    diagnostics.warning(
        "W029",
        f"`{variable.name}` begins anew with every step",
        variable.span,
        "declared inside of the step",
        also=((only.span, "changed once in a step"),),
        notes=("what a node keeps from step to step is declared before `step`",),
        helps=(f"declare it before the step: `{' '.join(declared.span.text.split())}`",),
    )


def _begins_again(s: typed.TypedAssign | typed.TypedPush, first: typed.TypedExpr) -> bool:
    """Whether it sets the variable to the constant it begins with: `else { ticks = 0; }`."""
    return isinstance(s, typed.TypedAssign) and not s.place.path and same_expression(s.value, first)

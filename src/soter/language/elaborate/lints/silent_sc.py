"""Whether the step of a safe controller publishes on every path.

Purpose: W016, a path through the step on which an output is not published: the topic keeps what AC
wrote.
Non-goals: what is published (`step_ranges.py`); other nodes; an SC that looks whether it has
control.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.tree_walk import nodes

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Module, System


def doubt_publications(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """W016 for the safe controller of a module."""
    sc = system.components[module.sc]
    if sc.node is None or sc.extern:
        return
    publications = [n for n in nodes(sc.node.step) if isinstance(n, typed.TypedPublish)]
    if sc.node.takeover is not None or any(
        isinstance(n, typed.InControl) for n in nodes(sc.node.step)
    ):
        return  # it knows when it has control, and speaks when it means to
    for topic in sc.node.publishes:
        first = next((p for p in publications if p.topic is topic), None)
        if first is None or _always(sc.node.step, topic):
            continue
        diagnostics.warning(
            "W016",
            f"`{sc.node.name}` does not publish `{topic.name}` on every path of its step",
            first.span,
            "published here",
            also=((module.symbol.sc_span or module.symbol.span, "the safe controller"),),
            notes=("where it is silent, the last value that AC published stays in force",),
            helps=("publish on every path: what stands in an `if` also needs an `else`",),
        )


def _always(statements: tuple[typed.TypedStmt, ...], topic: typed.TopicSymbol) -> bool:
    """Whether every path through the statements publishes the topic."""
    for s in statements:
        if isinstance(s, typed.TypedPublish) and s.topic is topic:
            return True
        if isinstance(s, typed.TypedIf) and s.otherwise:
            bodies = [*(body for _, body in s.arms), s.otherwise]
            if all(_always(body, topic) for body in bodies):
                return True
        if isinstance(s, typed.ForRange) and s.low < s.high and _always(s.body, topic):
            return True
    return False

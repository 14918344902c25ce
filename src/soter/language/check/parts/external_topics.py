"""Check what a system says of the world outside: `external topic`, `deploys`.

Purpose: declarations -> symbols; names, types and repetitions.
Non-goals: numbers; whether a deployed system is the proved one (`elaborate/deployment/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.expression_base import a_type, is_error, sound
from soter.language.check.expression_context import Context
from soter.language.model import typed
from soter.language.model.types import DURATION, FLOAT, is_vector_part

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.span import Span
    from soter.language.check.checker_interface import Shared
    from soter.language.check.scope import FileScope
    from soter.language.syntax import tree


def deployed_system(
    shared: Shared, decl: tree.SystemDecl, scope: FileScope
) -> typed.SystemSymbol | None:
    """The system that `deploys` names; None where nothing is named, or nothing that is one."""
    if decl.deploys is None:
        return None
    entry = shared.names.find_ref(scope, decl.deploys, "system")
    symbol = shared.resolve(entry, decl.deploys.span) if entry is not None else None
    if isinstance(symbol, typed.SystemSymbol):
        return symbol
    if entry is not None and entry.kind != "system":
        shared.diagnostics.error(
            "N003",
            f"`{decl.deploys.text}` is a {entry.kind}, not a system",
            decl.deploys.span,
            also=((entry.decl.name.span, "declared here"),),
            notes=("`deploys` names the system in which the modules were proved",),
        )
    return None


def externals(
    shared: Shared, decl: tree.SystemDecl, scope: FileScope
) -> tuple[typed.ExternalSymbol, ...]:
    """Every external topic of a system, each once."""
    context = Context(scope, f"system `{decl.name.text}`")
    external_by_topic: dict[typed.TopicSymbol, typed.ExternalSymbol] = {}
    for item in decl.externals:
        at = shared.topic_path(item.topic, scope)
        every = _time(shared, item.every, context, "`every`")
        delayed = _time(shared, item.delayed, context, "`delayed`")
        if at is None:
            continue
        topic, below, _ = at
        if below:
            _no_topic(shared, item)
        elif topic in external_by_topic:
            _twice(shared, item.topic, external_by_topic[topic].span)
        else:
            measured = tuple(_measured(shared, item, topic, context))
            external_by_topic[topic] = typed.ExternalSymbol(
                topic, every, delayed, measured, item.topic.span
            )
    return tuple(external_by_topic.values())


def _time(
    shared: Shared, e: tree.SyntaxExpr | None, context: Context, what: str
) -> typed.TypedExpr | None:
    return None if e is None else sound(shared.number(e, context, DURATION, what))


def _no_topic(shared: Shared, item: tree.ExternalTopic) -> None:
    shared.diagnostics.error(
        "N003",
        f"`{item.topic.text}` is a part of a topic",
        item.topic.span,
        notes=("a topic is published and read as a whole",),
        helps=(f"write `external topic {item.topic.parts[0].text};`",),
    )


def _twice(shared: Shared, again: tree.DottedPath, first: Span) -> None:
    message = f"`{again.text}` is said twice to be outside"
    shared.diagnostics.error("N002", message, again.span, "again", also=((first, "before"),))


def _measured(
    shared: Shared, item: tree.ExternalTopic, topic: typed.TopicSymbol, context: Context
) -> Iterator[typed.MeasuredSymbol]:
    """The errors of its leaves, each given once."""
    taken: list[tuple[tuple[str, ...], Span]] = []
    for path, bound in item.measured:
        within = shared.number(bound, context, FLOAT, "the bound of an error")
        at = shared.topic_path(path, context.scope)
        if at is None:
            continue
        named, below, t = at
        first = next((s for p, s in taken if p[: len(below)] == below[: len(p)]), None)
        if named is not topic:
            shared.diagnostics.error(
                "M009",
                f"`{path.span.text}` is no part of `{item.topic.text}`",
                path.span,
                notes=("an external topic says the errors of its own fields only",),
            )
        elif not is_vector_part(t):
            shared.diagnostics.error(
                "T018",
                f"only floats and vectors are measured with an error, not {a_type(t)}",
                path.span,
                helps=("name the fields that are floats",),
            )
        elif first is not None:
            message = f"the error of `{path.span.text}` is given twice"
            also = ((first, "the first time"),)
            shared.diagnostics.error("N002", message, path.span, "again", also=also)
        elif not is_error(within):
            yield typed.MeasuredSymbol(topic, below, within, path.span)
        taken.append((below, path.span))

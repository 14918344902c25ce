"""Queues behind topics, in generated C.

Purpose: how a topic's value is put into them, and the step fault of a lost value.
Non-goals: what queues hold in memory (`core/layout.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.c import tree as c
from soter.codegen.c.types import FAULT
from soter.codegen.function_context import S
from soter.language.model.system import queues_of
from soter.language.model.types import ListType

if TYPE_CHECKING:
    from soter.codegen.function_context import Frame
    from soter.language.model.system import Component, Topic


def push(frame: Frame, topic: Topic) -> c.FunctionDef:
    """Puts a topic's value into the queues behind it, each by its policy when it is full."""
    body: list[c.CStmt] = [frame.state_pointer()]
    for index in topic.queues:
        queue = frame.system.topics[index]
        assert isinstance(queue.type, ListType)
        items = c.Member(frame.topic(index), "items")
        length = c.Member(frame.topic(index), "len")
        capacity = queue.type.capacity
        append = (
            c.Assign(c.IndexExpr(items, length), frame.topic(topic.index)),
            c.Assign(length, c.Binary("+", length, c.Number("1"))),
        )
        room = c.Binary("<", length, c.Number(str(capacity)))
        if queue.policy == "drop_oldest":
            k = c.Name("k")
            after = c.IndexExpr(items, c.Binary("+", k, c.Number("1")))
            move = (c.Assign(c.IndexExpr(items, k), after),)
            last = c.Number(str(capacity - 1))
            shift = (c.For("k", c.Number("0"), last, move),) if capacity > 1 else ()
            body += [c.IfStmt(c.Unary("!", room), (*shift, c.Assign(length, last))), *append]
        elif queue.policy == "fault":
            lost = c.Assign(_lost(index), c.Name("SOTER_LOST"))
            body.append(c.IfStmt(room, append, (lost,)))
        else:
            body.append(c.IfStmt(room, append))
    doc = f"the queues behind {topic.name}"
    return c.FunctionDef(
        "void", frame.pushed(topic.index), (("void *", "state"),), tuple(body), doc
    )


def _lost(queue: int) -> c.CExpr:
    """Whether a queue lost a value that it may not lose: SOTER_LOST, else SOTER_NEVER."""
    return c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(queue)))


def _has_lost(queue: int) -> c.CExpr:
    return c.Binary("!=", _lost(queue), c.Name("SOTER_NEVER"))


def must_not_lose(frame: Frame, component: Component) -> list[c.CStmt]:
    """A step fault where a queue of the node lost a value that it may not lose."""
    return [
        c.Do(
            c.CallExpr(
                "soter_guard",
                (c.Unary("!", _has_lost(q)), c.Name("SOTER_CAPACITY"), FAULT),
            )
        )
        for q in queues_of(frame.system, component)
        if frame.system.topics[q].policy == "fault"
    ]


def empty(frame: Frame, queue: int) -> c.CStmt:
    """Take everything out of a queue."""
    default = frame.types.default(frame.system.topics[queue].type)
    return c.Assign(frame.topic(queue), default)


def forgive(frame: Frame, component: Component) -> list[c.CStmt]:
    """After that fault the queue starts afresh."""
    statements: list[c.CStmt] = []
    for q in queues_of(frame.system, component):
        if frame.system.topics[q].policy == "fault":
            fresh = (empty(frame, q), c.Assign(_lost(q), c.Name("SOTER_NEVER")))
            told = c.Binary("==", c.Name("status"), c.Name("SOTER_CAPACITY"))
            statements.append(c.IfStmt(c.Binary("&&", told, _has_lost(q)), fresh))
    return statements

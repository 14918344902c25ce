"""The queues behind topics, in generated C.

Purpose: a published value is put into each queue behind its topic; a full queue follows its policy.
A lost value that may not be lost is a step fault of the queue's reader.
Non-goals: when a reader empties its queues (`nodes.py`), what they hold in memory
(`core/layout.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_types import FAULT
from soter.codegen.state_access import stamp_place
from soter.language.model.system import queues_read_by
from soter.language.model.types import ListType

if TYPE_CHECKING:
    from soter.codegen.state_access import Frame
    from soter.language.model.system import Component, Topic


def push_function(frame: Frame, topic: Topic) -> c.FunctionDef:
    """The C function that puts a topic's value into its queues; a full queue follows its policy."""
    body: list[c.CStmt] = [frame.state_pointer()]
    for index in topic.queues:
        queue = frame.system.topics[index]
        assert isinstance(queue.type, ListType)
        items = c.Member(frame.topic_place(index), "items")
        length = c.Member(frame.topic_place(index), "len")
        capacity = queue.type.capacity
        append = (
            c.Assign(c.IndexExpr(items, length), frame.topic_place(topic.index)),
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
            lost = c.Assign(stamp_place(index), c.Name("SOTER_LOST"))
            body.append(c.IfStmt(room, append, (lost,)))
        else:
            body.append(c.IfStmt(room, append))
    doc = f"the queues behind {topic.name}"
    return c.FunctionDef(
        "void", frame.push_name(topic.index), (("void *", "state"),), tuple(body), doc
    )


def _lost_condition(queue: int) -> c.CExpr:
    """The C condition that a queue has lost a value but may not lose any (SOTER_LOST)."""
    return c.Binary("!=", stamp_place(queue), c.Name("SOTER_NEVER"))


def check_queues(frame: Frame, component: Component) -> list[c.CStmt]:
    """Raises a capacity fault if a queue of the node has lost a value that it may not lose."""
    return [
        c.Do(
            c.CallExpr(
                "soter_guard", (c.Unary("!", _lost_condition(q)), c.Name("SOTER_CAPACITY"), FAULT)
            )
        )
        for q in queues_read_by(frame.system, component)
        if frame.system.topics[q].policy == "fault"
    ]


def empty_queue(frame: Frame, queue: int) -> c.CStmt:
    """The C that empties a queue."""
    default = frame.types.default_constant(frame.system.topics[queue].type)
    return c.Assign(frame.topic_place(queue), default)


def clear_lost_queues(frame: Frame, component: Component) -> list[c.CStmt]:
    """After a capacity fault, empties the queues that lost a value and clears their mark."""
    overflowed = c.Binary("==", c.Name("status"), c.Name("SOTER_CAPACITY"))
    return [
        c.IfStmt(
            c.Binary("&&", overflowed, _lost_condition(q)),
            (empty_queue(frame, q), c.Assign(stamp_place(q), c.Name("SOTER_NEVER"))),
        )
        for q in queues_read_by(frame.system, component)
        if frame.system.topics[q].policy == "fault"
    ]

"""The steps of a path through a message: what each part of `a.b.0.c` is.

Purpose: languages that write a member, an element of an array and one of a sequence differently,
and a text with room for so many bytes unlike one without a bound.
Non-goals: whether the path exists: `MessageType.field` says that, and is asked first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from soter.mapping.message_types import ARRAY, BASE, NAMED, SEQUENCE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.mapping.message_types import MessageType

Step = Literal["member", "array", "sequence"]


def steps_of(message: MessageType, path: str, ros: int) -> list[tuple[str, Step]]:
    """Each part of a path, and what it is taken out of: a record, an array, a sequence."""
    return [(part, step) for part, step, _ in _walk(message, path, ros)]


def text_bound(message: MessageType, path: str, ros: int) -> int:
    """How many bytes the text at a path may have; 0 where there is no bound."""
    *_, (_, _, kind) = _walk(message, path, ros)
    return int(kind[1][1]) if kind[0] == BASE else 0


def _walk(message: MessageType, path: str, ros: int) -> Iterator[tuple[str, Step, Any]]:
    definitions = message.definitions[ros]
    kind: Any = (NAMED, message.ros2)
    for part in path.split("."):
        step: Step = "member"
        if kind[0] in (ARRAY, SEQUENCE):
            step = "array" if kind[0] == ARRAY else "sequence"
            kind = kind[1][0]
        else:
            kind = dict(definitions[kind[1]][1])[part]
        yield part, step, kind

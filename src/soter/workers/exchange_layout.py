"""What is exchanged with the process of an extern node, byte for byte.

Purpose: where each topic lies in a request and in an answer, and the number that tells a process
that was built for another layout (`Exchange.number`).
Non-goals: moving the bytes (`shared_memory_channel.py`, `runtime/posix/soter_channel.c`).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.codegen.externs import answer_fields, request_fields
from soter.core.layout import LayoutMember, Struct, align_of, arrange, size_of
from soter.language.model.types import ArrayType, EnumType, ListType, RecordType

if TYPE_CHECKING:
    from soter.language.model.system import Component, System
    from soter.language.model.types import Type


@dataclass(frozen=True)
class Exchange:
    """Both layouts of an extern node; `number`: 64 bits of the SHA-256 of them."""

    request: Struct
    answer: Struct
    number: int

    @property
    def sizes(self) -> tuple[int, int]:
        """Bytes of a request and of an answer."""
        return self.request.size, self.answer.size


def exchange_of(system: System, component: Component) -> Exchange:
    """The exchange of an extern node."""
    request = _as_declared(request_fields(system, component))
    fields = answer_fields(component)
    answer = arrange(fields)
    if not answer.members:
        answer = Struct((), 8, 1, 8)
    text = f"{component.name} in {_shown(request)} out {_shown(answer)}"
    number = int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")
    return Exchange(request, answer, number)


def _as_declared(fields: tuple[tuple[str, Type], ...]) -> Struct:
    """How C lays out these members in this order."""
    offset, members = 0, []
    for index, (name, t) in enumerate(fields):
        offset = -(-offset // align_of(t)) * align_of(t)
        members.append(LayoutMember(name, t, offset, index))
        offset += size_of(t)
    align = max([1, *(align_of(t) for _, t in fields)])
    size = max(-(-offset // align) * align, 1)
    return Struct(tuple(members), size, align, size - offset)


def _shown(struct: Struct) -> str:
    parts = [f"{m.name}@{m.offset}:{_type(m.type)}" for m in struct.members]
    return f"[{' '.join(parts)}] {struct.size}"


def _type(t: Type) -> str:
    """A type by what its bytes mean, names of records left out."""
    if isinstance(t, RecordType):
        return "{" + " ".join(f"{n}:{_type(f)}" for n, f in t.fields) + "}"
    if isinstance(t, ArrayType):
        return f"{_type(t.element)}[{t.size}]"
    if isinstance(t, ListType):
        return f"{_type(t.element)}[<={t.capacity}]"
    if isinstance(t, EnumType):
        return f"enum({' '.join(t.members)})"
    return f"{type(t).__name__}:{size_of(t)}"

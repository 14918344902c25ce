"""A small syntax tree for C99.

Purpose: what the back end builds and `printer.py` prints; no text is pasted together.
Non-goals: all of C; only what generated programs need.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

# ---------------------------------------------------------------- expressions


@dataclass(frozen=True)
class CExpr:
    """Any C expression."""


@dataclass(frozen=True)
class Name(CExpr):
    """An identifier or a macro constant."""

    text: str


@dataclass(frozen=True)
class Number(CExpr):
    """A literal, already spelled as C."""

    text: str


@dataclass(frozen=True)
class String(CExpr):
    """A string literal; the printer escapes it."""

    value: str


@dataclass(frozen=True)
class Unary(CExpr):
    """Prefix operator: - ! & *."""

    op: str
    operand: CExpr


@dataclass(frozen=True)
class Binary(CExpr):
    """Infix operator."""

    op: str
    left: CExpr
    right: CExpr


@dataclass(frozen=True)
class Ternary(CExpr):
    """c ? a : b."""

    condition: CExpr
    then: CExpr
    otherwise: CExpr


@dataclass(frozen=True)
class CallExpr(CExpr):
    """f(a, b)."""

    function: str
    arguments: tuple[CExpr, ...]


@dataclass(frozen=True)
class Member(CExpr):
    """target.name; of what a pointer points to, pointer->name."""

    target: CExpr
    name: str


@dataclass(frozen=True)
class Arrow(CExpr):
    """target->name."""

    target: CExpr
    name: str


@dataclass(frozen=True)
class IndexExpr(CExpr):
    """target[index]."""

    target: CExpr
    index: CExpr


@dataclass(frozen=True)
class Cast(CExpr):
    """(type)operand."""

    type: str
    operand: CExpr


@dataclass(frozen=True)
class Initializer(CExpr):
    """{ .a = 1, .b = 2 } or { 1, 2 }; with a type, a compound literal."""

    items: tuple[tuple[str | None, CExpr], ...]
    type: str | None = None


# ---------------------------------------------------------------- statements


@dataclass(frozen=True)
class CStmt:
    """Any C statement."""


@dataclass(frozen=True)
class Declare(CStmt):
    """A declaration: `type name = value;`."""

    type: str
    name: str
    value: CExpr | None
    const: bool = False


@dataclass(frozen=True)
class Assign(CStmt):
    """An assignment."""

    target: CExpr
    value: CExpr


@dataclass(frozen=True)
class Do(CStmt):
    """An expression for its effect."""

    expression: CExpr


@dataclass(frozen=True)
class Unused(CStmt):
    """Marks a name as unused on purpose: `(void)name;`; not printed where the body reads it."""

    name: str


@dataclass(frozen=True)
class IfStmt(CStmt):
    """if (c) { ... } else { ... }."""

    condition: CExpr
    then: tuple[CStmt, ...]
    otherwise: tuple[CStmt, ...] = ()


@dataclass(frozen=True)
class For(CStmt):
    """for (int64_t name = low; name < high; name++) { ... }."""

    name: str
    low: CExpr
    high: CExpr
    body: tuple[CStmt, ...]


@dataclass(frozen=True)
class Return(CStmt):
    """A return."""

    value: CExpr | None


@dataclass(frozen=True)
class Comment(CStmt):
    """A line comment among statements."""

    text: str


# ---------------------------------------------------------------- top level


@dataclass(frozen=True)
class CTop:
    """Anything at file level."""


@dataclass(frozen=True)
class FileComment(CTop):
    """A block comment."""

    lines: tuple[str, ...]


@dataclass(frozen=True)
class Section(CTop):
    """A heading between groups of definitions."""

    title: str


@dataclass(frozen=True)
class Include(CTop):
    """#include; system headers in angle brackets."""

    path: str
    system: bool = False


@dataclass(frozen=True)
class Guarded(CTop):
    """An include guard around everything after it."""

    macro: str


@dataclass(frozen=True)
class Define(CTop):
    """#define name value."""

    name: str
    value: str


@dataclass(frozen=True)
class StructMember:
    """A member: `type name[length];`."""

    type: str
    name: str
    length: int | None = None
    comment: str = ""


@dataclass(frozen=True)
class StructDef(CTop):
    """A named struct: `typedef struct { ... } name;`."""

    name: str
    members: tuple[StructMember, ...]
    comment: str = ""


@dataclass(frozen=True)
class Alias(CTop):
    """Another name of a type: `typedef type name;`."""

    type: str
    name: str
    comment: str = ""


@dataclass(frozen=True)
class FunctionDef(CTop):
    """A function; `doc` is the comment above it. An inline one need not be called (soter.h)."""

    result: str
    name: str
    parameters: tuple[tuple[str, str], ...]
    body: tuple[CStmt, ...] | None
    doc: str = ""
    static: bool = True
    inline: bool = False


@dataclass(frozen=True)
class VariableDef(CTop):
    """A static const object, or an extern declaration (value None)."""

    type: str
    name: str
    value: CExpr | None
    array: bool = False
    static: bool = True
    comment: str = ""


@dataclass(frozen=True)
class TableDef(CTop):
    """A static const union of a value and its bytes: a table, by which compilers are not slowed."""

    type: str
    name: str
    image: bytes


def address(e: CExpr) -> CExpr:
    """Where something lies that has an address; of one of two things, that one's."""
    if isinstance(e, Unary) and e.op == "*":
        return e.operand
    if isinstance(e, Ternary):
        return Ternary(e.condition, address(e.then), address(e.otherwise))
    return Unary("&", e)


_NAME = re.compile(r"[A-Za-z_]\w*")


def names_read(root: object) -> Iterator[str]:
    """Names that a piece of C reads, in order; one that is only assigned to is not read."""
    stack = [root]
    while stack:
        node = stack.pop()
        if isinstance(node, Name):
            yield from _NAME.findall(node.text)
        elif isinstance(node, Assign):
            target: CExpr = node.target
            stack.append(node.value)
            inner: list[CExpr] = []
            while isinstance(target, (Member, IndexExpr)):
                inner += [target.index] if isinstance(target, IndexExpr) else []
                target = target.target
            inner += [] if isinstance(target, Name) else [target]
            stack.extend(reversed(inner))
        elif isinstance(node, tuple):
            stack.extend(reversed(node))
        elif isinstance(node, (CExpr, CStmt)):
            stack.extend(reversed(vars(node).values()))


@dataclass(frozen=True)
class CFile:
    """A translation unit or header."""

    items: tuple[CTop, ...] = field(default=())

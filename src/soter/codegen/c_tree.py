"""A small syntax tree for C99, and bit masks in place of an `if` between two whole numbers.

Purpose: the nodes that the back end builds and `c_printer.py` prints; nothing pastes text together.
`without_branches` speeds up the C of campaigns: in a binary search the processor mispredicts every
second branch. The numbers that are computed stay the same.
Non-goals: C that generated programs do not need; masks in C that ships, which people read, or for
an `if` that does more than assign one number a side.
"""

from __future__ import annotations

import re
from dataclasses import field, replace
from typing import TYPE_CHECKING

from soter.language.syntax.node import Node, field_values, node

if TYPE_CHECKING:
    from collections.abc import Iterator


# ---------------------------------------------------------------- expressions


@node()
class CExpr(Node):
    """Any C expression."""


@node()
class Name(CExpr):
    """An identifier or a macro constant."""

    text: str


@node()
class Number(CExpr):
    """A literal, already spelled as C."""

    text: str


@node()
class String(CExpr):
    """A string literal; the printer escapes it."""

    value: str


@node()
class Unary(CExpr):
    """Prefix operator: - ! & *."""

    op: str
    operand: CExpr


@node()
class Binary(CExpr):
    """Infix operator."""

    op: str
    left: CExpr
    right: CExpr


@node()
class Ternary(CExpr):
    """A choice: c ? a : b."""

    condition: CExpr
    then: CExpr
    otherwise: CExpr


@node()
class CallExpr(CExpr):
    """A call: f(a, b)."""

    function: str
    arguments: tuple[CExpr, ...]


@node()
class Member(CExpr):
    """A member: target.name, or pointer->name if the target is `*pointer`."""

    target: CExpr
    name: str


@node()
class Arrow(CExpr):
    """A member through a pointer: target->name."""

    target: CExpr
    name: str


@node()
class IndexExpr(CExpr):
    """An element: target[index]."""

    target: CExpr
    index: CExpr


@node()
class Cast(CExpr):
    """A cast: (type)operand."""

    type: str
    operand: CExpr


@node()
class Initializer(CExpr):
    """An initializer { .a = 1, .b = 2 } or { 1, 2 }; with a type, a compound literal."""

    items: tuple[tuple[str | None, CExpr], ...]
    type: str | None = None


def named_fields(**values: CExpr) -> Initializer:
    """An initializer that sets these members of a struct to these values, in this order."""
    return Initializer(tuple(values.items()))


# ---------------------------------------------------------------- statements


@node()
class CStmt(Node):
    """Any C statement."""


@node()
class Declare(CStmt):
    """A declaration: `type name = value;`."""

    type: str
    name: str
    value: CExpr | None
    const: bool = False


@node()
class Assign(CStmt):
    """An assignment."""

    target: CExpr
    value: CExpr


@node()
class Do(CStmt):
    """An expression that is evaluated for its effect."""

    expression: CExpr


@node()
class Unused(CStmt):
    """Marks a name as unused on purpose: `(void)name;`; left out if the body reads the name."""

    name: str


@node()
class IfStmt(CStmt):
    """A branch: if (c) { ... } else { ... }."""

    condition: CExpr
    then: tuple[CStmt, ...]
    otherwise: tuple[CStmt, ...] = ()


@node()
class For(CStmt):
    """A loop: for (int64_t name = low; name < high; name++) { ... }."""

    name: str
    low: CExpr
    high: CExpr
    body: tuple[CStmt, ...]


@node()
class Return(CStmt):
    """A return."""

    value: CExpr | None


@node()
class Comment(CStmt):
    """A line comment among statements."""

    text: str


# ---------------------------------------------------------------- top level


@node()
class CTop(Node):
    """Any item at file level."""


@node()
class FileComment(CTop):
    """A block comment."""

    lines: tuple[str, ...]


@node()
class Section(CTop):
    """A heading between groups of definitions."""

    title: str


@node()
class Include(CTop):
    """An #include; names of system headers stand in angle brackets."""

    path: str
    system: bool = False


@node()
class Guarded(CTop):
    """An include guard around all items after it."""

    macro: str


@node()
class Define(CTop):
    """A macro: #define name value."""

    name: str
    value: str


@node()
class StructMember(Node):
    """A member: `type name[length];`."""

    type: str
    name: str
    length: int | None = None
    comment: str = ""


@node()
class StructDef(CTop):
    """A named struct: `typedef struct { ... } name;`."""

    name: str
    members: tuple[StructMember, ...]
    comment: str = ""


@node()
class Alias(CTop):
    """Another name of a type: `typedef type name;`."""

    type: str
    name: str
    comment: str = ""


@node()
class FunctionDef(CTop):
    """A function; `doc` is the comment above it. An inline function may stay uncalled (soter.h)."""

    result: str
    name: str
    parameters: tuple[tuple[str, str], ...]
    body: tuple[CStmt, ...] | None
    doc: str = ""
    static: bool = True
    inline: bool = False


@node()
class VariableDef(CTop):
    """A static const object, or an extern declaration (value None)."""

    type: str
    name: str
    value: CExpr | None
    array: bool = False
    static: bool = True
    comment: str = ""


@node()
class TableDef(CTop):
    """A table as a static const union of a value and its bytes; compilers read bytes fast."""

    type: str
    name: str
    image: bytes
    bytewise: bool = False
    """Whether its elements are single bytes, which lie alike on every processor."""


def address_of(e: CExpr) -> CExpr:
    """The C of the address of `e`: `p` for `*p`, a choice of two for `c ? a : b`, else `&e`."""
    if isinstance(e, Unary) and e.op == "*":
        return e.operand
    if isinstance(e, Ternary):
        return Ternary(e.condition, address_of(e.then), address_of(e.otherwise))
    return Unary("&", e)


_NAME = re.compile(r"[A-Za-z_]\w*")


def names_read(root: object) -> Iterator[str]:
    """Yields the names that a piece of C reads, in order; leaves out names that it only assigns."""
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
            stack.extend(reversed(field_values(node)))


@node()
class CFile(Node):
    """A translation unit or header."""

    items: tuple[CTop, ...] = field(default=())


INT64 = "int64_t"


def without_branches(f: FunctionDef) -> FunctionDef:
    """The function with bit masks for each `if` whose sides assign one int64_t each."""
    if f.body is None:
        return f
    names = {s.name for s in _statements_in(f.body) if isinstance(s, Declare) and s.type == INT64}
    return replace(f, body=tuple(_MaskRewriter(names).rewritten_block(f.body)))


def _statements_in(block: tuple[CStmt, ...]) -> Iterator[CStmt]:
    for s in block:
        yield s
        if isinstance(s, For):
            yield from _statements_in(s.body)
        elif isinstance(s, IfStmt):
            yield from _statements_in((*s.then, *s.otherwise))


class _MaskRewriter:
    """Replaces `if` statements of one function by masks, and numbers the masks."""

    def __init__(self, int64_names: set[str]) -> None:
        self._int64_names = int64_names
        self._count = 0

    def rewritten_block(self, block: tuple[CStmt, ...]) -> Iterator[CStmt]:
        """Yields the statements of a block, with masks in place of each `if` that allows it."""
        for s in block:
            if isinstance(s, For):
                yield replace(s, body=tuple(self.rewritten_block(s.body)))
            elif isinstance(s, IfStmt):
                yield from self._with_masks(s)
            else:
                yield s

    def _with_masks(self, s: IfStmt) -> Iterator[CStmt]:
        then, otherwise = self._sole_assignment(s.then), self._sole_assignment(s.otherwise)
        if then is None or otherwise is None:
            sides = (tuple(self.rewritten_block(side)) for side in (s.then, s.otherwise))
            yield IfStmt(s.condition, *sides)
            return
        self._count += 1
        on = Name(f"given_mask_{self._count}")
        off = Unary("~", on)
        yield Declare(INT64, on.text, Unary("-", Cast(INT64, s.condition)), const=True)
        for side, chosen_here, elsewhere in ((then, on, off), (otherwise, off, on)):
            taken, left = Binary("&", side.value, chosen_here), Binary("&", side.target, elsewhere)
            yield Assign(side.target, Binary("|", taken, left))

    def _sole_assignment(self, side: tuple[CStmt, ...]) -> Assign | None:
        """The only statement of a side, if it assigns one int64_t local to another; else None."""
        (made, *more) = side or (None,)
        if more or not isinstance(made, Assign):
            return None
        names = [x for x in (made.target, made.value) if isinstance(x, Name)]
        return made if len(names) == 2 and {x.text for x in names} <= self._int64_names else None

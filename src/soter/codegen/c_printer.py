"""Prints the tree of C as text.

Purpose: C99 that a person can read, with just the parentheses that precedence and compilers'
warnings ask for.
Non-goals: choosing what to print.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c

if TYPE_CHECKING:
    from collections.abc import Iterator


WIDTH = 100
ROW_BYTES = 512
"""Bytes of a table in one string; C99 promises that a string may have 4095."""
QUIET_ROWS = (
    "#if defined __clang__ ? __clang_major__ >= 21 : __GNUC__ >= 15",
    '#pragma GCC diagnostic ignored "-Wunterminated-string-initialization"',
    "#endif",
)
"""Silences a warning: the rows of a table have no zero at their end, on purpose."""
PRECEDENCE = {
    "||": 1,
    "&&": 2,
    "|": 3,
    "^": 4,
    "&": 5,
    "==": 6,
    "!=": 6,
    "<": 7,
    "<=": 7,
    ">": 7,
    ">=": 7,
    "<<": 8,
    ">>": 8,
    "+": 9,
    "-": 9,
    "*": 10,
    "/": 10,
    "%": 10,
}
LINKAGE = ("#ifdef __cplusplus", 'extern "C" {', "#endif")
END_OF_LINKAGE = ("#ifdef __cplusplus", "}", "#endif", "")
TERNARY, UNARY, POSTFIX, ATOM = 0, 11, 12, 13
COMPARISONS = {"==", "!=", "<", "<=", ">", ">="}
BITS = {"|", "^", "&", "<<", ">>"}


def precedence(e: c.CExpr) -> int:
    """How tightly the outermost operator binds."""
    if isinstance(e, c.Binary):
        return PRECEDENCE[e.op]
    if isinstance(e, c.Ternary):
        return TERNARY
    if isinstance(e, c.Number) and e.text.startswith("-"):
        return UNARY
    if isinstance(e, (c.Unary, c.Cast)):
        return UNARY
    if isinstance(e, (c.Member, c.Arrow, c.IndexExpr, c.CallExpr)):
        return POSTFIX
    return ATOM


def expr(e: c.CExpr) -> str:
    """One expression on one line."""
    if isinstance(e, (c.Name, c.Number)):
        return e.text
    if isinstance(e, c.String):
        return '"' + escape(e.value) + '"'
    if isinstance(e, c.Unary):
        inner = wrap(e.operand, UNARY)
        return f"{e.op}({inner})" if e.op == "-" and inner.startswith("-") else e.op + inner
    if isinstance(e, c.Binary):
        return _binary(e)
    if isinstance(e, c.Ternary):
        condition = wrap(e.condition, TERNARY + 1)
        return f"{condition} ? {wrap(e.then, TERNARY + 1)} : {wrap(e.otherwise, TERNARY + 1)}"
    if isinstance(e, (c.Member, c.Arrow, c.IndexExpr, c.CallExpr)):
        return _postfix(e)
    if isinstance(e, c.Cast):
        return f"({e.type}){wrap(e.operand, UNARY)}"
    assert isinstance(e, c.Initializer)
    items = ", ".join(f".{n} = {expr(v)}" if n else expr(v) for n, v in e.items)
    prefix = f"({e.type})" if e.type else ""
    return f"{prefix}{{{items or '0'}}}"


def _postfix(e: c.Member | c.Arrow | c.IndexExpr | c.CallExpr) -> str:
    if isinstance(e, c.CallExpr):
        return f"{e.function}({', '.join(expr(a) for a in e.arguments)})"
    if isinstance(e, c.IndexExpr):
        return f"{wrap(e.target, POSTFIX)}[{expr(e.index)}]"
    if isinstance(e, c.Member):
        if isinstance(e.target, c.Unary) and e.target.op == "*":
            return f"{wrap(e.target.operand, POSTFIX)}->{e.name}"
        return f"{wrap(e.target, POSTFIX)}.{e.name}"
    return f"{wrap(e.target, POSTFIX)}->{e.name}"


def wrap(e: c.CExpr, minimum: int) -> str:
    """An operand, in parentheses when it binds too loosely."""
    text = expr(e)
    return f"({text})" if precedence(e) < minimum else text


def _binary(e: c.Binary) -> str:
    level = PRECEDENCE[e.op]

    def side(x: c.CExpr, minimum: int) -> str:
        text = expr(x)
        loose = precedence(x) < minimum
        if isinstance(x, c.Binary):
            mixed_logic = {e.op, x.op} == {"&&", "||"}
            compared = e.op in COMPARISONS and x.op in COMPARISONS
            bits = e.op in BITS and x.op != e.op
            loose = loose or mixed_logic or compared or bits
        if isinstance(x, c.Unary) and x.op == "!":
            loose = loose or e.op in COMPARISONS
        return f"({text})" if loose else text

    return f"{side(e.left, level)} {e.op} {side(e.right, level + 1)}"


def escape(text: str) -> str:
    """The inside of a C string literal."""
    out = []
    for ch in text:
        if ch in '"\\':
            out.append("\\" + ch)
        elif " " <= ch <= "~" and ch != "?":
            out.append(ch)
        else:
            out.append("".join(f"\\{b:03o}" for b in ch.encode("utf-8")))
    return "".join(out)


def comment_text(text: str) -> str:
    """Text made safe inside a block comment."""
    return text.replace("*/", "* /").replace("\n", " ")


# ---------------------------------------------------------------- statements


def statements(body: tuple[c.CStmt, ...], depth: int) -> Iterator[str]:
    """Yields the lines inside a block at a depth of indentation."""
    pad = "  " * depth
    for s in body:
        if isinstance(s, c.Declare):
            qualifier = "const " if s.const else ""
            value = f" = {expr(s.value)}" if s.value is not None else ""
            yield from broken(f"{pad}{qualifier}{declarator(s.type, s.name)}{value};", depth)
        elif isinstance(s, c.Assign):
            yield from broken(f"{pad}{expr(s.target)} = {expr(s.value)};", depth)
        elif isinstance(s, c.Do):
            yield from broken(f"{pad}{expr(s.expression)};", depth)
        elif isinstance(s, c.Unused):
            yield f"{pad}(void){s.name};"
        elif isinstance(s, c.IfStmt):
            yield from _if(s, depth, pad)
        elif isinstance(s, c.For):
            low, high = expr(s.low), expr(s.high)
            yield f"{pad}for (int64_t {s.name} = {low}; {s.name} < {high}; {s.name}++) {{"
            yield from statements(s.body, depth + 1)
            yield f"{pad}}}"
        elif isinstance(s, c.Return):
            yield from broken(
                f"{pad}return {expr(s.value)};" if s.value is not None else f"{pad}return;", depth
            )
        else:
            assert isinstance(s, c.Comment)
            yield f"{pad}/* {comment_text(s.text)} */"


def _if(s: c.IfStmt, depth: int, pad: str, lead: str = "") -> Iterator[str]:
    yield from broken(f"{pad}{lead}if ({expr(s.condition)}) {{", depth)
    yield from statements(s.then, depth + 1)
    if len(s.otherwise) == 1 and isinstance(s.otherwise[0], c.IfStmt):
        yield from _if(s.otherwise[0], depth, pad, "} else ")
        return
    if s.otherwise:
        yield f"{pad}}} else {{"
        yield from statements(s.otherwise, depth + 1)
    yield f"{pad}}}"


def declarator(type_: str, name: str) -> str:
    """`double x`, `const char *p`: a space unless the type ends in a star."""
    return type_ + name if type_.endswith(("*", " ")) else f"{type_} {name}"


def broken(line: str, depth: int) -> Iterator[str]:
    """Yields a long line broken at spaces outside strings; the line may be megabytes long."""
    pad = "  " * depth + "    "
    begin, at = "", 0
    while len(begin) + len(line) - at > WIDTH:
        cut = _break_in(begin, line, at)
        if cut < 0:
            break
        yield (begin + line[at:cut]).rstrip()
        begin, at = pad, cut
        while at < len(line) and line[at] == " ":
            at += 1
    yield begin + line[at:]


def _break_in(begin: str, line: str, at: int) -> int:
    """The place in `line` to break the text `begin` + `line[at:]`; -1 if there is none."""
    size = 2 * WIDTH
    while True:
        cut, sure = _break_at(begin + line[at : at + size])
        if sure or at + size >= len(line):
            return -1 if cut < 0 else at + cut - len(begin)
        size *= 2


def _break_at(line: str) -> tuple[int, bool]:
    """Finds the last space before WIDTH, past the indent and outside strings; -1 for none.

    The second value says that this holds whatever follows `line`.
    """
    start = len(line) - len(line.lstrip()) + 8
    inside, best = False, -1
    for i, ch in enumerate(line):
        if ch == '"' and (i == 0 or line[i - 1] != "\\"):
            inside = not inside
        if ch == " " and not inside and i > start:
            if i > WIDTH:
                return (best if best > 0 else i), True
            best = i
    return best, False


# ---------------------------------------------------------------- top level


def print_file(file: c.CFile) -> str:
    """The whole text of a file."""
    lines: list[str] = []
    guard = ""
    previous: c.CTop | None = None
    last = max((i for i, x in enumerate(file.items) if isinstance(x, c.Include)), default=-1)
    for i, item in enumerate(file.items):
        if isinstance(item, c.Guarded):
            guard = item.macro
            lines += [f"#ifndef {guard}", f"#define {guard}", ""]
            previous = None
            continue
        block = list(top(item))
        if previous is not None and (len(block) > 1 or type(item) is not type(previous)):
            lines.append("")
        lines += block
        previous = item
        if guard and i == last:
            lines += ["", *LINKAGE]
    if guard:
        lines += ["", *(END_OF_LINKAGE if last >= 0 else ()), "#endif"]
    return "\n".join(lines) + "\n"


def top(item: c.CTop) -> Iterator[str]:
    """Lines of one top-level item."""
    if isinstance(item, c.FileComment):
        yield "/* " + comment_text(item.lines[0])
        yield from (" * " + comment_text(x) if x else " *" for x in item.lines[1:])
        yield " */"
    elif isinstance(item, c.Section):
        yield f"/* {'-' * 66} {comment_text(item.title)} */"
    elif isinstance(item, c.Include):
        yield f"#include <{item.path}>" if item.system else f'#include "{item.path}"'
    elif isinstance(item, c.Define):
        yield f"#define {item.name} {item.value}"
    elif isinstance(item, c.StructDef):
        yield from _struct(item)
    elif isinstance(item, c.Alias):
        comment = f" /* {comment_text(item.comment)} */" if item.comment else ""
        yield f"typedef {declarator(item.type, item.name)};{comment}"
    elif isinstance(item, c.FunctionDef):
        yield from _function(item)
    elif isinstance(item, c.TableDef):
        yield from _table(item)
    else:
        assert isinstance(item, c.VariableDef)
        yield from _variable(item)


def _struct(item: c.StructDef) -> Iterator[str]:
    if item.comment:
        yield f"/* {comment_text(item.comment)} */"
    yield "typedef struct {"
    yield from (member(m, 1) for m in item.members)
    yield f"}} {item.name};"


def member(m: c.StructMember, depth: int) -> str:
    """One struct member."""
    length = f"[{m.length}]" if m.length is not None else ""
    comment = f" /* {comment_text(m.comment)} */" if m.comment else ""
    return f"{'  ' * depth}{declarator(m.type, m.name)}{length};{comment}"


def _function(item: c.FunctionDef) -> Iterator[str]:
    if item.doc:
        yield f"/* {comment_text(item.doc)} */"
    prefix = "SOTER_INLINE " if item.inline else "static " if item.static else ""
    parameters = ", ".join(declarator(t, n) for t, n in item.parameters) or "void"
    head = f"{prefix}{declarator(item.result, item.name)}({parameters})"
    if item.body is None:
        yield from broken(head + ";", 0)
        return
    yield from broken(head + " {", 0)
    read = set(c.names_read(item.body))
    body = tuple(s for s in item.body if not (isinstance(s, c.Unused) and s.name in read))
    yield from statements(body, 1)
    yield "}"


def _table(item: c.TableDef) -> Iterator[str]:
    """Prints a table as short strings, which compilers read fast and standard C allows."""
    rows = -(-len(item.image) // ROW_BYTES)
    image = memoryview(item.image.ljust(rows * ROW_BYTES, b"\0"))
    yield "/* its bytes, little-endian: numbers would take compilers minutes */"
    if not item.bytewise:
        yield "#if defined __BYTE_ORDER__ && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__"
        yield '#error "a table of this program is for little-endian processors"'
        yield "#endif"
    yield from QUIET_ROWS
    yield "static const union {"
    yield f"  char bytes[{rows}][{ROW_BYTES}];"
    yield f"  {declarator(item.type, 'value')};"
    yield f"}} {item.name} = {{{{"
    texts = _text_of_bytes()
    for at in range(0, len(image), ROW_BYTES):
        yield f'"{"".join(map(texts.__getitem__, image[at : at + ROW_BYTES]))}",'
    yield "}};"


@lru_cache(maxsize=1)
def _text_of_bytes() -> tuple[str, ...]:
    """Each byte inside a string of C; `?` might begin a trigraph."""
    shown = [chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in range(256)]
    return tuple(shown)


def _variable(item: c.VariableDef) -> Iterator[str]:
    if item.comment:
        yield f"/* {comment_text(item.comment)} */"
    array = "[]" if item.array else ""
    if item.value is None:
        yield f"extern const {declarator(item.type, item.name)}{array};"
        return
    storage = "static " if item.static else ""
    head = f"{storage}const {declarator(item.type, item.name)}{array} ="
    if isinstance(item.value, c.Initializer) and item.value.items:
        yield head + " {"
        for name, value in item.value.items:
            text = f"  .{name} = {expr(value)}," if name else f"  {expr(value)},"
            yield from broken(text, 1)
        yield "};"
    else:
        yield from broken(f"{head} {expr(item.value)};", 0)

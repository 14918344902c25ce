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
"""Bytes of a table in one string; in C99 a string may always have 4095."""
QUIET_ROWS = (
    "#if defined __clang__ ? __clang_major__ >= 21 : __GNUC__ >= 15",
    '#pragma GCC diagnostic ignored "-Wunterminated-string-initialization"',
    "#endif",
)
"""Silences a warning: the rows of a table have no zero at their end, on purpose."""
LEVELS = ("||", "&&", "|", "^", "&", "== !=", "< <= > >=", "<< >>", "+ -", "* / %")
PRECEDENCE = {op: level for level, ops in enumerate(LEVELS, 1) for op in ops.split()}
LINKAGE = ("#ifdef __cplusplus", 'extern "C" {', "#endif")
END_OF_LINKAGE = ("#ifdef __cplusplus", "}", "#endif", "")
TERNARY, UNARY, POSTFIX, ATOM = 0, 11, 12, 13
COMPARISONS = {"==", "!=", "<", "<=", ">", ">="}
BITS = {"|", "^", "&", "<<", ">>"}


def precedence(e: c.CExpr) -> int:
    """How tightly the outermost operator of an expression binds."""
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


def expr_text(e: c.CExpr) -> str:
    """The text of an expression, on one line."""
    if isinstance(e, (c.Name, c.Number)):
        return e.text
    if isinstance(e, c.String):
        return '"' + string_text(e.value) + '"'
    if isinstance(e, c.Unary):
        inner = operand_text(e.operand, UNARY)
        return f"{e.op}({inner})" if e.op == "-" and inner.startswith("-") else e.op + inner
    if isinstance(e, c.Binary):
        return _binary_text(e)
    if isinstance(e, c.Ternary):
        condition = operand_text(e.condition, TERNARY + 1)
        then = operand_text(e.then, TERNARY + 1)
        return f"{condition} ? {then} : {operand_text(e.otherwise, TERNARY + 1)}"
    if isinstance(e, (c.Member, c.Arrow, c.IndexExpr, c.CallExpr)):
        return _postfix_text(e)
    if isinstance(e, c.Cast):
        return f"({e.type}){operand_text(e.operand, UNARY)}"
    assert isinstance(e, c.Initializer)
    items = ", ".join(f".{n} = {expr_text(v)}" if n else expr_text(v) for n, v in e.items)
    prefix = f"({e.type})" if e.type else ""
    return f"{prefix}{{{items or '0'}}}"


def _postfix_text(e: c.Member | c.Arrow | c.IndexExpr | c.CallExpr) -> str:
    if isinstance(e, c.CallExpr):
        return f"{e.function}({', '.join(expr_text(a) for a in e.arguments)})"
    if isinstance(e, c.IndexExpr):
        return f"{operand_text(e.target, POSTFIX)}[{expr_text(e.index)}]"
    if isinstance(e, c.Member):
        if isinstance(e.target, c.Unary) and e.target.op == "*":
            return f"{operand_text(e.target.operand, POSTFIX)}->{e.name}"
        return f"{operand_text(e.target, POSTFIX)}.{e.name}"
    return f"{operand_text(e.target, POSTFIX)}->{e.name}"


def operand_text(e: c.CExpr, minimum: int) -> str:
    """The text of an operand, in parentheses if it binds more loosely than `minimum`."""
    text = expr_text(e)
    return f"({text})" if precedence(e) < minimum else text


def _binary_text(e: c.Binary) -> str:
    level = PRECEDENCE[e.op]

    def side_text(x: c.CExpr, minimum: int) -> str:
        text = expr_text(x)
        loose = precedence(x) < minimum
        if isinstance(x, c.Binary):
            mixed_logic = {e.op, x.op} == {"&&", "||"}
            compared = e.op in COMPARISONS and x.op in COMPARISONS
            bits = e.op in BITS and x.op != e.op
            loose = loose or mixed_logic or compared or bits
        if isinstance(x, c.Unary) and x.op == "!":
            loose = loose or e.op in COMPARISONS
        return f"({text})" if loose else text

    return f"{side_text(e.left, level)} {e.op} {side_text(e.right, level + 1)}"


def string_text(text: str) -> str:
    """The inside of the C string literal for `text`."""
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
    """The text, changed so that it cannot end a C comment."""
    return text.replace("*/", "* /").replace("\n", " ")


# ---------------------------------------------------------------- statements


def statement_lines(body: tuple[c.CStmt, ...], depth: int) -> Iterator[str]:
    """Yields the lines of statements, indented by `depth` levels."""
    pad = "  " * depth
    for s in body:
        if isinstance(s, c.Declare):
            qualifier = "const " if s.const else ""
            value = f" = {expr_text(s.value)}" if s.value is not None else ""
            yield from wrapped_lines(
                f"{pad}{qualifier}{declaration_text(s.type, s.name)}{value};", depth
            )
        elif isinstance(s, c.Assign):
            yield from wrapped_lines(f"{pad}{expr_text(s.target)} = {expr_text(s.value)};", depth)
        elif isinstance(s, c.Do):
            yield from wrapped_lines(f"{pad}{expr_text(s.expression)};", depth)
        elif isinstance(s, c.Unused):
            yield f"{pad}(void){s.name};"
        elif isinstance(s, c.IfStmt):
            yield from _if_lines(s, depth, pad)
        elif isinstance(s, c.For):
            low, high = expr_text(s.low), expr_text(s.high)
            yield f"{pad}for (int64_t {s.name} = {low}; {s.name} < {high}; {s.name}++) {{"
            yield from statement_lines(s.body, depth + 1)
            yield f"{pad}}}"
        elif isinstance(s, c.Return):
            yield from wrapped_lines(
                f"{pad}return {expr_text(s.value)};" if s.value is not None else f"{pad}return;",
                depth,
            )
        else:
            assert isinstance(s, c.Comment)
            yield f"{pad}/* {comment_text(s.text)} */"


def _if_lines(s: c.IfStmt, depth: int, pad: str, lead: str = "") -> Iterator[str]:
    yield from wrapped_lines(f"{pad}{lead}if ({expr_text(s.condition)}) {{", depth)
    yield from statement_lines(s.then, depth + 1)
    if len(s.otherwise) == 1 and isinstance(s.otherwise[0], c.IfStmt):
        yield from _if_lines(s.otherwise[0], depth, pad, "} else ")
        return
    if s.otherwise:
        yield f"{pad}}} else {{"
        yield from statement_lines(s.otherwise, depth + 1)
    yield f"{pad}}}"


def declaration_text(type_: str, name: str) -> str:
    """A type and a name, as `double x` or `const char *p`: no space after a star."""
    return type_ + name if type_.endswith(("*", " ")) else f"{type_} {name}"


def wrapped_lines(line: str, depth: int) -> Iterator[str]:
    """Yields the lines of a long line, wrapped at spaces outside of strings."""
    pad = "  " * depth + "    "
    begin, at = "", 0
    while len(begin) + len(line) - at > WIDTH:
        cut = _break_place(begin, line, at)
        if cut < 0:
            break
        yield (begin + line[at:cut]).rstrip()
        begin, at = pad, cut
        while at < len(line) and line[at] == " ":
            at += 1
    yield begin + line[at:]


def _break_place(begin: str, line: str, at: int) -> int:
    """The index in `line` at which to wrap `begin` + `line[at:]`; -1 if it cannot be wrapped."""
    size = 2 * WIDTH
    while True:
        cut, sure = _last_space(begin + line[at : at + size])
        if sure or at + size >= len(line):
            return -1 if cut < 0 else at + cut - len(begin)
        size *= 2


def _last_space(line: str) -> tuple[int, bool]:
    """The index of the last space before WIDTH, behind the indent, outside of strings; else -1.

    The second value is true if the index is the same for every text that begins with `line`.
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
    """The whole text of a C file."""
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
        block = list(item_lines(item))
        if previous is not None and (len(block) > 1 or type(item) is not type(previous)):
            lines.append("")
        lines += block
        previous = item
        if guard and i == last:
            lines += ["", *LINKAGE]
    if guard:
        lines += ["", *(END_OF_LINKAGE if last >= 0 else ()), "#endif"]
    return "\n".join(lines) + "\n"


def item_lines(item: c.CTop) -> Iterator[str]:
    """Yields the lines of one item at file level."""
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
        yield from _struct_lines(item)
    elif isinstance(item, c.Alias):
        comment = f" /* {comment_text(item.comment)} */" if item.comment else ""
        yield f"typedef {declaration_text(item.type, item.name)};{comment}"
    elif isinstance(item, c.FunctionDef):
        yield from _function_lines(item)
    elif isinstance(item, c.TableDef):
        yield from _table_lines(item)
    else:
        assert isinstance(item, c.VariableDef)
        yield from _variable_lines(item)


def _struct_lines(item: c.StructDef) -> Iterator[str]:
    if item.comment:
        yield f"/* {comment_text(item.comment)} */"
    yield "typedef struct {"
    yield from (member_line(m, 1) for m in item.members)
    yield f"}} {item.name};"


def member_line(m: c.StructMember, depth: int) -> str:
    """The line of one struct member."""
    length = f"[{m.length}]" if m.length is not None else ""
    comment = f" /* {comment_text(m.comment)} */" if m.comment else ""
    return f"{'  ' * depth}{declaration_text(m.type, m.name)}{length};{comment}"


def _function_lines(item: c.FunctionDef) -> Iterator[str]:
    if item.doc:
        yield f"/* {comment_text(item.doc)} */"
    prefix = "SOTER_INLINE " if item.inline else "static " if item.static else ""
    parameters = ", ".join(declaration_text(t, n) for t, n in item.parameters) or "void"
    head = f"{prefix}{declaration_text(item.result, item.name)}({parameters})"
    if item.body is None:
        yield from wrapped_lines(head + ";", 0)
        return
    yield from wrapped_lines(head + " {", 0)
    read = set(c.names_read(item.body))
    body = tuple(s for s in item.body if not (isinstance(s, c.Unused) and s.name in read))
    yield from statement_lines(body, 1)
    yield "}"


def _table_lines(item: c.TableDef) -> Iterator[str]:
    """Yields a table as short strings, which compilers read fast and standard C allows."""
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
    yield f"  {declaration_text(item.type, 'value')};"
    yield f"}} {item.name} = {{{{"
    texts = _text_of_bytes()
    for at in range(0, len(image), ROW_BYTES):
        yield f'"{"".join(map(texts.__getitem__, image[at : at + ROW_BYTES]))}",'
    yield "}};"


@lru_cache(maxsize=1)
def _text_of_bytes() -> tuple[str, ...]:
    """Each byte as text in a C string; as a number if it is `?`, which might begin a trigraph."""
    shown = [chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in range(256)]
    return tuple(shown)


def _variable_lines(item: c.VariableDef) -> Iterator[str]:
    if item.comment:
        yield f"/* {comment_text(item.comment)} */"
    array = "[]" if item.array else ""
    if item.value is None:
        yield f"extern const {declaration_text(item.type, item.name)}{array};"
        return
    storage = "static " if item.static else ""
    head = f"{storage}const {declaration_text(item.type, item.name)}{array} ="
    if isinstance(item.value, c.Initializer) and item.value.items:
        yield head + " {"
        for name, value in item.value.items:
            text = f"  .{name} = {expr_text(value)}," if name else f"  {expr_text(value)},"
            yield from wrapped_lines(text, 1)
        yield "};"
    else:
        yield from wrapped_lines(f"{head} {expr_text(item.value)};", 0)

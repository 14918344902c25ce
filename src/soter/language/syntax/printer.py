"""Formats source text for `soter fmt`, and prints expressions for messages.

Purpose: `format_source` lays out the tokens of a file that parses. Only white space changes,
so the tree and the comments stay as they are. As with gofmt, the author of the text decides
where lines break and the printer decides the rest: two spaces a level, one space around
operators, at most one blank line, two spaces before a trailing comment. Lines over
`WIDTH_MAX` characters are broken, one-line blocks first, then at the outermost comma or the
loosest operator. The result is a fixed point: formatting it again changes nothing.
Non-goals: renaming, reordering, adding or removing any token; aligning columns.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, Source
from soter.language.syntax import tree
from soter.language.syntax.lexer import DURATION, EOF, FLOAT, INT, NAME, lex
from soter.language.syntax.parsing.parser import parse_tokens

if TYPE_CHECKING:
    from soter.language.syntax.lexer import Tokens
    from soter.language.syntax.parsing.parser import Parser

#: Lines longer than this are broken where they can be.
WIDTH_MAX = 100

_INDENT = 2  # of a block or an expanded bracket
_HANGING = 4  # of the further lines of one item
_PASSES_MAX = 8  # layouts until nothing changes; two are enough for nearly every file

_OPEN = frozenset("([{")
_CLOSE = frozenset(")]}")
_OPERATOR_LEVEL = {
    "?": 2, ":": 2, "||": 3, "&&": 4, "<": 5, "<=": 5, ">": 5, ">=": 5, "==": 5, "!=": 5,
    "+": 6, "-": 6, "*": 7, "/": 7, "%": 7,
}  # fmt: skip
_CLAUSE_WORDS = {
    "in", "max_age", "static", "within", "from", "leadsto", "by", "moves", "phase", "queue", "hold",
    "every", "at", "unit",
}  # fmt: skip
_ITEM_BOUNDARY, _AFTER_COMMA, _BEFORE_CLAUSE, _AFTER_ASSIGN, _ELSEWHERE = 0, 1, 2, 18, 99


def format_source(source: Source, diagnostics: Diagnostics) -> str | None:
    """Gives `source` in the standard layout; None if it has syntax errors, which it reports."""
    text = source.text
    for _ in range(_PASSES_MAX):
        pass_diagnostics = Diagnostics()
        current = Source(source.name, text)
        _, parser = parse_tokens(current, pass_diagnostics)
        if pass_diagnostics.has_errors:
            for problem in pass_diagnostics.items:
                diagnostics.add(problem)
            return None
        layout = _Layout(parser)
        result = layout.laid_out_text()
        if not layout.wrapped and result == text:
            break
        text = result
    return text if _has_same_tokens(source, text) else source.text


def _has_same_tokens(source: Source, text: str) -> bool:
    """Whether a text differs from a source in white space only, as a formatter must ensure."""
    before, after = lex(source), lex(Source(source.name, text))
    return before.texts == after.texts and _comment_texts(before) == _comment_texts(after)


def _comment_texts(tokens: Tokens) -> list[str]:
    return [_trimmed_comment(tokens.source.text[a:b]) for a, b in tokens.comments]


def _trimmed_comment(text: str) -> str:
    """Gives a comment without trailing white space and with plain line breaks."""
    return "\n".join(line.rstrip() for line in text.split("\n"))


# ---------------------------------------------------------------- layout


@dataclass(slots=True)
class _Element:
    """A token or a comment, and the line breaks before it in the source."""

    text: str
    kind: str  # of the token; "//" or "/*" for comments
    index: int  # of the token; -1 for comments
    breaks: int


@dataclass(slots=True)
class _OpenBracket:
    """A bracket that is open at the present element."""

    block: bool
    expanded: bool  # its contents begin on a new line
    content: int  # indentation of lines inside
    close: int  # indentation of its closing bracket where that begins a line


@dataclass(slots=True)
class _Piece:
    """An element as part of a line; `level` is the cost of a line break before it (0: best)."""

    space: str
    text: str
    level: int | None  # None: never
    hanging: int  # indentation if the line breaks here
    comment: bool = False
    block: str = ""  # "{" or "}" for the brackets of a block


@dataclass(slots=True)
class _Line:
    indent: int
    pieces: list[_Piece] = field(default_factory=list)
    blank_before: bool = False


class _Layout:
    """Lays out a file in one pass over its tokens and comments."""

    def __init__(self, parser: Parser) -> None:
        self.tokens = parser.tokens
        self.blocks = set(parser.opened)
        self.tight = set(parser.tight)
        self.spaced = set(parser.spaced)
        self.match = _closing_by_opening_bracket(self.tokens.kinds)
        self.frames: list[_OpenBracket] = []
        self.lines: list[_Line] = []
        self.wrapped = False
        self.boundary = True  # between two items, or at the beginning

    def laid_out_text(self) -> str:
        """Gives the text of the file in the canonical layout."""
        previous: _Element | None = None
        for element in self._elements_in_order():
            self._place_element(element, previous)
            if element.index >= 0:
                self._follow_brackets(element)
            previous = element
        texts: list[str] = []
        for line in self.lines:
            if line.blank_before:
                texts.append("")
            texts.extend(_line_text(part) for part in self._lines_within_width(line))
        return "\n".join(texts) + "\n" if texts else ""

    # ------------------------------------------------------------ elements

    def _elements_in_order(self) -> list[_Element]:
        tokens = self.tokens
        text = tokens.source.text
        places = [
            (start, end, index)
            for index, (start, end, kind) in enumerate(
                zip(tokens.starts, tokens.ends, tokens.kinds, strict=True)
            )
            if kind != EOF
        ]
        places += [(start, end, -1) for start, end in tokens.comments]
        places.sort()
        elements: list[_Element] = []
        at = 0
        for start, end, index in places:
            breaks = text.count("\n", at, start)
            if index >= 0:
                elements.append(_Element(tokens.texts[index], tokens.kinds[index], index, breaks))
            else:
                comment = _trimmed_comment(text[start:end])
                elements.append(_Element(comment, comment[:2], -1, breaks))
            at = end
        return elements

    def _follow_brackets(self, element: _Element) -> None:
        """Updates which brackets are open, and whether an item ends, after an element."""
        kind, index = element.kind, element.index
        base = self._base_indent()
        if kind in _OPEN:
            self.boundary = index in self.blocks
            self.frames.append(self._bracket_opened_at(index, base))
        elif kind in _CLOSE:
            self.boundary = self.frames.pop().block
        else:
            self.boundary = kind == ";" and not any(not f.block for f in self.frames)

    def _bracket_opened_at(self, index: int, base: int) -> _OpenBracket:
        if index in self.blocks:
            return _OpenBracket(True, self._is_broken_block(index), base + _INDENT, base)
        line = self.lines[-1].indent
        if self._is_broken_group(index):
            return _OpenBracket(False, True, line + _INDENT, line)
        inside = self.frames[-1].content if self.frames and not self.frames[-1].block else 0
        content = max(inside, base + _HANGING)
        return _OpenBracket(False, False, content, content)

    def _base_indent(self) -> int:
        for frame in reversed(self.frames):
            if frame.block:
                return frame.content
        return 0

    def _hanging_indent(self) -> int:
        if self.frames and not self.frames[-1].block:
            return self.frames[-1].content
        return self._base_indent() + _HANGING

    def _is_broken_block(self, index: int) -> bool:
        tokens = self.tokens
        close = self.match[index]
        inside = tokens.source.text[tokens.ends[index] : tokens.starts[close]]
        return "\n" in inside and bool(inside.strip())

    def _is_broken_group(self, index: int) -> bool:
        tokens = self.tokens
        return "\n" in tokens.source.text[tokens.ends[index] : tokens.starts[index + 1]]

    # ------------------------------------------------------------ placing

    def _place_element(self, element: _Element, previous: _Element | None) -> None:
        if previous is None:
            self._begin_line(0, blank=False)
            self._append(element, "", None)
            return
        opened = previous.index in self.blocks
        if element.index < 0:
            self._place_comment(element, previous, opened=opened)
        elif self.boundary:
            self._place_item(element, previous, opened=opened)
        else:
            self._place_inside(element, previous)

    def _place_comment(self, element: _Element, previous: _Element, *, opened: bool) -> None:
        if element.breaks == 0 and previous.kind != "//":
            space = "  " if element.kind == "//" else " "
            self._append(element, space, None)
            return
        blank = self.boundary and element.breaks > 1 and not opened
        indent = self._base_indent() if self.boundary else self._hanging_indent()
        self._begin_line(indent, blank=blank)
        self._append(element, "", None)

    def _place_item(self, element: _Element, previous: _Element, *, opened: bool) -> None:
        closing = element.kind == "}"
        commented = previous.kind == "//"
        if closing:
            frame = self.frames[-1]
            if frame.expanded or commented:
                self._begin_line(frame.close, blank=False)
                self._append(element, "", None)
            else:
                self._append(element, " ", _ITEM_BOUNDARY)
            return
        if element.kind in ("else", "elseif") and previous.kind == "}":
            self._append(element, " ", None)
            return
        top_level = not self.frames and previous.index >= 0
        fresh = self.frames[-1].expanded if opened else top_level or element.breaks > 0
        if fresh or commented:
            self._begin_line(self._base_indent(), blank=element.breaks > 1 and not opened)
            self._append(element, "", None)
        else:
            self._append(element, " ", _ITEM_BOUNDARY)

    def _place_inside(self, element: _Element, previous: _Element) -> None:
        space = self._space_between(element, previous)
        frame = self.frames[-1] if self.frames else None
        group = frame is not None and not frame.block
        fresh = previous.kind == "//"
        indent = self._hanging_indent()
        if group and frame is not None and frame.expanded:
            if element.kind in _CLOSE:
                fresh, indent = True, frame.close
            elif previous.kind in _OPEN:
                fresh = True
        if element.breaks and space and element.index not in self.blocks:
            fresh = fresh or (element.kind not in _CLOSE and previous.kind not in _OPEN)
        if fresh:
            self._begin_line(indent, blank=False)
            self._append(element, "", None)
        else:
            self._append(element, space, self._break_level(element, previous) if space else None)

    def _begin_line(self, indent: int, *, blank: bool) -> None:
        self.lines.append(_Line(indent, [], blank and bool(self.lines)))

    def _append(self, element: _Element, space: str, level: int | None) -> None:
        hanging = self._base_indent() if self.boundary else self._hanging_indent()
        piece = _Piece(space, element.text, level, hanging, element.index < 0)
        if element.index in self.blocks:
            piece.block = "{"
        elif element.kind == "}" and self.frames and self.frames[-1].block:
            piece.block = "}"
            piece.hanging = self.frames[-1].close
        self.lines[-1].pieces.append(piece)

    def _break_level(self, element: _Element, previous: _Element) -> int:
        """Gives the cost of a break here: lower with fewer open brackets and looser operators."""
        depth = sum(not f.block for f in self.frames) * 10
        if previous.kind == ",":
            return depth + _AFTER_COMMA
        if element.kind in _OPERATOR_LEVEL and element.index not in self.tight:
            return depth + _OPERATOR_LEVEL[element.kind]
        if element.text in _CLAUSE_WORDS:
            return depth + _BEFORE_CLAUSE
        return depth + (_AFTER_ASSIGN if previous.kind == "=" else _ELSEWHERE)

    def _space_between(self, element: _Element, previous: _Element) -> str:
        """Gives the space between two elements of one line inside an item: "" or " "."""
        kind, before, index = element.kind, previous.kind, previous.index
        if index < 0:
            return " "
        if kind == "." and before in (INT, FLOAT, DURATION):
            return " "  # `1.x` would be a malformed number
        if kind in (";", ",", ")", "]", ".", "..") or before in ("(", "[", ".", ".."):
            return ""
        if kind == ":":
            return " " if element.index in self.spaced else ""
        if before in ("-", "!") and index in self.tight:
            return ""
        if kind in ("(", "["):
            return "" if self._has_no_space_before(element, previous) else " "
        if before == "<=" and self.tokens.kinds[index - 1] == "[":
            return ""
        return " "

    def _has_no_space_before(self, bracket: _Element, previous: _Element) -> bool:
        """Whether no space separates a bracket from the element before it, as in a call."""
        if bracket.index in self.tight:
            return True
        fun = self.tokens.kinds[previous.index - 1] == "fun"
        return previous.kind == NAME and bracket.kind == "(" and fun

    # ------------------------------------------------------------ long lines

    def _lines_within_width(self, line: _Line) -> list[_Line]:
        """Gives the line, or the shorter lines into which it is broken."""
        if _line_width(line) <= WIDTH_MAX:
            return [line]
        parts = _lines_of_blocks(line)
        if len(parts) > 1:
            self.wrapped = True
            return parts
        parts = []
        while _line_width(line) > WIDTH_MAX:
            at = _best_break_index(line)
            if at is None:
                break
            self.wrapped = True
            rest = line.pieces[at:]
            rest[0].space = ""
            parts.append(_Line(line.indent, line.pieces[:at]))
            line = _Line(rest[0].hanging, rest)
        return [*parts, line]


def _closing_by_opening_bracket(kinds: list[str]) -> dict[int, int]:
    """Maps each opening bracket to its closing bracket, both as indices of tokens."""
    stack: list[int] = []
    match: dict[int, int] = {}
    for index, kind in enumerate(kinds):
        if kind in _OPEN:
            stack.append(index)
        elif kind in _CLOSE and stack:
            match[stack.pop()] = index
    return match


def _line_text(line: _Line) -> str:
    return " " * line.indent + "".join(piece.space + piece.text for piece in line.pieces)


def _line_width(line: _Line) -> int:
    """Gives how many characters a line has, without comments at its end."""
    pieces = line.pieces
    last = len(pieces)
    while last > 1 and pieces[last - 1].comment:
        last -= 1
    return line.indent + sum(len(p.space) + len(p.text) for p in pieces[:last])


def _lines_of_blocks(line: _Line) -> list[_Line]:
    """Gives lines for a line that holds whole blocks: each item of a block on its own line."""
    pieces = line.pieces
    breaks: set[int] = set()
    stack: list[int] = []
    boundaries: list[list[int]] = [[]]
    for index, piece in enumerate(pieces):
        if piece.block == "}" and stack:
            opening = stack.pop()
            inside = boundaries.pop()
            if not stack and index > opening + 1:
                breaks.update([opening + 1, *inside, index])
        elif piece.level == _ITEM_BOUNDARY:
            boundaries[-1].append(index)
        if piece.block == "{":
            stack.append(index)
            boundaries.append([])
    parts = [_Line(line.indent)]
    for index, piece in enumerate(pieces):
        if index in breaks and not piece.comment:
            piece.space = ""
            parts.append(_Line(piece.hanging))
        parts[-1].pieces.append(piece)
    return parts


def _best_break_index(line: _Line) -> int | None:
    """Gives the index of the piece before which a long line is best broken; None if nowhere."""
    best: int | None = None
    best_level = 0
    at = line.indent
    for index, piece in enumerate(line.pieces):
        if piece.comment and all(p.comment for p in line.pieces[index:]):
            break
        if index and piece.level is not None:
            over = at > WIDTH_MAX
            if over and best is not None:
                break
            if best is None or piece.level <= best_level:
                best, best_level = index, piece.level
        at += len(piece.space) + len(piece.text)
    return best


# ---------------------------------------------------------------- expressions in messages

_BINDING = {
    "||": 2, "&&": 3, "<": 4, "<=": 4, ">": 4, ">=": 4, "==": 4, "!=": 4,
    "+": 5, "-": 5, "*": 6, "/": 6, "%": 6,
}  # fmt: skip
_ANYTHING, _CHOICE, _COMPARING, _PREFIX, _OPERAND = 0, 1, 4, 7, 8


def expression_text(expr: tree.SyntaxExpr) -> str:
    """Gives an expression as source text on one line, with no more parentheses than needed."""
    return _expr_text(expr, _ANYTHING)


def _expr_text(expr: tree.SyntaxExpr, outer: int) -> str:
    """Gives the text of `expr`, in parentheses if it binds less tightly than `outer`."""
    if isinstance(expr, tree.BinaryExpr):
        binding = _BINDING[expr.op]
        left = _expr_text(expr.left, binding + 1 if binding == _COMPARING else binding)
        text = f"{left} {expr.op} {_expr_text(expr.right, binding + 1)}"
    elif isinstance(expr, tree.UnaryExpr):
        binding, text = _PREFIX, expr.op + _expr_text(expr.operand, _PREFIX)
    elif isinstance(expr, tree.ConditionalExpr):
        binding = _CHOICE
        then, otherwise = _expr_text(expr.then, _ANYTHING), _expr_text(expr.otherwise, _ANYTHING)
        text = f"{_expr_text(expr.condition, _CHOICE + 1)} ? {then} : {otherwise}"
    else:
        binding, text = _OPERAND, _operand_text(expr)
    return f"({text})" if binding < outer else text


def _operand_text(expr: tree.SyntaxExpr) -> str:
    if isinstance(expr, tree.NameExpr):
        return expr.name.text
    if isinstance(expr, tree.FieldExpr):
        return f"{_expr_text(expr.target, _OPERAND)}.{expr.field.text}"
    if isinstance(expr, tree.IndexExpr):
        return f"{_expr_text(expr.target, _OPERAND)}[{_expr_text(expr.index, _ANYTHING)}]"
    if isinstance(expr, tree.CallExpr):
        return f"{_expr_text(expr.callee, _OPERAND)}({_comma_separated(expr.arguments)})"
    if isinstance(expr, tree.IntLit):
        return str(expr.value)
    if isinstance(expr, tree.FloatLit | tree.DurationLit):
        return expr.text
    if isinstance(expr, tree.BoolLit):
        return "true" if expr.value else "false"
    if isinstance(expr, tree.ListExpr):
        return f"[{_comma_separated(expr.elements)}]"
    if isinstance(expr, tree.RecordExpr):
        pairs = (f"{name.text}: {_expr_text(value, _ANYTHING)}" for name, value in expr.fields)
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(expr, tree.ChooseExpr):
        return f"{'fair ' if expr.fair else ''}choose {_choices_text(expr)}"
    return "..."


def _choices_text(expr: tree.ChooseExpr) -> str:
    if expr.type is not None:
        return expr.type.span.text
    if expr.interval is not None:
        return f"[{_comma_separated((expr.interval.low, expr.interval.high))}]"
    return f"{{ {_comma_separated(expr.options)} }}"


def _comma_separated(exprs: tuple[tree.SyntaxExpr, ...]) -> str:
    return ", ".join(_expr_text(e, _ANYTHING) for e in exprs)

"""Parts of expressions: literals, operators, slips from other languages, and limits of nesting.

Purpose: turns a token into an exact number or duration, or reports that it is too large; has the
precedence of operators, and reports operators of other languages with hints. A bound on nesting
keeps this parser, and every recursive pass after it, within the stack on hostile input.
Non-goals: reading expressions (`expressions.py`), nested blocks of statements (`statements.py`),
how digits become tokens (`lexer.py`).
"""

from __future__ import annotations

import math
from dataclasses import fields
from decimal import Decimal
from fractions import Fraction
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Edit, Fix, Span, make_diagnostic
from soter.diagnostics.fixes import replace
from soter.language.syntax import tree
from soter.language.syntax.lexer import DURATION, EOF, FLOAT, INT, NAME, RESERVED, STRING, UNIT_NS
from soter.language.syntax.parsing.token_cursor import Panic

if TYPE_CHECKING:
    from typing import NoReturn

    from soter.diagnostics.diagnostic import Help
    from soter.language.syntax.parsing.token_cursor import Cursor


#: Levels an expression or a type may nest: brackets and operators count one each.
LEVELS_MAX = 200


def refuse_depth(cursor: Cursor, kind: str) -> NoReturn:
    """Reports an expression or type that nests deeper than `LEVELS_MAX`; raises Panic."""
    raise cursor.failure(
        "S020",
        f"this {kind} is nested too deeply",
        notes=(f"at most {LEVELS_MAX} levels: brackets and operators count one each",),
        helps=("name parts of it with `let`",),
    )


def report_nesting(cursor: Cursor, span: Span, subject: str) -> None:
    """Reports an expression whose tree turned out to be higher than `LEVELS_MAX`."""
    cursor.quiet = -1
    cursor.report(
        "S020",
        f"{subject} is nested too deeply",
        Span(span.source, span.start, min(span.end, span.start + 40)),
        "this expression",
        notes=(f"at most {LEVELS_MAX} levels: a chain of n operators has n of them",),
        helps=("name parts of it with `let`, or use a loop",),
        once=False,
    )


def tree_height(expr: tree.SyntaxExpr) -> int:
    """Gives the number of levels of an expression, without recursion, up to `LEVELS_MAX`."""
    level = 0
    row: list[tree.SyntaxExpr] = [expr]
    while row and level <= LEVELS_MAX:
        level += 1
        row = [child for parent in row for child in subexpressions(parent)]
    return level


def subexpressions(expr: tree.SyntaxExpr) -> list[tree.SyntaxExpr]:
    """Gives the expressions directly inside `expr`, in source order."""
    subexpressions: list[tree.SyntaxExpr] = []
    for field in fields(expr):
        value = getattr(expr, field.name)
        if isinstance(value, tree.SyntaxExpr):
            subexpressions.append(value)
        elif isinstance(value, tree.IntervalExpr):
            subexpressions += [value.low, value.high]
        elif isinstance(value, tuple):
            for part in value:
                if isinstance(part, tree.SyntaxExpr):
                    subexpressions.append(part)
                elif isinstance(part, tuple):
                    subexpressions.extend(p for p in part if isinstance(p, tree.SyntaxExpr))
    return subexpressions


def report_unclosed(cursor: Cursor, opener: int, subject: str) -> None:
    """Reports that the block opened at token `opener` has no end before the cursor."""
    begins = "it" if subject == "this block" else f"the body of {subject}"
    also = [(cursor.token_span(opener), f"{begins} begins here")]
    suspect = _suspect_braces(cursor, opener)
    if suspect is not None:
        opening, closing = suspect
        also.append((cursor.token_span(opening), "this `{` may be the one without an end"))
        also.append((cursor.token_span(closing), "this `}` is indented less"))
    message = f"expected `}}` to close {subject}, found {cursor.found()}"
    cursor.report("S012", message, also=tuple(also))


def _suspect_braces(cursor: Cursor, opener: int) -> tuple[int, int] | None:
    """Gives the first pair of braces inside `opener` whose indentation does not match."""
    stack: list[int] = []
    for index in range(opener, min(cursor.i, opener + 20_000)):
        kind = cursor.kinds[index]
        if kind == "{":
            stack.append(index)
        elif kind == "}" and stack:
            opening = stack.pop()
            indent = cursor.line_indent(index)
            if cursor.is_first_on_line(index) and indent < cursor.line_indent(opening):
                return (opening, index) if opening != opener else None
    return None


NUMBERS = frozenset([FLOAT, INT, DURATION])

_INT_DIGITS_MAX = 40
_DURATION_NS_MAX = 2**63 - 1


def number_literal(cursor: Cursor, span: Span, kind: str) -> tree.SyntaxExpr:
    """Gives the literal of the number token just before the cursor; `kind` is in NUMBERS."""
    text = cursor.texts[cursor.i - 1]
    if kind == FLOAT:
        value = float(text)
        if math.isinf(value):
            return _refuse_large_number(cursor, span, "a float")
        return tree.FloatLit(span, value, text)
    if kind == INT:
        if len(text) > _INT_DIGITS_MAX:
            return _refuse_large_number(cursor, span, "an int")
        return tree.IntLit(span, int(text))
    return _duration_literal(cursor, span, text)


def _duration_literal(cursor: Cursor, span: Span, text: str) -> tree.SyntaxExpr:
    digits = text.rstrip("nusmih")
    unit = UNIT_NS[text[len(digits) :]]
    approximate = float(digits) * unit
    if not approximate <= _DURATION_NS_MAX:
        return _refuse_large_number(cursor, span, "a duration (about 292 years at most)")
    if 0 < approximate < 1e-3 or (approximate == 0 and "e" in digits.lower()):
        return tree.DurationLit(span, None, text)  # far below a nanosecond
    exact = Fraction(Decimal(digits)) * unit  # Python makes no int of 5,000 digits of a text
    value = exact.numerator if exact.denominator == 1 else None
    return tree.DurationLit(span, value, text)


def _refuse_large_number(cursor: Cursor, span: Span, subject: str) -> tree.SyntaxExpr:
    cursor.i -= 1
    cursor.report("L005", f"this number is too large for {subject}", span, skip=1)
    return tree.ErrorExpr(span)


def add_unit_help(cursor: Cursor, i: int) -> None:
    """Adds a help to the last error if a blank separates a number from its unit, as in `10 ms`."""
    if cursor.kinds[i] == NAME and cursor.texts[i] in UNIT_NS and i and cursor.problems:
        last = cursor.problems[-1]
        here = last.primary is not None and last.primary.span.start == cursor.ends[i - 1]
        if here and last.code == "S004" and cursor.kinds[i - 1] in (INT, FLOAT):
            time = f"{cursor.texts[i - 1]}{cursor.texts[i]}"
            whole = cursor.token_span(i - 1).to(cursor.token_span(i))
            help_ = replace(whole, time, f"write `{time}`, without a space")
            cursor.problems[-1] = make_diagnostic(
                last.code, last.message, last.primary, last.secondary, last.notes, (help_,)
            )


def brackets_help(cursor: Cursor, opener: int) -> Help:
    """Gives the edit that writes `[a, b]` for the braces opened at a token."""
    level = 0
    for i in range(opener, len(cursor.kinds)):
        level += (cursor.kinds[i] == "{") - (cursor.kinds[i] == "}")
        if level == 0 and cursor.kinds[i] == "}":
            edits = (Edit(cursor.token_span(opener), "["), Edit(cursor.token_span(i), "]"))
            return Fix("arrays and lists are written `[a, b]`", edits)
    return "arrays and lists are written `[a, b]`"


def fields_helps(cursor: Cursor, opener: int) -> tuple[Help, ...]:
    """Gives helps for `{ x, v }`: to name the fields of a record, or brackets for an array."""
    names: list[str] = []
    i = opener + 1
    while cursor.kinds[i] == NAME and cursor.kinds[i + 1] in (",", "}"):
        names.append(cursor.texts[i])
        i += 2
        if cursor.kinds[i - 1] == "}":
            break
    mixed = names and cursor.kinds[i - 1] == "," and cursor.kinds[i + 1] == ":"
    if mixed and cursor.kinds[i] == NAME:
        last = cursor.token_span(i - 2)
        first = Span(cursor.source, cursor.starts[opener + 1], last.end)
        return (replace(first, ", ".join(f"{name}: {name}" for name in names)),)
    if names and cursor.kinds[opener - 1] == "(":
        return ()
    if not names or cursor.kinds[i - 1] != "}" or cursor.texts[opener - 1] == "in":
        return (brackets_help(cursor, opener),)
    whole = Span(cursor.source, cursor.starts[opener], cursor.ends[i - 1])
    record = "{ " + ", ".join(f"{name}: {name}" for name in names) + " }"
    fix = Fix(f"write `{record}`: a record names its fields", (Edit(whole, record),))
    return fix, f"an array or a list is written `[{', '.join(names)}]`"


COMPARISON = 3
PRECEDENCE = {
    "||": 1,
    "&&": 2,
    "<": COMPARISON,
    "<=": COMPARISON,
    ">": COMPARISON,
    ">=": COMPARISON,
    "==": COMPARISON,
    "!=": COMPARISON,
    "+": 4,
    "-": 4,
    "*": 5,
    "/": 5,
    "%": 5,
}
ANY = 0  # binds less tightly than any operator

#: What stands for which operator in other languages; only between two operands.
_SLIPS = {
    "=": "==",
    "===": "==",
    "!==": "!=",
    "<>": "!=",
    ":=": "==",
    "and": "&&",
    "or": "||",
    "AND": "&&",
    "OR": "||",
    "mod": "%",
    "is": "==",
}
_OPERAND_WORDS = frozenset([NAME, INT, FLOAT, DURATION, "(", "true", "false", "!", "-"])


def operator_meant(cursor: Cursor, kind: str) -> str | None:
    """Gives the operator that was meant by a token of another language; None if it is not known."""
    if kind == NAME:
        word = cursor.texts[cursor.i]
        if word in _SLIPS and cursor.kinds[cursor.i + 1] in _OPERAND_WORDS:
            return _SLIPS[word]
        return None
    no_slip = kind == "=" and (cursor.strict or cursor.before_equal)
    return None if no_slip else _SLIPS.get(kind)


def report_foreign_operator(cursor: Cursor, meant: str) -> None:
    """Reports the token at the cursor, which was written in place of the operator `meant`."""
    text = cursor.texts[cursor.i]
    if text == "=":
        cursor.report(
            "S016",
            "`=` assigns, it does not compare",
            helps=(replace(cursor.token_span(cursor.i), "==", "comparison for equality is `==`"),),
        )
    else:
        helps = (replace(cursor.token_span(cursor.i), meant),)
        cursor.report("S015", f"`{text}` is not an operator of Soter", helps=helps)


def refuse_expression(cursor: Cursor, kind: str) -> NoReturn:
    """Reports why no expression begins at the cursor, in words that suit `kind`; raises Panic."""
    message = f"expected an expression, found {cursor.found()}"
    helps: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    if kind == "+":
        helps = ("there is no unary `+`: leave it out",)
    elif kind == "if":
        cursor.report(
            "S007", message, helps=("a choice inside an expression is `condition ? a : b`",)
        )
        _skip_choice(cursor)
        raise Panic
    elif kind == STRING:
        notes = (
            "strings stand only after `import`, `from`, `data` and in `assert`",
            "what has several cases is of a type, `type Name = enum { A, B };`: `Name.A` is one",
        )
    elif kind in ("float", "int", "bool"):
        notes = (f"`{kind}` is a type",)
    elif kind in RESERVED:
        notes = (f"`{kind}` is reserved and cannot be a name",)
    raise cursor.failure("S007", message, notes=notes, helps=helps)


def _skip_choice(cursor: Cursor) -> None:
    """Steps past an `if ... { } else { }` that stands in the place of an expression."""
    while cursor.kinds[cursor.i] in ("if", "else", "elseif"):
        while cursor.kinds[cursor.i] not in ("{", "}", ";", EOF):
            cursor.i += 1
        if cursor.kinds[cursor.i] == "{":
            cursor.skip_braces()


def refuse_c_loop(cursor: Cursor) -> NoReturn:
    """Reports `for (i = 0; ...; ...) { ... }`, and skips all of it; raises Panic."""
    cursor.report(
        "S006",
        "expected the name of the loop variable after `for`, found `(`",
        notes=("a loop counts over a range, `for i in 0..10`, or goes over a list, `for x in xs`",),
    )
    while cursor.kinds[cursor.i] not in ("{", "}", EOF) and not cursor.is_at_declaration():
        cursor.i += 1
    raise Panic

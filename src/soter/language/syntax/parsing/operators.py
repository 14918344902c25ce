"""Binary operators, and what people write in their place.

Purpose: how tightly operators bind; hints for the slips people bring from other languages, where
an operator or an operand should stand.
Non-goals: reading expressions (`expressions.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fix import replace
from soter.language.syntax.parsing.token_cursor import Panic
from soter.language.syntax.tokens import DURATION, EOF, FLOAT, INT, NAME, RESERVED, STRING

if TYPE_CHECKING:
    from typing import NoReturn

    from soter.language.syntax.parsing.token_cursor import Cursor

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


def slip(cursor: Cursor, kind: str) -> str | None:
    """The operator meant by a token of another language after an operand."""
    if kind == NAME:
        word = cursor.texts[cursor.i]
        if word in _SLIPS and cursor.kinds[cursor.i + 1] in _OPERAND_WORDS:
            return _SLIPS[word]
        return None
    return None if cursor.strict and kind == "=" else _SLIPS.get(kind)


def report_slip(cursor: Cursor, meant: str) -> None:
    """Report the token at the cursor, which stands for the operator `meant`."""
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


def no_expression(cursor: Cursor, kind: str) -> NoReturn:
    """Nothing here begins an expression: say why, as the token lets us, and Panic."""
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
        notes = ("strings stand only after `import`, `from`, `data` and in `assert`",)
        helps = ("name the cases, `type Name = enum { A, B };`, and write one of them: `Name.A`",)
    elif kind in ("float", "int", "bool"):
        notes = (f"`{kind}` is a type",)
    elif kind in RESERVED:
        notes = (f"`{kind}` is reserved and cannot be a name",)
    elif kind == "=":
        helps = ("comparison for equality is `==`",)
    raise cursor.failure("S007", message, notes=notes, helps=helps)


def _skip_choice(cursor: Cursor) -> None:
    """Past an `if ... { } else { }` that stands where an expression should."""
    while cursor.kinds[cursor.i] in ("if", "else", "elseif"):
        while cursor.kinds[cursor.i] not in ("{", "}", ";", EOF):
            cursor.i += 1
        if cursor.kinds[cursor.i] == "{":
            cursor.skip_braces()


def c_style_loop(cursor: Cursor) -> NoReturn:
    """`for (i = 0; ...; ...) { ... }`: reported and left out as a whole; raises Panic."""
    cursor.report(
        "S006",
        "expected the name of the loop variable after `for`, found `(`",
        helps=("write `for i in 0..10 { ... }`: 0, 1, ... 9",),
    )
    while cursor.kinds[cursor.i] not in ("{", "}", EOF) and not cursor.at_declaration():
        cursor.i += 1
    raise Panic

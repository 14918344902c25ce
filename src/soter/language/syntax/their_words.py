"""What Soter has for words of other languages: one table, asked where a program is wrong.

Purpose: `THEIRS` has at most sixty rows, those that mend most of the slips of `bench/newcomers`.
The parser offers an edit where it leaves no syntax error; the checker asks about unknown types,
values and functions, the lexer about units and signs.
Non-goals: phrases of other languages: there the parser says what it expected, and no more.
"""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING

from soter.diagnostics.fixes import replace

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Help, Span

THEIRS: Mapping[str, str] = {
    "until": "horizon",
    "horizon": "until",
    "printf": "publish seen = x;",
    "println": "publish seen = x;",
    "double": "float",
    "f64": "float",
    "float64": "float",
    "float32": "float",
    "long": "int",
    "u32": "int",
    "uint8_t": "int in [0, 255]",
    "True": "true",
    "False": "false",
    "AC": "Mode.AC",
    '"SC"': "Mode.SC",
    "std::": "",
    "math.": "",
    "np.": "",
    "torch.": "",
    "this->": "",
    "vec!": "",
    "pub": "",
    "::": ".",
    "clip": "clamp",
    "pi": "3.141592653589793",
    "M_PI": "3.141592653589793",
    "auto": "let",
    "~": "!",
    "~=": "!=",
    ".*": "*",
    "^": "let y = x * x;",
    "minute": "min",
    "timeout": "max_age",
    "on_activate": "on takeover",
    "string": "type Name = enum { A, B };",
    "struct": "type Name = { x: float };",
    "enum": "type Name = enum { A, B };",
    "typedef": "type Name = enum { A, B };",
    "void": "fun f(x: float): float { ... }",
    "lambda": "fun f(x: float): float { ... }",
    "None": "var x: float = 0.0;",
    "NULL": "var x: float = 0.0;",
    "nullptr": "var on: bool = false;",
    "switch": "if x > 0.0 { ... } elseif x < 0.0 { ... }",
    "match": "if x > 0.0 { ... } elseif x < 0.0 { ... }",
    "break": "if x > 0.0 { ... }",
    "loop": "for i in 0..10 { ... }",
    "pass": "{ }",
    "declare_parameter": "param GAIN: float = 1.0;",
    "std::vector": "float[<=8];",
    "def": "fun",
    "reads": "subscribes",
    "subscribes": "reads",
    "state": "var",
    "publishes": "drives",
    "always": "safe",
    "advanced": "ac",
    "with": "by",
    "within": "by",
}
"""Word of another language -> Soter's: an edit, or an example if it ends with `;` or `}`."""


@cache
def _pattern_of_words() -> re.Pattern[str]:
    words = sorted(THEIRS, key=len, reverse=True)
    return re.compile("|".join(re.escape(w) + (r"\b" if w[-1].isalnum() else "") for w in words))


def foreign_word_at(text: str, start: int) -> str:
    """Gives the word of another language that begins at offset `start`; "" if none does."""
    found = _pattern_of_words().match(text, start)
    return "" if found is None else found[0]


def helps_for_word(word: str, span: Span) -> tuple[Help, ...]:
    """Gives the edit or the advice for a word of another language; () if the word is not known."""
    ours = THEIRS.get(word)
    if ours is None:
        return ()
    if is_only_shown(ours):
        return (f"in Soter: `{ours}`",)
    return (replace(span, ours, None if ours else f"leave `{word}` out"),)


def is_only_shown(ours: str) -> bool:
    """Whether the Soter text for a foreign word is only an example, and not an edit."""
    return ours[-1:] in (";", "}")

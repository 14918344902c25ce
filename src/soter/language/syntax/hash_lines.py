"""Explains lines that begin with `#`, as other languages have them.

Purpose: a directive of C, an attribute or a comment is reported with what Soter has instead, and
with the name that the line would declare, so that uses of it are not reported as well.
Non-goals: where such lines stand (`lexer.py`); words of other languages (`their_words.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Span
from soter.diagnostics.fixes import remove, replace

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Help, Source

_DEFINE = re.compile(r"#\s*define\s+(\w+)\s+\(?(-?[\w.+-]+?)\)?\s*(?://.*)?")
_DIRECTIVE = re.compile(r"#!?\[|#\s*(?:if|ifn?def|elif|else|endif|pragma|undef)\b")
_INCLUDE = re.compile(r"#\s*include\s*[<\"]([\w./-]+)[>\"]\s*(?://.*)?")


@dataclass(frozen=True)
class HashLine:
    """A line that begins with `#`: the message about it, its place, and names it would declare."""

    message: str
    span: Span
    helps: tuple[Help, ...]
    declares: frozenset[str] = frozenset()


def explain_hash_line(source: Source, token: str, start: int) -> HashLine:
    """Explains the wrong line `token`, which begins with `#` and lies at offset `start`."""
    hash_, whole = Span(source, start, start + 1), Span(source, start, start + len(token))
    define, include = _DEFINE.fullmatch(token), _INCLUDE.fullmatch(token)
    message = "there is no preprocessor"
    if define is not None:
        name, value = define[1], define[2]
        type_name = "int" if value.lstrip("-").isdigit() else "float"
        helps = (replace(whole, f"const {name}: {type_name} = {value};"),)
        return HashLine(message, whole, helps, frozenset([name]))
    if include is not None:
        stem = include[1].rpartition("/")[2].partition(".")[0]
        name = _included_name(stem, source.text)
        if not include[1].endswith(".soter"):
            advice = ("the prelude needs no import: `sin`, `clamp`, `Vec3` are there",)
            return HashLine(message, whole, advice, frozenset([name]))
        helps = (replace(whole, f'import "{include[1]}" as {name};'),)
        return HashLine(message, whole, helps, frozenset([name]))
    if _DIRECTIVE.match(token):
        if "[" in token[:3]:
            gone = remove(whole, "leave this line out")
            return HashLine("there are no attributes", whole, (gone,))
        advice = ("leave these lines out: what differs from run to run is a `param`",)
        return HashLine(message, whole, advice)
    comment = replace(hash_, "//", "a comment begins with `//`")
    return HashLine("`#` does not begin a comment", hash_, (comment,))


def _included_name(stem: str, text: str) -> str:
    """Gives the prefix with which a text uses names of an included file; `stem` if it uses none."""
    names = [stem, *reversed(stem.split("_"))]
    return next((n for n in names if n and re.search(rf"\b{n}\.(?!soter\b)[A-Za-z]", text)), stem)

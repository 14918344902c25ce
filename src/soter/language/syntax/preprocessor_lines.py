"""Lines that begin with `#`: comments of Python and the shell, the preprocessor of C, attributes.

Purpose: what is said of such a line, and the edit that makes Soter of it.
Non-goals: finding them (`tokens.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import remove, replace
from soter.diagnostics.source import Span

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Help
    from soter.diagnostics.source import Source

_DEFINE = re.compile(r"#\s*define\s+(\w+)\s+\(?(-?[\w.+-]+?)\)?\s*(?://.*)?")
_DIRECTIVE = re.compile(r"#!?\[|#\s*(?:if|ifn?def|elif|else|endif|pragma|undef)\b")
_INCLUDE = re.compile(r"#\s*include\s*[<\"]([\w./-]+)[>\"]\s*(?://.*)?")


@dataclass(frozen=True)
class HashLine:
    """What is said of it, where, and which names it would have declared."""

    message: str
    span: Span
    helps: tuple[Help, ...]
    declares: frozenset[str] = frozenset()


def preprocessed(source: Source, token: str, start: int) -> HashLine:
    """Of the line `token`, from its `#` at offset `start` to its last character."""
    hash_, whole = Span(source, start, start + 1), Span(source, start, start + len(token))
    define, include = _DEFINE.fullmatch(token), _INCLUDE.fullmatch(token)
    message = "there is no preprocessor"
    if define is not None:
        name, value = define[1], define[2]
        of = "int" if value.lstrip("-").isdigit() else "float"
        helps = (replace(whole, f"const {name}: {of} = {value};"),)
        return HashLine(message, whole, helps, frozenset([name]))
    if include is not None:
        stem = include[1].rpartition("/")[2].partition(".")[0]
        name = _called(stem, source.text)
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


def _called(stem: str, text: str) -> str:
    """The name that a file goes by in the text that imports it; its own where that is not seen."""
    names = [stem, *reversed(stem.split("_"))]
    return next((n for n in names if n and re.search(rf"\b{n}\.(?!soter\b)[A-Za-z]", text)), stem)

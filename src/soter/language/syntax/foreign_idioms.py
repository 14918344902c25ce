"""Phrases of other languages: which one stands where the parser cannot go on.

Purpose: say whether the text there is a phrase of C, C++, Python, Rust, ROS or a textbook, and
which edit makes it Soter. Nothing is looked up before there is an error, and a phrase counts only
where it covers the error, so no right program is concerned.
Non-goals: the phrases (`foreign_phrases.py`), single words (`foreign_words.py`), how parsing goes
on (`parsing/token_cursor.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.diagnostics.fix import Edit, Fix
from soter.diagnostics.span import Span
from soter.language.syntax.foreign_declarations import DECLARATIONS
from soter.language.syntax.foreign_expressions import EXPRESSIONS
from soter.language.syntax.foreign_phrases import FUNCTION, IDIOMS, MODULE, NODE, PLANT, TOP

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from soter.diagnostics.fix import Help
    from soter.diagnostics.source import Source
from soter.language.syntax.foreign_phrases import Idiom

_FAR = 400
"""So many characters of a phrase that runs over several lines are looked at."""
_SHOWN_MAX = 200
"""So many characters of what is to be written are shown; an editor writes all of them."""


@dataclass(frozen=True)
class Phrase:
    """One phrase found: where it stands, what is said, and the edit or advice."""

    span: Span
    message: str
    help: Help
    end: int


_DIVISION = re.compile(r"[ \t]*(//)[ \t]*[\w.(-][\w.()+* -]*[])};][^\n]*")


def find(
    source: Source,
    at: int,
    place: str,
    before: int,
    leads_on: Callable[[Fix, int], bool] = lambda _, __: True,
) -> Phrase | None:
    """The phrase over the character offset `at`, None where no phrase is known.

    `place` is the kind of body that the offset stands in, `before` where the token before it ends.
    A phrase counts only where its edit, if it has one, `leads_on` up to the end of what it covers;
    one that does so up to the end of the statement comes before all others.
    """
    text = source.text
    division = _DIVISION.match(text, before)
    if division is not None and at >= before:
        sign = Span(source, division.start(1), division.end(1))
        fix = Fix("write `/`: of two ints it is the whole part", (Edit(sign, "/"),))
        return Phrase(sign, "`//` begins a comment", fix, sign.end)
    line = text.rfind("\n", 0, at) + 1
    end = text.find("\n", at)
    end = len(text) if end < 0 else end
    stop = text.find(";", at, end)
    first: Phrase | None = None
    for idiom in (*DECLARATIONS, *EXPRESSIONS, *IDIOMS):
        if idiom.places and place not in idiom.places:
            continue
        far = len(text) if idiom.pattern.flags & re.DOTALL else end
        for match in idiom.pattern.finditer(text, line, min(far, line + _FAR)):
            if not match.start() <= at <= match.end():
                continue
            phrase = _phrase(source, idiom, match, place)
            if phrase is None:
                continue
            if not isinstance(phrase.help, Fix) or leads_on(phrase.help, max(stop, phrase.end)):
                return phrase
            if first is None and leads_on(phrase.help, phrase.end):
                first = phrase
    return first


def _phrase(source: Source, idiom: Idiom, match: re.Match[str], place: str) -> Phrase | None:
    blanks = len(match[0]) - len(match[0].lstrip())
    whole = Span(source, match.start() + blanks, match.end())
    start, end = match.span("at") if "at" in idiom.pattern.groupindex else match.span()
    if start < 0:  # the group may be missing from the phrase
        start, end = whole.start, whole.end
    message = idiom.message.format(*(g or "" for g in match.groups()), place=place)
    help_: Help = idiom.say
    if idiom.write is not None:
        new = idiom.write(match)
        if new is None:
            return None
        new = new.lstrip()
        shown = " ".join(new.split())
        shown = shown if len(shown) <= _SHOWN_MAX else f"{shown[:_SHOWN_MAX]}..."
        quoted = "`" in shown
        written = shown if quoted else f"write `{shown}`"
        title = idiom.say or (written if shown else f"leave `{match['at'].strip()}` out")
        help_ = Fix(title, (Edit(whole, new),)) if idiom.sure else title
    return Phrase(Span(source, start, end), message, help_, match.end())


def place_of(items: Collection[str], blocks: int) -> str:
    """The kind of body at hand, by the words that begin its items and the blocks around."""
    for word, kind in (("subscribes", NODE), ("der", PLANT), ("ac", MODULE)):
        if word in items:
            return kind
    if items:
        return ""
    return FUNCTION if blocks else TOP

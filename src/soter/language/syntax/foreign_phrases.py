"""Phrases of other languages: which one stands where the parser cannot go on.

Purpose: `find` says whether the text there is a phrase of C, C++, Python, Rust, ROS or a textbook,
and which edit makes it Soter. The phrases are the tables of `phrases/`, in the order in which they
are tried. They are read at the first error, and a phrase counts only where it covers the error, so
no right program is concerned.

A row is headed by what is said. `find` is its pattern, whose lines are joined; in it `<name>` is a
group of one word, `<NAME>` one of `FRAGMENTS`, and the group `at` is where the phrase is told, the
whole match without one. `write` is Soter with gaps for the groups: `<a,b>` is the first that is
there, `<a|change>` one changed by `foreign_rewrites.py`, which has the writers that `by` names.
`advise` is the help without an edit, or its title. `places` are the bodies in which it counts;
`far`: over several lines; `only_shown`: the edit is shown and not offered.
Non-goals: single words (`words.py`); how parsing goes on (`parsing/token_cursor.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Edit, Fix, Span
from soter.language.syntax.foreign_rewrites import CHANGES, TYPE, WRITERS
from soter.language.syntax.words import LIBRARIES, word_table

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from soter.diagnostics.diagnostic import Help, Source

NODE, PLANT, MODULE, FUNCTION, TOP = "node", "plant", "module", "function", "top"

_TABLES = ("declarations", "expressions", "habits")
FRAGMENTS = {
    "STATEMENT": r"(?:^|(?<=[;{}]))[ \t]*",
    "ARGUMENTS": r"(?:[^;()\n]|\((?:[^;()\n]|\([^;()\n]*\))*\))*",
    "BRACKETS": r"\((?:[^()]|\([^()]*\))*\)",
    "CONDITION": r"\b(?P<word>safe|ttf|safer|always|never|assumes|guarantees|assert)\s+",
    "CONTAINER": r"(?:std::)?(?:vector|array|deque|list|List|Vec|Array|Sequence)",
    "EXPRESSION": r"[^;{}=\n]+?",
    "LIBRARIES": "|".join(sorted(LIBRARIES)),
    "LIST": r"(?P<list>[A-Za-z_][\w.]*(?:\[\w+\])*)",
    "NAMES": r"\w+(?:\s*,\s*\w+)+",
    "TYPE": TYPE,
    "TYPED": r"(?P<name>[A-Za-z_]\w*)\s*:\s*(?P<type>(?:float|int|bool|duration)(?:\[\w+\])?)",
}
_SHORT = re.compile(r"(?<!P)<(\w+)>")
_GAP = re.compile(r"<([\w,]+)(?:\|(\w+))?>")
_FAR = 400
"""So many characters of a phrase that runs over several lines are looked at."""
_SHOWN_MAX = 200
"""So many characters of what is to be written are shown; an editor writes all of them."""


@dataclass(frozen=True)
class Form:
    """A row of the tables: what is known of one phrase."""

    message: str
    find: str
    write: str | None = None
    by: str = ""
    advise: str = ""
    places: str = ""
    far: bool = False
    only_shown: bool = False

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        """Its pattern in full."""
        text = "".join(line.lstrip() for line in self.find.split("\n"))
        text = _SHORT.sub(lambda m: FRAGMENTS.get(m[1]) or rf"(?P<{m[1]}>\w+)", text)
        return re.compile(text, re.MULTILINE | (re.DOTALL if self.far else 0))

    def soter(self, match: re.Match[str]) -> str | None:
        """What is written for a match; None where it is no such phrase after all."""
        return WRITERS[self.by](match) if self.by else filled(self.write or "", match)


def filled(form: str, match: re.Match[str]) -> str | None:
    """A form with its gaps filled by the groups of a match; None where one cannot be."""
    texts: list[str] = []
    for gap in _GAP.finditer(form):
        group = next((match[name] for name in gap[1].split(",") if match[name]), "")
        text = CHANGES[gap[2]](group) if gap[2] else group
        if text is None:
            return None
        texts.append(text)
    remaining = iter(texts)
    return _GAP.sub(lambda _: next(remaining), form)


@cache
def forms() -> tuple[Form, ...]:
    """All phrases, in the order in which they are tried."""
    tables = [word_table(f"phrases/{name}") for name in _TABLES]
    rows = [(said, row) for table in tables for said, rows in table.items() for row in rows]
    return tuple(Form(said, **row) for said, row in rows)


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
    for form in forms():
        if form.places and place not in form.places.split():
            continue
        far = len(text) if form.far else end
        for match in form.pattern.finditer(text, line, min(far, line + _FAR)):
            if not match.start() <= at <= match.end():
                continue
            phrase = _phrase(source, form, match)
            if phrase is None:
                continue
            if not isinstance(phrase.help, Fix) or leads_on(phrase.help, max(stop, phrase.end)):
                return phrase
            if first is None and leads_on(phrase.help, phrase.end):
                first = phrase
    return first


def _phrase(source: Source, form: Form, match: re.Match[str]) -> Phrase | None:
    """What is said of a match; None where it is no such phrase after all."""
    blanks = len(match[0]) - len(match[0].lstrip())
    whole = Span(source, match.start() + blanks, match.end())
    start, end = match.span("at") if "at" in form.pattern.groupindex else match.span()
    if start < 0:  # the group may be missing from the phrase
        start, end = whole.start, whole.end
    help_: Help = form.advise
    if form.by or form.write is not None:
        new = form.soter(match)
        if new is None:
            return None
        new = new.lstrip()
        shown = " ".join(new.split())
        shown = shown if len(shown) <= _SHOWN_MAX else f"{shown[:_SHOWN_MAX]}..."
        quoted = "`" in shown
        written = shown if quoted else f"write `{shown}`"
        title = form.advise or (written if shown else f"leave `{match['at'].strip()}` out")
        help_ = title if form.only_shown else Fix(title, (Edit(whole, new),))
    return Phrase(Span(source, start, end), filled(form.message, match) or "", help_, match.end())


def place_of(items: Collection[str], blocks: int) -> str:
    """The kind of body at hand, by the words that begin its items and the blocks around."""
    for word, kind in (("subscribes", NODE), ("der", PLANT), ("ac", MODULE)):
        if word in items:
            return kind
    if items:
        return ""
    return FUNCTION if blocks else TOP

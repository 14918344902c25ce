"""Items of bodies as rows of tables: the leading word, the reader, and the fields of the node.

Purpose: `Item` and its kinds (`once`, `often`, `each`); a row consists of steps, each of which
reads a part (`expr`, `time`, `word`, ...), and `made`, which makes a node of what they read. The
parser's loop over bodies, its report "stands twice" and the editor's completion use these tables.
Non-goals: the tables (`declarations.py`, `modules.py`, `systems.py`).
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from soter.language.syntax.lexer import RESERVED

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.diagnostics.diagnostic import Span
    from soter.language.syntax.parsing.token_cursor import Cursor

    Step = Callable[[Any], Any]
    Read = Callable[[Any, str, int], Any]
    """Reads what stands behind the word of an item, given that and the offset where it begins."""

EQUALS = ("=", ":=", "==", "<-")
NOTHING = object()
"""The result of a step that only reads a sign or a word."""


@dataclass(frozen=True, slots=True)
class Item:
    """A row: how an item is read, and which fields it fills in the node of its body."""

    defaults: Mapping[str, Any]
    """Field that the item fills -> its value if the item is absent."""
    read: Read
    how: str = "once"
    """Whether the item may stand `once` or `often`; for `each` `read` yields several values, for a
    `loop` it returns values by field."""
    begins: tuple[str, ...] = ()
    """How the item begins, if its word alone is not enough: `acts within`."""
    told: str = ""
    """Its name in the report that it stands twice; "": its word."""


def once(
    fields: str | Mapping[str, Any], read: Read, *begins: str, title: str = "", none: object = None
) -> Item:
    """Gives an item that may stand once. One of several fields reads a tuple of their values."""
    return Item({fields: none} if isinstance(fields, str) else fields, read, "once", begins, title)


def often(field: str, read: Read, *begins: str) -> Item:
    """Gives an item that may stand often, and reads one value of a field each time."""
    return Item({field: ()}, read, "often", begins)


def each(field: str, read: Read) -> Item:
    """Gives an item that may stand often, and yields several values of a field."""
    return Item({field: ()}, read, "each")


Items = dict[str, Item]


class Parts:
    """The values that were read from a body."""

    __slots__ = ("first", "once", "several")

    def __init__(self) -> None:
        self.once: dict[str, Any] = {}
        self.first: dict[str, Span] = {}
        """The first place of each item that may stand only once, for the message on a second."""
        self.several: defaultdict[str, list[Any]] = defaultdict(list)

    def fields(self, items: Items) -> dict[str, Any]:
        """Gives the fields of the node that a body with such items becomes."""
        values = {name: value for i in items.values() for name, value in i.defaults.items()}
        return values | self.once | {name: tuple(found) for name, found in self.several.items()}


def begins(items: Items) -> tuple[str, ...]:
    """Gives how the items of a table begin, as an editor offers them."""
    return tuple(text for word, item in items.items() for text in item.begins or (word,))


# ---------------------------------------------------------------- steps


def _step_by_method(method: str) -> Callable[[str], Step]:
    def of(subject: str) -> Step:
        return lambda parser: getattr(parser, method)(subject)

    return of


def _step_without_value(method: str) -> Callable[[str], Step]:
    def of(where: str) -> Step:
        def read(parser: Cursor) -> object:
            getattr(parser, method)(where)
            return NOTHING

        return read

    return of


expr, value, time, time_value = map(_step_by_method, ("expr", "value", "time", "time_value"))
name, ref, interval, range_of = map(_step_by_method, ("name", "ref", "interval", "range_of"))
block = _step_by_method("block")
assign, semicolon = map(_step_without_value, ("assign", "expect_semicolon"))


def word(text: str, where: str) -> Step:
    """Gives a step that reads a required word or sign."""

    def read(parser: Cursor) -> object:
        of_its_kind = text in RESERVED or not text.isalpha()
        (parser.expect if of_its_kind else parser.expect_word)(text, where)
        return NOTHING

    return read


def equal(where: str, subject: str) -> Step:
    """Gives a step that reads `= e`, for a row of `clauses`."""
    return group(lambda value: value, assign(where), expr(subject))


def maybe(text: str, step: Step, none: object = None) -> Step:
    """A step that reads `step` after the word `text`, if that word stands here; else `none`."""
    return lambda parser: step(parser) if parser.accept(text) or parser.accept_word(text) else none


def commas(step: Step) -> Step:
    """Gives a step that reads one or more values, between commas."""

    def read(parser: Cursor) -> tuple[Any, ...]:
        found = [step(parser)]
        while parser.accept(","):
            found.append(step(parser))
        return tuple(found)

    return read


def word_of(*texts: str) -> Step:
    """Gives a step that reads one of some words; "" if none of them stands here."""
    return lambda parser: next((text for text in texts if parser.accept_word(text)), "")


def clauses(parser: Cursor, item: str, rows: Mapping[str, Step]) -> dict[str, Any]:
    """Reads clauses after a name, in any order, by the word or sign that leads each.

    Reports S022 for one that stands twice in this `item`.
    """
    found: dict[str, Any] = {}
    while (lead := "=" if parser.kinds[parser.i] in EQUALS else parser.texts[parser.i]) in rows:
        at = parser.i
        parser.i += lead != "="
        parser.before_equal = lead != "=" and "=" in rows
        try:
            read = rows[lead](parser)
        finally:
            parser.before_equal = False
        if lead in found:
            parser.quiet = -1
            parser.report(
                "S022", f"`{lead}` stands twice in this {item}", parser.token_span(at), once=False
            )
        found.setdefault(lead, read)
    return found


def values_of(parser: Cursor, *steps: Step) -> list[Any]:
    """Gives the values that steps read one after another, without signs and words."""
    return [v for step in steps if (v := step(parser)) is not NOTHING]


def group(make: Callable[..., Any], *steps: Step) -> Step:
    """Gives a step that makes one value of what several steps read."""
    return lambda parser: make(*values_of(parser, *steps))


def pair(*parts: object) -> tuple[object, ...]:
    """Gives its arguments as a tuple."""
    return parts


# ---------------------------------------------------------------- ways to read an item


def made(make: Callable[..., Any], *steps: Step) -> Read:
    """A reader that makes a node of the values that steps read (the last reads `;`), and a span."""

    def read(parser: Cursor, _word: str, start: int) -> Any:  # noqa: ANN401 - a node
        return make(*values_of(parser, *steps), parser.span_from(start))

    return read


def only(*steps: Step) -> Read:
    """Gives a reader for the value of the one step that has a value."""
    return lambda parser, _word, _start: values_of(parser, *steps)[0]


def of_word(method: str) -> Read:
    """Gives a reader of a value or a time, which messages call by the item's word."""
    return lambda parser, word, _start: getattr(parser, method)(f"`{word}`")


def spanned(*steps: Step) -> Read:
    """Gives a reader whose value is only the item's span."""

    def read(parser: Cursor, _word: str, start: int) -> Span:
        values_of(parser, *steps)
        return parser.span_from(start)

    return read

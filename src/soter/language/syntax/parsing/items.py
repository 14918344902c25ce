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
    """A row of a table of items: how to parse an item, and which fields of the body it fills."""

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
    """Makes an item that may occur once. For several fields, its reader gives a tuple of values."""
    return Item({fields: none} if isinstance(fields, str) else fields, read, "once", begins, title)


def often(field: str, read: Read, *begins: str) -> Item:
    """Makes an item that may occur often; each occurrence adds one value to the field."""
    return Item({field: ()}, read, "often", begins)


def each(field: str, read: Read) -> Item:
    """Makes an item that may occur often; each occurrence adds several values to the field."""
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
        """Gives the fields of the syntax tree node for a body with these items."""
        values = {name: value for i in items.values() for name, value in i.defaults.items()}
        return values | self.once | {name: tuple(found) for name, found in self.several.items()}


def begins(items: Items) -> tuple[str, ...]:
    """Gives the possible beginnings of the items in a table, for completion in an editor."""
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
    """Makes a step that runs `step` if the word `text` is at the cursor, and else gives `none`."""
    return lambda parser: step(parser) if parser.accept(text) or parser.accept_word(text) else none


def commas(step: Step) -> Step:
    """Makes a step that parses one or more values, separated by commas."""

    def read(parser: Cursor) -> tuple[Any, ...]:
        found = [step(parser)]
        while parser.accept(","):
            found.append(step(parser))
        return tuple(found)

    return read


def word_of(*texts: str) -> Step:
    """Makes a step that parses one of some words; the step gives "" if none is at the cursor."""
    return lambda parser: next((text for text in texts if parser.accept_word(text)), "")


def clauses(parser: Cursor, item: str, rows: Mapping[str, Step]) -> dict[str, Any]:
    """Parses clauses after a name, in any order, each by the word or sign at its beginning.

    Reports S022 for a clause that occurs twice in this `item`.
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
    """Gives the values of steps that run one after another; signs and words give no value."""
    return [v for step in steps if (v := step(parser)) is not NOTHING]


def group(make: Callable[..., Any], *steps: Step) -> Step:
    """Makes a step that runs several steps, and gives the result of `make` for their values."""
    return lambda parser: make(*values_of(parser, *steps))


def pair(*parts: object) -> tuple[object, ...]:
    """Gives its arguments as a tuple."""
    return parts


# ---------------------------------------------------------------- ways to read an item


def made(make: Callable[..., Any], *steps: Step) -> Read:
    """Makes a reader that calls `make` with steps' values (the last step reads `;`) and a span."""

    def read(parser: Cursor, _word: str, start: int) -> Any:  # noqa: ANN401 - a node
        return make(*values_of(parser, *steps), parser.span_from(start))

    return read


def only(*steps: Step) -> Read:
    """Makes a reader that gives the value of the only step that has a value."""
    return lambda parser, _word, _start: values_of(parser, *steps)[0]


def reader_named_by_word(method: str) -> Read:
    """Makes a reader of a value or a time; messages call the value by the word of the item."""
    return lambda parser, word, _start: getattr(parser, method)(f"`{word}`")


def spanned(*steps: Step) -> Read:
    """Gives a reader whose value is only the item's span."""

    def read(parser: Cursor, _word: str, start: int) -> Span:
        values_of(parser, *steps)
        return parser.span_from(start)

    return read

"""Arrays of instances: loops over items of systems and tests, elements in paths, `set`.

Purpose: `for i in 0..3 { items }`, `r[i].pose`, `r[i]: What`, `set r[i].GAIN = 2.0`.
Non-goals: the items (`systems.py`), what a loop comes to
(`language/check/parts/instance_arrays.py`).
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from soter.language.syntax import tree
from soter.language.syntax.tokens import EOF, NAME

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.language.syntax.parsing.bodies import BodyParser

LOOPS_MAX = 8
"""Loops of items may nest so deep."""


def behind_indices(parser: BodyParser, at: int) -> int:
    """The token behind `[...]`, as often as that stands at token `at`."""
    kinds = parser.kinds
    while kinds[at] == "[":
        level = 0
        while kinds[at] not in (";", "{", "}", EOF):
            level += (kinds[at] == "[") - (kinds[at] == "]")
            at += 1
            if level == 0:
                break
        if level:
            break
    return at


def element(parser: BodyParser, name: tree.Name) -> tree.Name:
    """`name`, with the indices that follow it."""
    indices = []
    while parser.kinds[parser.i] == "[":
        opener = parser.i
        parser.tight.append(opener)
        parser.i += 1
        indices.append(parser.expr("the index of an element"))
        parser.expect("]", "after the index", opener=opener)
    if not indices:
        return name
    return tree.ElementName(name.text, parser.span_from(name.span.start), tuple(indices))


def path(parser: BodyParser, what: str) -> tree.DottedPath:
    """`name[i].name.name`."""
    first = parser.name(what)
    parts = [element(parser, first)]
    while parser.accept("."):
        parts.append(element(parser, parser.name("a name after `.`")))
    return tree.DottedPath(tuple(parts), parser.span_from(first.span.start))


def setting(parser: BodyParser, *, inside: bool = False) -> tree.SetParam:
    """`set K = 3`, at `set`; `inside` the braces of an instance a comma may follow."""
    start = parser.starts[parser.i]
    parser.i += 1
    param = path(parser, "the name of a parameter")
    parser.assign("after the parameter")
    what = "the value of the parameter"
    value = parser.expr(what) if inside else parser.value(what)
    return tree.SetParam(param, value, parser.span_from(start))


def loop(items: Mapping[str, Callable[[Any, Any], None]], other: object) -> Callable[..., None]:
    """The parser of `for i in low..high { items }`.

    `items` and `other` as for `BodyParser.body`; the kinds of items are the lists of the parts.
    """

    def item(parser: BodyParser, parts: Any) -> None:  # noqa: ANN401 - of a system or a test
        start = parser.starts[parser.i]
        at = parser.i
        name, low = parser.loop_head()
        if not parser.accept(".."):
            message = f"expected `..` and the end of the range, found {parser.found()}"
            raise parser.failure("S005", message, helps=("write `for i in 0..3 { ... }`",))
        high = parser.head("the end of the range")
        inner = type(parts)()
        inner.loops = parts.loops + 1
        if inner.loops > LOOPS_MAX:
            notes = (f"at most {LOOPS_MAX} levels",)
            parser.report("S020", "loops nest too deeply", parser.token_span(at), notes=notes)
            parser.damaged = True
            parser.skip_braces()
            return
        parser.body(f"the loop over `{name.text}`", inner, items, other)  # type: ignore[arg-type]
        _once_in_a_loop(parser, inner)
        span = parser.span_from(start)
        empty = True
        for field in fields(inner):
            elements = getattr(inner, field.name)
            if isinstance(elements, list) and elements:
                empty = False
                repeated = tree.Repeated(name, low, high, tuple(elements), span)
                getattr(parts, field.name).append(repeated)
        if empty and not parser.damaged and not inner.once:
            parser.report("S010", "this loop has nothing in it", parser.token_span(at))

    return item


def _once_in_a_loop(parser: BodyParser, inner: Any) -> None:  # noqa: ANN401 - see `loop`
    """S010 for what a system or a test says once."""
    for word, span in inner.first.items():
        notes = ("it is said once",)
        parser.report("S010", f"`{word}` does not belong in a loop", span, notes=notes)
        parser.damaged = True
        parser.quiet = -1


def at_instance(parser: BodyParser, at: int) -> bool:
    """Whether `name:` or `name[i]:` stands at token `at`."""
    return parser.kinds[at] == NAME and parser.kinds[behind_indices(parser, at + 1)] == ":"

"""Parses loops over items of systems and tests, elements in paths, and `set`.

Purpose: reads `for i in 0..3 { items }`, `r[i].pose`, `r[i]: What`, `set r[i].GAIN = 2.0`.
Non-goals: the items (`systems.py`), unrolling of loops (`language/check/parts/instances.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.syntax import tree
from soter.language.syntax.lexer import EOF

if TYPE_CHECKING:
    from soter.language.syntax.parsing.bodies import BodyParser, Other
    from soter.language.syntax.parsing.items import Items, Read, Step

LOOPS_MAX = 8
"""How deep loops of items may nest."""


def index_after_brackets(parser: BodyParser, at: int) -> int:
    """Gives the index of the token after all `[...]` that begin at token `at`."""
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


def parse_element(parser: BodyParser, name: tree.Name) -> tree.Name:
    """Parses the indices that follow `name`; gives the name with them."""
    indices = []
    while parser.kinds[parser.i] == "[":
        opener = parser.take()
        parser.tight.append(opener)
        indices.append(parser.expr("the index of an element"))
        parser.expect("]", "after the index", opener=opener)
    if not indices:
        return name
    return tree.ElementName(name.text, parser.span_from(name.span.start), tuple(indices))


def parse_path(parser: BodyParser, subject: str) -> tree.DottedPath:
    """Parses a path of names and elements: `name[i].name.name`."""
    first = parser.name(subject)
    parts = [parse_element(parser, first)]
    while parser.accept("."):
        parts.append(parse_element(parser, parser.name("a name after `.`")))
    return tree.DottedPath(tuple(parts), parser.span_from(first.span.start))


def dotted(subject: str) -> Step:
    """Gives a step that parses a path."""
    return lambda parser: parse_path(parser, subject)


def parse_setting(
    parser: BodyParser, _word: str, start: int, *, inside: bool = False
) -> tree.SetParam:
    """Parses `set K = 3` after `set`, which is at `start`; `inside`: in braces, without a `;`."""
    param = parse_path(parser, "the name of a parameter")
    parser.assign("after the parameter")
    subject = "the value of the parameter"
    value = parser.expr(subject) if inside else parser.value(subject)
    return tree.SetParam(param, value, parser.span_from(start))


def loop(items: Items, other: Other) -> Read:
    """Makes a reader of `for i in low..high { items }`, with the arguments of `BodyParser.body`.

    The reader maps each field to a `Repeated` with the items of one kind.
    """

    def read(parser: BodyParser, _word: str, start: int) -> dict[str, tree.Repeated]:
        at = parser.i - 1
        name, low = parser.loop_head()
        if not parser.accept(".."):
            message = f"expected `..` and the end of the range, found {parser.found()}"
            raise parser.failure("S005", message, helps=("write `for i in 0..3 { ... }`",))
        high = parser.head("the end of the range")
        if parser.loops >= LOOPS_MAX:
            notes = (f"at most {LOOPS_MAX} levels",)
            parser.report("S020", "loops nest too deeply", parser.token_span(at), notes=notes)
            parser.damaged = True
            parser.skip_braces()
            return {}
        parser.loops += 1
        try:
            inner = parser.body(f"the loop over `{name.text}`", items, other)
        finally:
            parser.loops -= 1
        for word, span in inner.first.items():
            notes = ("it is said once",)
            parser.report("S010", f"`{word}` does not belong in a loop", span, notes=notes)
            parser.damaged = True
            parser.quiet = -1
        span = parser.span_from(start)
        if not inner.several and not parser.damaged and not inner.once:
            parser.report("S010", "this loop has nothing in it", parser.token_span(at))
        return {
            kind: tree.Repeated(name, low, high, tuple(found), span)
            for kind, found in inner.several.items()
        }

    return read

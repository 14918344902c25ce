"""The `verify` block of a module.

Purpose: grids, polytopes, abstractions, commands, times: what `soter verify` needs to know.
Non-goals: what the names mean (`language/check/parts/verify_block.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.syntax import tree
from soter.language.syntax.parsing.instance_arrays import dotted
from soter.language.syntax.parsing.items import (
    NOTHING,
    Items,
    assign,
    commas,
    expr,
    group,
    made,
    maybe,
    name,
    of_word,
    often,
    once,
    only,
    pair,
    range_of,
    ref,
    semicolon,
    spanned,
    value,
    word,
)
from soter.language.syntax.tokens import NAME

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Span
    from soter.language.syntax.parsing.bodies import BodyParser

    Expr = tree.SyntaxExpr | None


def verify(parser: BodyParser, _word: str, start: int) -> tree.VerifyBlock:
    """`verify { ... }` of a module."""
    parts = parser.body("this `verify` block", VERIFY_ITEMS)
    return tree.VerifyBlock(**parts.fields(VERIFY_ITEMS), span=parser.span_from(start))


def _view(parser: BodyParser, _word: str, start: int) -> tree.View:
    name = parser.name("the name of a view")
    parts = parser.body(f"view `{name.text}`", VIEW_ITEMS)
    return tree.View(name, span=parser.span_from(start), **parts.fields(VIEW_ITEMS))


def _open(parser: BodyParser) -> tuple[Expr, bool]:
    """`open`, `open to e`: where the axis ends, and whether it has no end."""
    if not parser.accept_word("open"):
        return None, False
    if parser.kinds[parser.i] in (",", ";"):
        return None, True
    parser.expect_word("to", "after `open`")
    return parser.expr("where an open axis ends"), False


def _grid_axis(*parts: object) -> tree.GridAxis:
    *axis, end = parts
    return tree.GridAxis(*axis, *end)  # type: ignore[misc, arg-type]


def _abstracted(parser: BodyParser) -> object:
    """`by` behind an abstracted plant, or another word in its place."""
    if not parser.is_word("by") and parser.kinds[parser.i : parser.i + 2] == [NAME, NAME]:
        parser.report("S005", f"expected `by` after the abstracted plant, found {parser.found()}")
        parser.i += 1
    else:
        parser.expect_word("by", "after the abstracted plant")
    return NOTHING


def _delays(parser: BodyParser, word: str, _start: int) -> tree.Delays:
    time_by_role: dict[str, tree.SyntaxExpr] = {}
    nodes: list[tuple[tree.DottedPath, tree.SyntaxExpr]] = []
    while True:
        role = parser.texts[parser.i]
        if not (role[:1].isalpha() or role[:1] == "_") or role in time_by_role:
            message = f"expected `dm`, `sc` or a node and a time, found {parser.found()}"
            raise parser.failure("S005", message, helps=(f"write `{word} dm 1ms, sc 1ms;`",))
        if role in ("dm", "sc"):
            parser.i += 1
            time_by_role[role] = parser.time(f"`{role}`")
        else:
            path = parser.path("a node between plant and module")
            nodes.append((path, parser.time(f"`{path.text}`")))
        if not parser.accept(","):
            break
    parser.semicolon(f"the times of `{word}`")
    return tree.Delays(time_by_role.get("dm"), time_by_role.get("sc"), tuple(nodes))


def _acts(parser: BodyParser, _word: str, _start: int) -> tuple[Expr, Expr]:
    """`acts within 10ms;`, or `acts within 1ms to 10ms;`."""
    parser.expect_word("within", "after `acts`")
    least, most = None, parser.time("`within`")
    if parser.texts[parser.i] == "to":
        parser.i += 1
        least, most = most, parser.time("`to`")
    parser.semicolon("`within`")
    return least, most


def _recover(parser: BodyParser, _word: str, start: int) -> tuple[Expr, Span | None]:
    """`recover within 10s;`, or `recover never;`: SC may stop for good."""
    if parser.texts[parser.i] != "never":
        parser.expect_word("within", "after `recover`")
        return parser.time_value("`within`"), None
    parser.i += 1
    parser.semicolon("`recover never`")
    return None, parser.span_from(start)


_CELLS = group(
    _grid_axis, dotted("a topic or one of its fields"), word("in", "after the axis"),
    range_of("the range of the axis"),
    word("/", "and the number of cells after the range of the axis"),
    expr("the number of cells"), _open,
)  # fmt: skip
_RANGE = group(
    lambda place, within: tree.GridAxis(place, within, None),
    dotted("a state or a field of a topic"), maybe("in", range_of("the range of the axis")),
)  # fmt: skip
_ABSTRACTION = group(
    tree.Abstraction, name("the name of an abstraction"),
    word(":", "after the name of the abstraction"), ref("the name of a plant"),
    assign("after the abstract plant"), expr("the abstract state"),
)  # fmt: skip
VIEW_ITEMS: Items = {
    "grid": often("groups", made(tree.AxisGroup, commas(_CELLS), semicolon("the grid"), kind=True)),
    "polytope": often(
        "groups", made(tree.AxisGroup, commas(_RANGE), semicolon("the polytope"), kind=True)
    ),
    "abstracts": often(
        "abstracts",
        only(
            group(
                pair, name("the name of a plant after `abstracts`"), _abstracted,
                commas(_ABSTRACTION), semicolon("the abstractions"),
            )
        ),
    ),
}  # fmt: skip
VERIFY_ITEMS: Items = {
    **VIEW_ITEMS,
    "view": often("views", _view),
    "commands": often(
        "commands",
        made(
            tree.CommandSet, dotted("an output topic or one of its fields"),
            word("in", "after the output"), word("{", "before the commands"),
            commas(expr("a command")), word("}", "after the commands"), semicolon("the commands"),
        ),
    ),
    "core": once("core", only(value("the core"))),
    "enters": once("enters", only(value("where views are entered"))),
    "horizon": once("horizon", only(value("the horizon"))),
    "levels": once("levels", only(value("the levels"))),
    "late": once("late", _delays),
    "response": once("response", _delays),
    "acts": once({"acts_least": None, "acts": None}, _acts, "acts within"),
    "recover": once({"recover": None, "stays": None}, _recover, "recover within", "recover never"),
    "dropout": once("dropout", of_word("time_value")),
    "induction": once("induction", spanned(semicolon("`induction`"))),
    "lemma": often("lemmas", only(expr("the lemma"), semicolon("the lemma"))),
    "progress": often(
        "progress", only(expr("what progress rests on"), semicolon("what progress rests on"))
    ),
}  # fmt: skip

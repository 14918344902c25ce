"""Parses `rta` declarations (modules) and their `verify` blocks.

Purpose: the tables of the items in both bodies, and the readers of these items. A `verify` block
has grids, abstractions, commands and times for `soter verify`.
Non-goals: what the names mean (`language/check/parts/verify_block.py`), well-formedness (P1a, P1b:
`language/elaborate/wellformed.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.syntax import tree
from soter.language.syntax.lexer import NAME, printable
from soter.language.syntax.parsing.declarations import NODE_ITEMS
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
    often,
    once,
    only,
    pair,
    range_of,
    reader_named_by_word,
    ref,
    semicolon,
    spanned,
    time_value,
    value,
    word,
    word_of,
)

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Span
    from soter.language.syntax.parsing.bodies import BodyParser

    Expr = tree.SyntaxExpr | None


def parse_verify(parser: BodyParser, _word: str, start: int) -> tree.VerifyBlock:
    """Parses `verify { ... }` of a module."""
    parts = parser.body("this `verify` block", VERIFY_ITEMS)
    return tree.VerifyBlock(**parts.fields(VERIFY_ITEMS), span=parser.span_from(start))


def _parse_view(parser: BodyParser, _word: str, start: int) -> tree.View:
    name = parser.name("the name of a view")
    parts = parser.body(f"view `{name.text}`", VIEW_ITEMS)
    return tree.View(name, span=parser.span_from(start), **parts.fields(VIEW_ITEMS))


def _parse_open(parser: BodyParser) -> tuple[Expr, bool]:
    """Parses `open` or `open to e`; gives the end `e` of the axis, and whether it has no end."""
    if not parser.accept_word("open"):
        return None, False
    if parser.kinds[parser.i] in (",", ";"):
        return None, True
    parser.expect_word("to", "after `open`")
    return parser.expr("where an open axis ends"), False


def _parse_abstracted(parser: BodyParser) -> object:
    if not parser.is_word("by") and parser.kinds[parser.i : parser.i + 2] == [NAME, NAME]:
        parser.report(
            "S005", f"expected `by` after the abstracted plant, found {parser.found()}", skip=1
        )
    else:
        parser.expect_word("by", "after the abstracted plant")
    return NOTHING


def _parse_delays(parser: BodyParser, word: str, _start: int) -> tree.Delays:
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
    parser.expect_semicolon(f"the times of `{word}`")
    return tree.Delays(time_by_role.get("dm"), time_by_role.get("sc"), tuple(nodes))


def _parse_acts(parser: BodyParser, _word: str, _start: int) -> tuple[Expr, Expr]:
    """Parses `acts within 10ms;` or `acts within 1ms to 10ms;`; gives both times."""
    parser.expect_word("within", "after `acts`")
    least, most = None, parser.time("`within`")
    if parser.texts[parser.i] == "to":
        parser.i += 1
        least, most = most, parser.time("`to`")
    parser.expect_semicolon("`within`")
    return least, most


def _parse_recover(parser: BodyParser, _word: str, start: int) -> tuple[Expr, Span | None]:
    """Parses `recover within 10s;`, or `recover never;`: then SC may stop for good."""
    if parser.texts[parser.i] != "never":
        parser.expect_word("within", "after `recover`")
        return parser.time_value("`within`"), None
    parser.i += 1
    parser.expect_semicolon("`recover never`")
    return None, parser.span_from(start)


_CELLS = group(
    lambda place, within, cells, end: tree.GridAxis(place, within, cells, *end),
    dotted("a topic or one of its fields"), word("in", "after the axis"),
    range_of("the range of the axis"),
    word("/", "and the number of cells after the range of the axis"),
    expr("the number of cells"), _parse_open,
)  # fmt: skip
_ABSTRACTION = group(
    tree.Abstraction, name("the name of an abstraction"),
    word(":", "after the name of the abstraction"), ref("the name of a plant"),
    assign("after the abstract plant"), expr("the abstract state"),
)  # fmt: skip
VIEW_ITEMS: Items = {
    "grid": often("groups", made(tree.AxisGroup, commas(_CELLS), semicolon("the grid"))),
    "abstracts": often(
        "abstracts",
        only(
            group(
                pair, name("the name of a plant after `abstracts`"), _parse_abstracted,
                commas(_ABSTRACTION), semicolon("the abstractions"),
            )
        ),
    ),
}  # fmt: skip
VERIFY_ITEMS: Items = {
    **VIEW_ITEMS,
    "view": often("views", _parse_view),
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
    "late": once("late", _parse_delays),
    "response": once("response", _parse_delays),
    "acts": once({"acts_least": None, "acts": None}, _parse_acts, "acts within"),
    "recover": once(
        {"recover": None, "stays": None}, _parse_recover, "recover within", "recover never"
    ),
    "dropout": once("dropout", reader_named_by_word("time_value")),
    "age": once("age", reader_named_by_word("time_value")),
    "induction": once("induction", spanned(semicolon("`induction`"))),
    "lemma": often("lemmas", only(expr("the lemma"), semicolon("the lemma"))),
    "progress": often(
        "progress", only(expr("what progress rests on"), semicolon("what progress rests on"))
    ),
}  # fmt: skip


def parse_rta(parser: BodyParser) -> tree.Decl:
    """Parses an `rta` declaration: a module."""
    start = parser.starts[parser.take()]
    name = parser.declare("the name of the module")
    parts = parser.body(f"module `{printable(name.text)}`", RTA_ITEMS)
    return tree.RtaDecl(name, parser.span_from(start), **parts.fields(RTA_ITEMS))


def _parse_clause(parser: BodyParser, kind: str, start: int) -> tree.Clause:
    """Parses `assumes name: e;` and `guarantees name: e;`."""
    subject = "the assumption" if kind == "assumes" else "the guarantee"
    if parser.kinds[parser.i] != NAME or parser.kinds[parser.i + 1] != ":":
        raise parser.failure(
            "S005",
            f"expected a name and `:` after `{kind}`, found {parser.found()}",
            notes=("reports tell the clauses of a module's contract by their names",),
            helps=(f"write `{kind} bounded: ...;`",),
        )
    name = parser.name(f"the name of {subject}")
    parser.expect(":", f"after the name of {subject}")
    condition = parser.value(subject)
    return tree.Clause(kind, name, condition, parser.span_from(start))


def _parse_ac(parser: BodyParser, _word: str, _start: int) -> tree.Ref:
    """Parses the AC of a module; reports S026 for `ac module Keep;`."""
    if parser.is_word("module") and parser.kinds[parser.i + 1] == NAME:
        raise parser.failure(
            "S026",
            "a module in the place of another one's AC (`ac module`) is gone since 1.0.0",
            notes=("a module with `rest` may have several plans of SC: `sc Gentle, Hard;`",),
            helps=("name a node, as the AC of that module: what it kept, nobody keeps then",),
        )
    node = parser.ref("the name of a node after `ac`")
    parser.expect_semicolon("the node of `ac`")
    return node


def _parse_sc(parser: BodyParser, _word: str, _start: int) -> tuple[object, tuple[tree.Ref, ...]]:
    """Parses `sc` with a node or several plans, or `sc synthesized period 10ms;` without a node."""
    start = parser.starts[parser.i]
    if parser.is_word("synthesized") and parser.kinds[parser.i + 1] != ".":
        parser.i += 1
        parser.expect_word("period", "after `synthesized`")
        period = parser.time_value("`period`")
        return tree.Synthesized(period, parser.span_from(start)), ()
    plans = commas(ref("the name of a node after `sc`"))(parser)
    parser.expect_semicolon("the node of `sc`")
    return plans[0], plans if len(plans) > 1 else ()


def _parse_returns(parser: BodyParser, _word: str, start: int) -> tree.Returns:
    """Parses the latch: `returns after button;`, or `returns never;`."""
    topic: tree.Ref | None = None
    if not parser.accept_word("never"):
        parser.expect_word("after", "or `never` after `returns`")
        topic = parser.ref("the name of a topic after `returns after`")
    parser.expect_semicolon("`returns`")
    return tree.Returns(topic, parser.span_from(start))


def _parse_shield(
    parser: BodyParser, _word: str, start: int
) -> tuple[object, bool, tree.Ref | None]:
    """Parses `shield 8;`, `shield 8 toward sc;`, `shield;`, or `shield toward plans, sc;`."""
    subject, candidates = "the value of `shield`", None
    no_number = parser.kinds[parser.i] == ";" or (
        parser.texts[parser.i] == "toward" and parser.kinds[parser.i + 1] == NAME
    )
    cells = None if no_number else parser.expr(subject)
    toward = parser.accept_word("toward")
    if toward and not parser.accept_word("sc"):
        candidates = parser.ref("`sc`, or a topic with an array of commands, after `toward`")
        parser.expect(",", "and `sc` after the topic of commands")
        parser.expect_word("sc", "after the topic of commands")
    if cells is None:
        parser.expect_semicolon("`shield`")
        return tree.EachCommand(parser.span_from(start)), toward, candidates
    return parser.up_to_semicolon(cells, subject), toward, candidates


_MOVE = group(
    tree.Move, dotted("a topic or one of its fields"),
    word("by", "and how far, behind what moves"), expr("how far it moves"), word_of("down", "up"),
)  # fmt: skip


RTA_ITEMS: Items = {
    "ac": once("ac", _parse_ac),
    "sc": once({"sc": None, "plans": ()}, _parse_sc),
    "period": once("period", only(time_value("`period`"))),
    "wcet": NODE_ITEMS["wcet"],
    "jitter": NODE_ITEMS["jitter"],
    "safe": once("safe", only(value("the safe condition"))),
    "safer": once("safer", only(value("the safer condition"))),
    "ttf": once("ttf", only(value("the ttf condition"))),
    "clean": once("clean", only(value("the value of `clean`"))),
    "returns": once("returns", _parse_returns, "returns after", "returns never"),
    "shield": once({"shield": None, "toward_sc": False, "candidates": None}, _parse_shield),
    "rest": once(
        "rest",
        made(
            tree.Rest, expr("the condition of `rest`"), maybe("moves", commas(_MOVE), ()),
            word("within", "and a time at the end of `rest`"), time_value("the time of `rest`"),
        ),
    ),
    "failsafe": NODE_ITEMS["failsafe"],
    "assumes": often("contract", _parse_clause),
    "guarantees": often("contract", _parse_clause),
    "verify": once("verify", parse_verify),
}  # fmt: skip

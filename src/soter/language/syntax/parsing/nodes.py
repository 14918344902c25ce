"""Nodes and modules: the `node`, `extern node` and `rta` declarations.

Purpose: their bodies, item by item.
Non-goals: well-formedness of a module (P1a, P1b: `language/elaborate/wellformed.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import remove
from soter.language.syntax import tree
from soter.language.syntax.parsing.instance_arrays import dotted
from soter.language.syntax.parsing.items import (
    Items,
    assign,
    commas,
    each,
    expr,
    group,
    made,
    maybe,
    of_word,
    often,
    once,
    only,
    pair,
    range_of,
    ref,
    semicolon,
    time_value,
    value,
    word,
    word_of,
)
from soter.language.syntax.parsing.verification import verify
from soter.language.syntax.tokens import ERROR, INT, NAME, visible

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Help, Span
    from soter.language.syntax.parsing.bodies import BodyParser


def node(parser: BodyParser) -> tree.Decl:
    """`node` and `extern node`."""
    start = parser.starts[parser.i]
    extern = parser.accept("extern")
    parser.i += 1
    name = parser.declare("the name of the node")
    period, phase, source, source_span = parser.head_of("node", name, extern=extern)
    what = f"node `{visible(name.text)}`"
    parts = parser.body(what, NODE_ITEMS)
    fields = parts.fields(NODE_ITEMS)
    if extern and fields["step"] is not None:
        _misplaced(
            parser,
            "S025",
            f"the extern {what} has a `step`",
            parts.first["step"],
            parser.not_extern(start, source_span),
            remove(parts.first["step"].to(fields["step"].span), "or leave the step out"),
        )
        fields["step"] = None
    if not extern and fields["step"] is None and not parser.damaged:
        _misplaced(
            parser,
            "S024",
            f"{what} has no `step`",
            name.span,
            "add `step { ... }`, or declare it `extern node`",
        )
        parser.damaged = True
    return tree.NodeDecl(
        name,
        parser.span_from(start),
        period=period,
        phase=phase,
        extern=extern,
        source=source,
        source_span=source_span,
        **fields,
    )


def _misplaced(parser: BodyParser, code: Code, message: str, span: Span, *helps: Help) -> None:
    quiet, parser.quiet = parser.quiet, -1
    parser.report(code, message, span, helps=helps)
    parser.quiet = quiet


def _subscribes(parser: BodyParser, _word: str, _start: int) -> Iterator[tree.Subscription]:
    while True:
        start = parser.starts[parser.i]
        topic = parser.ref("the name of a topic")
        queue: int | None = None
        policy: str | None = None
        if parser.accept_word("queue"):
            queue = _count(parser, "the length of the queue")
            policy = _policy(parser)
        yield tree.Subscription(topic, queue, policy, parser.span_from(start))
        if not parser.accept(",") and not parser.forgotten_comma():
            break
    parser.semicolon("the subscriptions")


def _count(parser: BodyParser, what: str) -> int | None:
    i = parser.i
    if parser.kinds[i] == INT and len(parser.texts[i]) <= 9:
        parser.i += 1
        return int(parser.texts[i])
    if parser.kinds[i] in (INT, ERROR):
        parser.report("L005", f"this number is too large for {what}")
        parser.i += 1
        return None
    raise parser.failure("S005", f"expected {what} as a whole number, found {parser.found()}")


def _policy(parser: BodyParser) -> str | None:
    """What a full queue does, where it is said."""
    word = parser.texts[parser.i]
    if word in ("drop_oldest", "drop_newest", "fault"):
        parser.i += 1
        return word
    if parser.kinds[parser.i] != NAME or parser.new_line() or word in parser.items:
        return None
    parser.report(
        "S005",
        f"expected `;` or what a full queue does, found {parser.found()}",
        helps=("the policies are `drop_oldest`, `drop_newest` and `fault`",),
    )
    parser.i += 1
    return None


def _publishes(parser: BodyParser, _word: str, _start: int) -> Iterator[tree.Publication]:
    while True:
        start = parser.starts[parser.i]
        topic = parser.ref("the name of a topic")
        burst = _burst(parser) if parser.kinds[parser.i] == "[" else None
        yield tree.Publication(topic, burst, parser.span_from(start))
        if not parser.accept(",") and not parser.forgotten_comma():
            break
    parser.semicolon("the published topics")


def _burst(parser: BodyParser) -> int | None:
    """`[<=4]`: how many messages a step may publish."""
    parser.tight.append(parser.i)
    parser.i += 1
    if parser.kinds[parser.i] != "<=":
        message = f"expected `<=` before the number of messages, found {parser.found()}"
        helps = ("a topic of which a step may publish up to four messages: `alarm[<=4]`",)
        raise parser.failure("S005", message, helps=helps)
    parser.i += 1
    count = _count(parser, "the number of messages")
    parser.expect("]", "after the number of messages")
    return count


def _local(parser: BodyParser, _word: str, start: int) -> tree.LocalVar:
    name = parser.name("a name after `var`")
    type_ = parser.typed("the variable")
    initial: tree.SyntaxExpr | None = None
    if parser.kinds[parser.i] in ("=", ":=", "=="):
        parser.assign("after the type of the variable")
        initial = parser.value("the initial value")
    else:
        parser.no_initial("the type of the variable")
    return tree.LocalVar(name, type_, initial, parser.span_from(start))


def _takeover(parser: BodyParser, _word: str, _start: int) -> tree.Block:
    parser.expect_word("takeover", "after `on`")
    return parser.block("after `on takeover`")


# ---------------------------------------------------------------- modules


def rta(parser: BodyParser) -> tree.Decl:
    """A module."""
    start = parser.starts[parser.i]
    parser.i += 1
    name = parser.declare("the name of the module")
    parts = parser.body(f"module `{visible(name.text)}`", RTA_ITEMS)
    return tree.RtaDecl(name, parser.span_from(start), **parts.fields(RTA_ITEMS))


def _clause(parser: BodyParser, kind: str, start: int) -> tree.Clause:
    """`assumes name: e;` and `guarantees name: e;`."""
    what = "the assumption" if kind == "assumes" else "the guarantee"
    if parser.kinds[parser.i] != NAME or parser.kinds[parser.i + 1] != ":":
        raise parser.failure(
            "S005",
            f"expected a name and `:` after `{kind}`, found {parser.found()}",
            notes=("reports tell the clauses of a module's contract by their names",),
            helps=(f"write `{kind} bounded: ...;`",),
        )
    name = parser.name(f"the name of {what}")
    parser.expect(":", f"after the name of {what}")
    condition = parser.value(what)
    return tree.Clause(kind, name, condition, parser.span_from(start))


def _controller(parser: BodyParser, word: str, _start: int) -> object:
    """A node; or `ac module Keep;`, itself a module; or `sc synthesized period 10ms;`: none yet."""
    start, following = parser.starts[parser.i], parser.kinds[parser.i + 1]
    if word == "sc" and parser.is_word("synthesized") and following != ".":
        parser.i += 1
        parser.expect_word("period", "after `synthesized`")
        period = parser.time_value("`period`")
        return tree.Synthesized(period, parser.span_from(start))
    if word == "ac" and parser.is_word("module") and following == NAME:
        parser.i += 1
        module = parser.ref("the name of a module after `ac module`")
        controller = tree.ModuleAsAc(module, parser.span_from(start))
        parser.semicolon("the module of `ac`")
        return controller
    node = parser.ref(f"the name of a node after `{word}`")
    parser.semicolon(f"the node of `{word}`")
    return node


def _returns(parser: BodyParser, _word: str, start: int) -> tree.Returns:
    """`returns after button;`, or `returns never;`: the latch."""
    topic: tree.Ref | None = None
    if not parser.accept_word("never"):
        parser.expect_word("after", "or `never` after `returns`")
        topic = parser.ref("the name of a topic after `returns after`")
    parser.semicolon("`returns`")
    return tree.Returns(topic, parser.span_from(start))


def _shield(parser: BodyParser, _word: str, start: int) -> tuple[object, bool]:
    """`shield 8;`, `shield 8 toward sc;`, or `shield;`."""
    what = "the value of `shield`"
    no_number = parser.kinds[parser.i] == ";" or parser.texts[parser.i : parser.i + 2] == [
        "toward",
        "sc",
    ]
    cells = None if no_number else parser.expr(what)
    toward = parser.accept_word("toward")
    if toward:
        parser.expect_word("sc", "after `toward`")
    if cells is None:
        parser.semicolon("`shield`")
        return tree.EachCommand(parser.span_from(start)), toward
    return parser.ended(cells, what), toward


def _moves(parser: BodyParser) -> tuple[tree.Move, ...]:
    """`moves x by d, gap by d down`, or nothing."""
    return maybe("moves", commas(_MOVE))(parser) or ()


_MOVE = group(
    tree.Move, dotted("a topic or one of its fields"),
    word("by", "and how far, behind what moves"), expr("how far it moves"), word_of("down", "up"),
)  # fmt: skip
_FAILSAFE = group(
    pair, ref("the name of a topic"), assign("after the topic of `failsafe`"),
    value("the fail-safe value"),
)  # fmt: skip
_OF_NODES_AND_MODULES: Items = {
    "wcet": once("wcet", of_word("time_value")),
    "jitter": once("jitter", of_word("time_value")),
    "failsafe": often("failsafe", only(_FAILSAFE)),
}
NODE_ITEMS: Items = {
    "subscribes": each("subscribes", _subscribes),
    "publishes": each("publishes", _publishes),
    "takes": once(
        "takes", only(range_of("how long a step takes"), semicolon("how long a step takes"))
    ),
    **_OF_NODES_AND_MODULES,
    "var": often("locals", _local),
    "assumes": often("assumes", only(value("the assumption"))),
    "guarantees": often("guarantees", only(value("the guarantee"))),
    "on": once("takeover", _takeover, "on takeover", told="on takeover"),
    "step": once("step", lambda parser, _word, _start: parser.block("after `step`")),
}
RTA_ITEMS: Items = {
    "ac": once("ac", _controller),
    "sc": once("sc", _controller),
    "period": once("period", only(time_value("`period`"))),
    "wcet": _OF_NODES_AND_MODULES["wcet"],
    "jitter": _OF_NODES_AND_MODULES["jitter"],
    "safe": once("safe", only(value("the safe condition"))),
    "safer": once("safer", only(value("the safer condition"))),
    "ttf": once("ttf", only(value("the ttf condition"))),
    "clean": once("clean", only(value("the value of `clean`"))),
    "returns": once("returns", _returns, "returns after", "returns never"),
    "shield": once({"shield": None, "toward_sc": False}, _shield),
    "rest": once(
        "rest",
        made(
            tree.Rest, expr("the condition of `rest`"), _moves,
            word("within", "and a time at the end of `rest`"), time_value("the time of `rest`"),
        ),
    ),
    "failsafe": _OF_NODES_AND_MODULES["failsafe"],
    "assumes": often("contract", _clause),
    "guarantees": often("contract", _clause),
    "verify": once("verify", verify),
}  # fmt: skip

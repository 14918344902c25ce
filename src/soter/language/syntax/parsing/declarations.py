"""Parses `fun`, `plant` and `node` declarations, and the same with `extern`.

Purpose: reads parameters, result type and body of a function; has the tables of the items of plants
and nodes, and the readers of these items.
Non-goals: statements (`statements.py`), calls (`expressions.py`), well-formedness
(`language/check/`), the arithmetic of integration (`schemes.py`).
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from soter.diagnostics.fixes import remove, replace
from soter.language.syntax import tree
from soter.language.syntax.lexer import EOF, ERROR, INT, NAME, printable
from soter.language.syntax.parsing.instance_arrays import dotted
from soter.language.syntax.parsing.items import (
    Items,
    assign,
    block,
    clauses,
    each,
    equal,
    expr,
    group,
    often,
    once,
    only,
    pair,
    range_of,
    reader_named_by_word,
    ref,
    semicolon,
    time,
    value,
    word,
)
from soter.language.syntax.parsing.token_cursor import Panic
from soter.language.syntax.parsing.types import type_expression
from soter.language.syntax.schemes import SCHEMES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Fix, Help, Span
    from soter.language.syntax.parsing.bodies import BodyParser


def parse_fun(parser: BodyParser) -> tree.Decl:
    """Parses `fun` and `extern fun`."""
    start = parser.starts[parser.i]
    extern = parser.accept("extern")
    parser.i += 1
    name = parser.declare("the name of the function")
    parameters = _parameters(parser)
    result = _parse_result_type(parser, name)
    source, source_span = parser.origin() if extern else parser.refuse_stray_origin("fun")
    body: tree.Block | None = None
    if parser.kinds[parser.i] == "{":
        if extern:
            _report_extern_body(parser, name, parser.fix_without_extern(start, source_span))
        else:
            body = parser.block("after the result type")
    elif extern:
        parser.expect_semicolon("the extern function")
    else:
        body = _parse_function_body(parser)
    return tree.FunDecl(
        name,
        parser.span_from(start),
        parameters=parameters,
        result=result,
        body=body,
        extern=extern,
        source=source,
        source_span=source_span,
    )


def _parse_function_body(parser: BodyParser) -> tree.Block | None:
    """Parses the body of a function; reports a missing `{`."""
    message = f"expected `{{` and the body of the function, found {parser.found()}"
    if parser.kinds[parser.i] == ";":
        parser.report(
            "S005", message, helps=("a function written elsewhere is an `extern fun`",), skip=1
        )
        return None
    parser.report("S005", message)
    parser.damaged = True
    while parser.kinds[parser.i] not in ("{", ";", "}", EOF) and not parser.is_at_declaration():
        parser.i += 1
    if parser.kinds[parser.i] == "{":
        return parser.block("after the result type")
    parser.accept(";")
    return None


def _report_extern_body(parser: BodyParser, name: tree.Name, not_extern: Fix) -> None:
    parser.report(
        "S025",
        f"the extern function `{printable(name.text)}` has a body",
        helps=(not_extern, "or write `;` instead of the body"),
    )
    parser.block("after the result type")


def _parse_result_type(parser: BodyParser, name: tree.Name) -> tree.TypeExpr:
    if parser.kinds[parser.i] in ("->", "=>"):
        parser.report(
            "S015",
            f"expected `:` before the result type, found {parser.found()}",
            helps=(replace(parser.token_span(parser.i), ":", "the result type stands behind `:`"),),
            skip=1,
        )
        return type_expression(parser, "the result type")
    if parser.accept(":"):
        return type_expression(parser, "the result type")
    parser.report(
        "S005",
        f"expected `:` and the result type of `{printable(name.text)}`, found {parser.found()}",
        parser.after_previous(),
        "the result type is missing here",
        notes=("a function computes a value: it always has a result type",),
    )
    return tree.ErrorTypeExpr(parser.after_previous())


def _parameters(parser: BodyParser) -> tuple[tuple[tree.Name, tree.TypeExpr], ...]:
    opener = parser.i
    parser.expect("(", "after the name of the function")
    parameters: list[tuple[tree.Name, tree.TypeExpr]] = []
    if parser.accept(")"):
        return ()
    try:
        while True:
            parameters.append(_parameter(parser))
            if parser.accept(")"):
                break
            if not parser.accept(","):
                also = ((parser.token_span(opener), "opened here"),)
                message = f"expected `,` or `)` after the parameter, found {parser.found()}"
                raise parser.failure("S005", message, also=also)
            if parser.kinds[parser.i] == ")":
                parser.report("S005", "expected a parameter after `,`, found `)`", skip=1)
                break
    except Panic:
        parser.damaged = True
        while parser.kinds[parser.i] not in (")", "{", ";", "}", EOF):
            parser.i += 1
        parser.quiet = parser.i
        parser.accept(")")
    return tuple(parameters)


def _parameter(parser: BodyParser) -> tuple[tree.Name, tree.TypeExpr]:
    i = parser.i
    if parser.kinds[i + 1] == NAME and parser.kinds[i] in ("float", "int", "bool", NAME):
        written = f"{parser.texts[i + 1]}: {parser.texts[i]}"
        parser.report(
            "S005",
            f"expected `:` after the name of the parameter, found `{parser.texts[i + 1]}`",
            parser.token_span(i),
            helps=(f"the name comes first: write `{printable(written)}`",),
            skip=1,
        )
        name = parser.name("the name of a parameter")
        return name, tree.ErrorTypeExpr(name.span)
    name = parser.name("the name of a parameter")
    return name, parser.typed(f"the parameter `{printable(name.text)}`")


_ONE_DRIVES = "write one `drives` for each topic"


def parse_plant(parser: BodyParser) -> tree.Decl:
    """Parses `plant` and `extern plant`."""
    start = parser.starts[parser.i]
    extern = parser.accept("extern")
    parser.i += 1
    name = parser.declare("the name of the plant")
    period, _, source, source_span = parser.parse_head_of("plant", name, extern=extern)
    items = EXTERN_PLANT_ITEMS if extern else PLANT_ITEMS
    parts = parser.body(f"plant `{printable(name.text)}`", items)
    return tree.PlantDecl(
        name,
        parser.span_from(start),
        period=period,
        extern=extern,
        source=source,
        source_span=source_span,
        **parts.fields(items),
    )


def _parse_reads(parser: BodyParser, _word: str, _start: int) -> Iterator[tree.Ref]:
    yield from parser.refs("the name of a topic")
    parser.expect_semicolon("the read topics")


def _parse_drives(
    parser: BodyParser, word: str, start: int, *, extern: bool = False
) -> Iterator[tuple[tree.Ref, tree.SyntaxExpr | None]]:
    """Yields (topic, value) of `topic = value;`; several pairs if wrong commas replace the `;`."""
    topic = parser.ref("the name of a topic")
    value: tree.SyntaxExpr | None = None
    if parser.kinds[parser.i] in ("=", ":=", "=="):
        parser.assign("after the driven topic")
        value = parser.expr("the driven value")
        if parser.kinds[parser.i] == "," and parser.kinds[parser.i + 1] == NAME:
            parser.report_missing_semicolon("the driven value", (_ONE_DRIVES,))
            yield topic, value
            parser.i += 1
            yield from _parse_drives(parser, word, start, extern=extern)
            return
        value = parser.up_to_semicolon(value, "the driven value")
    elif parser.kinds[parser.i] == ",":
        message = "expected `;` after the driven topic, found `,`"
        parser.report("S005", message, helps=(_ONE_DRIVES,))
        parser.damaged = True
        parser.skip_statement()
    elif extern:
        parser.expect_semicolon("the driven topic")
    else:
        parser.report(
            "S024" if parser.kinds[parser.i] == ";" else "S005",
            f"expected `=` and a value after the driven topic, found {parser.found()}",
            helps=("only an extern plant drives a topic without saying what",),
        )
        value = tree.ErrorExpr(topic.span)
        parser.skip_statement()
    yield topic, value


_OF_A_STATE = {
    "in": range_of("the initial range"),
    "=": equal("before the initial value", "the initial value"),
}
_OF_A_DISTURBANCE = {"in": range_of("the range of the disturbance"), "hold": time("`hold`")}


def _parse_state(parser: BodyParser, _word: str, start: int) -> tree.PlantState:
    name = parser.name("the name of a state")
    type_ = parser.typed("the state")
    found = clauses(parser, "state", _OF_A_STATE)
    interval, initial = found.get("in"), found.get("=")
    if initial is not None:
        initial = parser.up_to_semicolon(initial, "the initial value")
    else:
        parser.require_no_initial("the type of the state")
    return tree.PlantState(name, type_, interval, initial, parser.span_from(start))


def _parse_disturbance(parser: BodyParser, _word: str, start: int) -> tree.DisturbanceItem:
    name = parser.name("the name of a disturbance")
    type_ = parser.typed("the disturbance")
    found = clauses(parser, "disturbance", _OF_A_DISTURBANCE)
    interval = found.get("in")
    if interval is None and isinstance(type_, tree.RangedIntType):
        # `int in [a, b]` reads as a type first; here the range is the disturbance's.
        interval = type_.interval
        type_ = tree.BuiltinType(type_.span, "int")
    elif interval is None:
        message = f"expected `in` and a range after the disturbance, found {parser.found()}"
        notes = ("a proof needs the bound of every disturbance",)
        helps = (f"write `disturbance {name.text}: float in [-1.0, 1.0];`: the worst it can be",)
        parser.report("S005", message, notes=notes, helps=helps)
        error = tree.ErrorExpr(parser.after_previous())
        interval = tree.IntervalExpr(error, error, error.span)
    parser.expect_semicolon("the disturbance")
    return tree.DisturbanceItem(name, type_, interval, found.get("hold"), parser.span_from(start))


def _parse_plant_let(parser: BodyParser, _word: str, _start: int) -> Iterator[tree.PlantLet]:
    parser.i -= 1
    statement = parser.let()
    if isinstance(statement, tree.LetStmt):
        yield tree.PlantLet(statement.name, statement.type, statement.value, statement.span)


def _parse_equation(
    parser: BodyParser, word: str, _start: int
) -> tuple[tree.Name, tree.SyntaxExpr]:
    name = parser.name(f"the name of a state after `{word}`")
    return name, parser.assigned_value("the state", "the equation")


def _parse_integrate(
    parser: BodyParser, _word: str, _start: int
) -> tuple[str, tree.SyntaxExpr | None]:
    method = parser.texts[parser.i]
    if method not in SCHEMES:
        names = " or ".join(f"`{name}`" for name in SCHEMES)
        raise parser.failure("S005", f"expected {names} after `integrate`, found {parser.found()}")
    parser.i += 1
    substeps = parser.expr("the number of substeps") if parser.accept_word("substeps") else None
    parser.expect_semicolon("the method of integration")
    return method, substeps


_BOUND = group(
    pair, dotted("a topic or one of its fields"), word("within", "after the measured value"),
    expr("the bound of the error"),
)  # fmt: skip


def _parse_measured(
    parser: BodyParser, _word: str, _start: int
) -> Iterator[tuple[tree.DottedPath, tree.SyntaxExpr]]:
    while True:
        yield _BOUND(parser)
        if not parser.accept(","):
            break
    parser.expect_semicolon("the measurement bounds")


PLANT_ITEMS: Items = {
    "reads": each("reads", _parse_reads),
    "drives": each("drives", _parse_drives),
    "state": often("states", _parse_state),
    "disturbance": often("disturbances", _parse_disturbance),
    "let": each("lets", _parse_plant_let),
    "der": often("der", _parse_equation),
    "next": often("next", _parse_equation),
    "integrate": once("integrate", _parse_integrate),
    "measured": each("measured", _parse_measured),
}
EXTERN_PLANT_ITEMS: Items = {
    **PLANT_ITEMS,
    "drives": each("drives", partial(_parse_drives, extern=True)),
}


def parse_node(parser: BodyParser) -> tree.Decl:
    """Parses `node` and `extern node`."""
    start = parser.starts[parser.i]
    extern = parser.accept("extern")
    parser.i += 1
    name = parser.declare("the name of the node")
    period, phase, source, source_span = parser.parse_head_of("node", name, extern=extern)
    subject = f"node `{printable(name.text)}`"
    parts = parser.body(subject, NODE_ITEMS)
    fields = parts.fields(NODE_ITEMS)
    if extern and fields["step"] is not None:
        _report_always(
            parser,
            "S025",
            f"the extern {subject} has a `step`",
            parts.first["step"],
            parser.fix_without_extern(start, source_span),
            remove(parts.first["step"].to(fields["step"].span), "or leave the step out"),
        )
        fields["step"] = None
    if not extern and fields["step"] is None and not parser.damaged:
        _report_always(
            parser,
            "S024",
            f"{subject} has no `step`",
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


def _report_always(parser: BodyParser, code: Code, message: str, span: Span, *helps: Help) -> None:
    quiet, parser.quiet = parser.quiet, -1
    parser.report(code, message, span, helps=helps)
    parser.quiet = quiet


def _parse_subscribes(parser: BodyParser, _word: str, _start: int) -> Iterator[tree.Subscription]:
    while True:
        start = parser.starts[parser.i]
        topic = parser.ref("the name of a topic")
        queue: int | None = None
        policy: str | None = None
        if parser.accept_word("queue"):
            queue = _parse_count(parser, "the length of the queue")
            policy = _parse_policy(parser)
        yield tree.Subscription(topic, queue, policy, parser.span_from(start))
        if not parser.accept(",") and not parser.accept_forgotten_comma():
            break
    parser.expect_semicolon("the subscriptions")


def _parse_count(parser: BodyParser, subject: str) -> int | None:
    i = parser.i
    if parser.kinds[i] == INT and len(parser.texts[i]) <= 9:
        parser.i += 1
        return int(parser.texts[i])
    if parser.kinds[i] in (INT, ERROR):
        parser.report("L005", f"this number is too large for {subject}", skip=1)
        return None
    raise parser.failure("S005", f"expected {subject} as a whole number, found {parser.found()}")


def _parse_policy(parser: BodyParser) -> str | None:
    """Parses the policy for a full queue; None if the program does not declare a policy."""
    word = parser.texts[parser.i]
    if word in ("drop_oldest", "drop_newest", "fault"):
        parser.i += 1
        return word
    if parser.kinds[parser.i] != NAME or parser.is_on_new_line() or word in parser.items:
        return None
    parser.report(
        "S005",
        f"expected `;` or what a full queue does, found {parser.found()}",
        helps=("the policies are `drop_oldest`, `drop_newest` and `fault`",),
        skip=1,
    )
    return None


def _parse_publishes(parser: BodyParser, _word: str, _start: int) -> Iterator[tree.Publication]:
    while True:
        start = parser.starts[parser.i]
        topic = parser.ref("the name of a topic")
        burst = _parse_burst(parser) if parser.kinds[parser.i] == "[" else None
        yield tree.Publication(topic, burst, parser.span_from(start))
        if not parser.accept(",") and not parser.accept_forgotten_comma():
            break
    parser.expect_semicolon("the published topics")


def _parse_burst(parser: BodyParser) -> int | None:
    """Parses `[<=4]`, the number of messages that a step may publish on a topic."""
    parser.tight.append(parser.take())
    if parser.kinds[parser.i] != "<=":
        message = f"expected `<=` before the number of messages, found {parser.found()}"
        helps = ("a topic of which a step may publish up to four messages: `alarm[<=4]`",)
        raise parser.failure("S005", message, helps=helps)
    parser.i += 1
    count = _parse_count(parser, "the number of messages")
    parser.expect("]", "after the number of messages")
    return count


def _parse_local(parser: BodyParser, _word: str, start: int) -> tree.LocalVar:
    name = parser.name("a name after `var`")
    type_ = parser.typed("the variable")
    initial: tree.SyntaxExpr | None = None
    if parser.kinds[parser.i] in ("=", ":=", "=="):
        initial = parser.assigned_value("the type of the variable", "the initial value")
    else:
        parser.require_no_initial("the type of the variable")
    return tree.LocalVar(name, type_, initial, parser.span_from(start))


_FAILSAFE = group(
    pair, ref("the name of a topic"), assign("after the topic of `failsafe`"),
    value("the fail-safe value"),
)  # fmt: skip
NODE_ITEMS: Items = {
    "subscribes": each("subscribes", _parse_subscribes),
    "publishes": each("publishes", _parse_publishes),
    "takes": once(
        "takes", only(range_of("how long a step takes"), semicolon("how long a step takes"))
    ),
    "wcet": once("wcet", reader_named_by_word("time_value")),
    "jitter": once("jitter", reader_named_by_word("time_value")),
    "failsafe": often("failsafe", only(_FAILSAFE)),
    "var": often("locals", _parse_local),
    "assumes": often("assumes", only(value("the assumption"))),
    "guarantees": often("guarantees", only(value("the guarantee"))),
    "on": once(
        "takeover",
        only(word("takeover", "after `on`"), block("after `on takeover`")),
        "on takeover",
        title="on takeover",
    ),
    "step": once("step", only(block("after `step`"))),
}

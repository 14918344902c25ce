"""Functions: the `fun` and `extern fun` declarations.

Purpose: their parameters, result type and body.
Non-goals: statements (`statements.py`); calls (`expressions.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fix import replace
from soter.language.syntax import tree
from soter.language.syntax.parsing.token_cursor import Panic
from soter.language.syntax.parsing.types import type_expression
from soter.language.syntax.tokens import EOF, NAME, visible

if TYPE_CHECKING:
    from soter.diagnostics.fix import Fix
    from soter.language.syntax.parsing.bodies import BodyParser


def fun(parser: BodyParser) -> tree.Decl:
    """`fun` and `extern fun`."""
    start = parser.starts[parser.i]
    extern = parser.accept("extern")
    parser.i += 1
    name = parser.declare("the name of the function")
    parameters = _parameters(parser)
    result = _result_type(parser, name)
    source, source_span = parser.origin() if extern else parser.stray_origin("fun")
    body: tree.Block | None = None
    if parser.kinds[parser.i] == "{":
        if extern:
            _extern_body(parser, name, parser.not_extern(start, source_span))
        else:
            body = parser.block("after the result type")
    elif extern:
        parser.semicolon("the extern function")
    else:
        body = _function_body(parser)
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


def _function_body(parser: BodyParser) -> tree.Block | None:
    """A function without its `{`."""
    message = f"expected `{{` and the body of the function, found {parser.found()}"
    if parser.kinds[parser.i] == ";":
        parser.report("S005", message, helps=("a function written elsewhere is an `extern fun`",))
        parser.i += 1
        return None
    parser.report("S005", message)
    parser.damaged = True
    while parser.kinds[parser.i] not in ("{", ";", "}", EOF) and not parser.at_declaration():
        parser.i += 1
    if parser.kinds[parser.i] == "{":
        return parser.block("after the result type")
    parser.accept(";")
    return None


def _extern_body(parser: BodyParser, name: tree.Name, not_extern: Fix) -> None:
    parser.report(
        "S025",
        f"the extern function `{visible(name.text)}` has a body",
        helps=(not_extern, "or write `;` instead of the body"),
    )
    parser.block("after the result type")


def _result_type(parser: BodyParser, name: tree.Name) -> tree.TypeExpr:
    if parser.kinds[parser.i] in ("->", "=>"):
        parser.report(
            "S015",
            f"expected `:` before the result type, found {parser.found()}",
            helps=(replace(parser.token_span(parser.i), ":", "the result type stands behind `:`"),),
        )
        parser.i += 1
        return type_expression(parser, "the result type")
    if parser.accept(":"):
        return type_expression(parser, "the result type")
    parser.report(
        "S005",
        f"expected `:` and the result type of `{visible(name.text)}`, found {parser.found()}",
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
            kind = parser.kinds[parser.i]
            if kind == ")":
                parser.i += 1
                break
            if kind == "," and parser.kinds[parser.i + 1] != ")":
                parser.i += 1
                continue
            also = ((parser.token_span(opener), "opened here"),)
            message = f"expected `,` or `)` after the parameter, found {parser.found()}"
            if kind == ",":
                parser.i += 1
                message = "expected a parameter after `,`, found `)`"
                parser.report("S005", message)
                parser.i += 1
                break
            raise parser.failure("S005", message, also=also)
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
            helps=(f"the name comes first: write `{visible(written)}`",),
        )
        parser.i += 1
        name = parser.name("the name of a parameter")
        return name, tree.ErrorTypeExpr(name.span)
    name = parser.name("the name of a parameter")
    return name, parser.typed(f"the parameter `{visible(name.text)}`")

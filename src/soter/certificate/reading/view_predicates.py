"""One view of a module, read again: the parts of its predicates that its plants show.

Purpose: `module_in_view` gives the module with those parts, `shown_part_of_enters` those of
`enters`; `why_views_leave_out` says what no view of a certificate shows; `without_ages` is `ttf`
without the parts that ask for an age.
Non-goals: sharing code with `language/elaborate/views_for_proofs.py` and
`verify/problem/supported_constructs.py`, which the prover goes by.

A part is what must hold beside the others: of `safe` and `safer` as they are, of "not `ttf`". A
view shows a part if its plants drive every topic in it. Dropping a part of what the DM finds makes
the hypothesis of P3 weaker, so what is shown is shown of more states; a part of `safe` or of
`safer` that is dropped here must be shown elsewhere, or nothing is said about it.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from soter.certificate.report import NotRecheckedError
from soter.language.model import typed
from soter.language.model.tree_walk import nodes, rewritten, topic_reads
from soter.language.model.types import BOOL

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Module

    Part = tuple[typed.TypedExpr, bool]
    """An expression, and whether it must hold (True) or must not (False)."""


def module_in_view(module: Module, name: str) -> Module:
    """The module with the parts that view `name` shows; `NotRecheckedError` where it has none."""
    symbol = module.symbol
    named = [v for v in symbol.verify.views if v.name == name]
    if len(named) != 1:
        raise NotRecheckedError(f"module `{module.name}` has no view `{name}`")
    if symbol.ttf is None or symbol.safer is None:
        raise NotRecheckedError("predicates that are computed, in several views")
    block = named[0].block
    shown = _shown_topics(block)
    values = {
        **vars(symbol),
        "verify": block,
        "safe": _shown_conjunction(symbol.safe, shown, wanted=True),
        "safer": _shown_conjunction(symbol.safer, shown, wanted=True),
        "ttf": _negation(_shown_conjunction(symbol.ttf, shown, wanted=False)),
    }
    return dataclasses.replace(module, symbol=typed.ModuleSymbol(**values))


def shown_part_of_enters(
    symbol: typed.ModuleSymbol, block: typed.TypedVerifyBlock
) -> typed.TypedExpr | None:
    """The parts of `enters` that read only what the plants of a view drive; None: no `enters`.

    All of `enters` implies it. True where no part reads these topics alone.
    """
    if symbol.verify.enters is None:
        return None
    return _shown_conjunction(symbol.verify.enters, _shown_topics(block), wanted=True)


def why_views_leave_out(symbol: typed.ModuleSymbol, views: Collection[str]) -> str:
    """Why these views of a module together do not show all of it; "" where they do."""
    for view in symbol.verify.views:
        if view.name not in views:
            return f"view `{view.name}` of module `{symbol.name}` is not there"
    every = [_shown_topics(view.block) for view in symbol.verify.views]
    for name, predicate in (("safe", symbol.safe), ("safer", symbol.safer)):
        if predicate is None:
            return f"module `{symbol.name}` has views and no `{name}`"
        for part in _required_parts(predicate, wanted=True):
            if not any(_reads_only(part, shown) for shown in every):
                return f"no view of module `{symbol.name}` shows a part of `{name}`"
    return ""


def without_ages(ttf: typed.TypedExpr) -> typed.TypedExpr:
    """`ttf` without what reads an age; as it is where that is all.

    "Not ttf" asks that every part be false: without some it is weaker, and more is shown.
    """
    parts = _required_parts(ttf, wanted=False)
    rest = [p for p in parts if not any(isinstance(n, typed.AgeRead) for n in nodes([p[0]]))]
    return _joined("||", ttf.span, rest, wanted=False) if rest else ttf


def _shown_topics(block: typed.TypedVerifyBlock) -> set[typed.TopicSymbol]:
    return {topic for link in block.abstracts for topic, _ in link.plant.drives}


def _reads_only(part: Part, shown: Collection[typed.TopicSymbol]) -> bool:
    return all(topic in shown for topic in topic_reads(part[0]))


def _required_parts(e: typed.TypedExpr, *, wanted: bool) -> Iterator[Part]:
    """The parts that must all hold for `e` to be `wanted`."""
    if isinstance(e, typed.TypedUnary) and e.op == "!":
        yield from _required_parts(e.operand, wanted=not wanted)
    elif isinstance(e, typed.TypedBinary) and e.op == ("&&" if wanted else "||"):
        yield from _required_parts(e.left, wanted=wanted)
        yield from _required_parts(e.right, wanted=wanted)
    elif isinstance(e, typed.TypedCall) and (body := _body(e)) is not None:
        parts = list(_required_parts(body, wanted=wanted))
        yield from parts if len(parts) > 1 else [(e, wanted)]
    else:
        yield e, wanted


def _body(call: typed.TypedCall) -> typed.TypedExpr | None:
    """The expression that a function returns, arguments put in; None where it does more."""
    steps = call.fun.body or ()
    only = steps[0] if len(steps) == 1 else None
    if not isinstance(only, typed.TypedReturn):
        return None
    value = {id(p): a for p, a in zip(call.fun.parameters, call.arguments, strict=True)}

    def filled(e: Any) -> Any:  # noqa: ANN401 - any expression
        return value.get(id(e.variable), e) if isinstance(e, typed.VarRead) else e

    expansion: typed.TypedExpr = rewritten(only.value, filled)
    return expansion


def _shown_conjunction(
    e: typed.TypedExpr, shown: set[typed.TopicSymbol], *, wanted: bool
) -> typed.TypedExpr:
    """The expression that all parts of `e` hold which are shown; true where there are none."""
    own = [part for part in _required_parts(e, wanted=wanted) if _reads_only(part, shown)]
    return _joined("&&", e.span, own, wanted=True)


def _joined(op: str, span: Span, parts: Sequence[Part], *, wanted: bool) -> typed.TypedExpr:
    """The parts joined by `op`; each as it is where its truth is `wanted`, else negated."""
    joined: typed.TypedExpr = typed.Literal(BOOL, span, value=op == "&&")
    for e, truth in parts:
        joined = typed.TypedBinary(BOOL, span, op, joined, e if truth == wanted else _negation(e))
    return joined


def _negation(e: typed.TypedExpr) -> typed.TypedExpr:
    return typed.TypedUnary(BOOL, e.span, "!", e)

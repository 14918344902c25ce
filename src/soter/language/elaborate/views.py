"""A module as one of its views sees it: a part of its predicates, on plants of the view.

Purpose: one vehicle, several verification plants (docs/proof.md, Views). A view speaks of the
topics that its plants drive; it keeps what `safe`, `ttf` and `safer` say about those alone. Every
part of `safe` and of `safer` has to be kept by some view (R023); a part of `ttf` that none keeps is
dropped, which makes a proof harder, not wrong.
Non-goals: proofs; the re-checker has its own (`certificate/reading/view_predicates.py`), on
purpose.
"""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.elaborate.derived_systems import with_module
from soter.language.evaluate.conjuncts import conjuncts, disjuncts
from soter.language.model import typed
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import BOOL

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import Module, System

Topics = frozenset[typed.TopicSymbol]


def systems_by_view(flat: System, module: Module) -> list[tuple[System, Module]]:
    """The module with its system, once for each of its views; itself where it has none.

    Raises `SoterError` R023 where the views together are not the module.
    """
    symbol = module.symbol
    if not symbol.verify.views:
        return [(flat, module)]
    _judge(symbol)
    return [_seen(flat, module, view) for view in symbol.verify.views]


def refuse_views(module: Module) -> None:
    """`SoterError` R023 for a module with views, where one set of plants is looked at."""
    if not module.symbol.verify.views:
        return
    diagnostics = Diagnostics()
    names = ", ".join(f"`{v.name}`" for v in module.symbol.verify.views)
    diagnostics.error(
        "R023",
        f"module `{module.name}` is proved in views, and has no plants of its own",
        module.symbol.verify.span or module.symbol.span,
        notes=(f"its views are {names}; monitors and advice look at one set of plants",),
        helps=("`soter verify` takes them one by one",),
    )
    raise SoterError(diagnostics.items)


def speaks_of(block: typed.TypedVerifyBlock) -> Topics:
    """The topics that the plants of a view drive."""
    return frozenset(topic for link in block.abstracts for topic, _ in link.plant.drives)


def _seen(flat: System, module: Module, view: typed.ViewSymbol) -> tuple[System, Module]:
    symbol, topics = module.symbol, speaks_of(view.block)
    assert symbol.ttf is not None
    assert symbol.safer is not None
    enters = symbol.verify.enters
    if enters is not None:
        enters = _joined("&&", _kept(conjuncts(enters), topics), enters)
    part = replace(
        symbol,
        verify=replace(view.block, enters=enters),
        safe=_joined("&&", _kept(conjuncts(symbol.safe), topics), symbol.safe),
        ttf=_joined("||", _kept(disjuncts(symbol.ttf), topics), symbol.ttf),
        safer=_joined("&&", _kept(conjuncts(symbol.safer), topics), symbol.safer),
    )
    module_view = replace(module, symbol=part, view=view.name, whole=symbol)
    return with_module(flat, module_view), module_view


def _kept(parts: Iterable[typed.TypedExpr], topics: Topics) -> list[typed.TypedExpr]:
    return [e for e in parts if topics.issuperset(topic_reads(e))]


def _joined(op: str, parts: list[typed.TypedExpr], whole: typed.TypedExpr) -> typed.TypedExpr:
    """Nothing to join: true for `&&`, false for `||`."""
    if not parts:
        return typed.Literal(BOOL, whole.span, op == "&&")
    return reduce(lambda a, b: typed.TypedBinary(BOOL, whole.span, op, a, b), parts)


def _judge(symbol: typed.ModuleSymbol) -> None:
    """R023: what `verify` says beside views, and what no view keeps."""
    diagnostics, verify = Diagnostics(), symbol.verify
    if verify.groups or verify.abstracts or verify.core or verify.induction or verify.commands:
        diagnostics.error(
            "R023",
            f"`verify` of module `{symbol.name}` has views, and a proof of its own",
            verify.span or symbol.span,
            helps=("put every `grid`, `polytope` and `abstracts` into a view",),
        )
    for view in verify.views:
        if not view.block.abstracts:
            diagnostics.error(
                "R023",
                f"view `{view.name}` has no plant",
                view.span,
                helps=("say which one: `abstracts d by m: Model = ...;`",),
            )
    for name, predicate in (("ttf", symbol.ttf), ("safer", symbol.safer)):
        if predicate is None:
            diagnostics.error(
                "R023",
                f"module `{symbol.name}` has views and no `{name}`",
                symbol.span,
                notes=("no predicates are computed for several views",),
                helps=(f"write `{name}`",),
            )
    every = [speaks_of(view.block) for view in verify.views]
    for name, predicate in (("safe", symbol.safe), ("safer", symbol.safer)):
        for part in conjuncts(predicate) if predicate is not None else ():
            if not any(_kept([part], topics) for topics in every):
                read = ", ".join(f"`{t.name}`" for t in dict.fromkeys(topic_reads(part)))
                diagnostics.error(
                    "R023",
                    f"no view speaks of this part of `{name}`",
                    part.span,
                    f"it reads {read}",
                    notes=("a view speaks of the topics that its plants drive, of all at once",),
                    helps=("write it as parts joined by `&&`, each about topics of one view",),
                )
    diagnostics.raise_errors()

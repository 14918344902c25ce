"""Maps: `static` topics that `safe` of a module with `rest` reads and no plant drives.

Purpose: which topics they are, what is refused of them, and their contract as an assumption
("Decisions by tubes" in docs/proof.md, condition 7).
Non-goals: the check that reads them (`verify/tubes/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import FloatType, leaves
from soter.verify.problem.assumption import Assumption

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model import typed
    from soter.language.model.system import Module, System
    from soter.verify.problem.verification_system import VerificationSystem


def map_topics(system: System, module: Module) -> dict[typed.TopicSymbol, int]:
    """Those of a module, in the order in which `safe` reads them; none without `rest`."""
    if module.symbol.rest is None:
        return {}
    at = module.scope.topics
    other = _driven(system).union(module.outputs)
    read = topic_reads(module.symbol.safe)
    return {t: at[t] for t in read if t.static and at[t] not in other}


def maps_of(place: VerificationSystem) -> dict[typed.TopicSymbol, int]:
    """The same of a verification system; not what a plant drives that only flies."""
    flying = _driven(place.flat)
    found = map_topics(place.system, place.module)
    return {t: index for t, index in found.items() if place.flying(t) not in flying}


def _driven(system: System) -> set[int]:
    """Topics that its plants drive."""
    plants = [(c, c.plant) for c in system.components if c.plant is not None]
    return {c.scope.topics[t] for c, plant in plants for t, _ in plant.drives}


def check_maps(place: VerificationSystem, diagnostics: Diagnostics) -> None:
    """Report what is no map, though it is read as one."""
    rest, node = place.module.symbol.rest, place.flat.components[place.home.sc].node
    by_sc = {} if node is None else topic_reads(*node.step)
    at_rest = {} if rest is None else topic_reads(rest.condition)
    for symbol, index in maps_of(place).items():
        topic = place.system.topics[index]
        for who, reads in (("SC", by_sc), ("`rest`", at_rest)):
            if symbol in reads:
                diagnostics.error(
                    "R007",
                    f"{who} reads `{topic.name}`, a map of `safe`",
                    reads[symbol].span,
                    also=((symbol.span, "declared here"),),
                    notes=("a verdict is about one map, and SC would read later ones",),
                    helps=("leave it to `safe` and AC",),
                )
        if topic.max_age_ns is None:
            diagnostics.error(
                "R011",
                f"nothing bounds the age of the map `{topic.name}`",
                symbol.span,
                notes=("until it is published, and when it is no more, AC must not have control",),
                helps=("declare it: `topic ... max_age 1s;`",),
            )
        parts = leaves(topic.type)
        floats = all("[]" not in path and isinstance(of, FloatType) for path, of in parts)
        if topic.queue_of is not None or not floats:
            diagnostics.error(
                "R014",
                f"the map `{topic.name}` is not made of floats",
                symbol.span,
                f"its type is `{topic.type}`",
                notes=("a check takes as many numbers each time",),
                helps=("an array of as many as are looked at; what it leaves out is occupied",),
            )


def assumed_of_maps(place: VerificationSystem) -> list[Assumption]:
    """The contract of each map."""
    names = [place.system.topics[index].name for index in maps_of(place).values()]
    return [
        Assumption(
            f"map {name}",
            f"where `safe` holds with a value of {name}, with its default at the start, it is safe "
            "for ever: what it calls free stays free",
        )
        for name in names
    ]

"""Who keeps a topic in its declared set: the part of some module's `safe` that says so.

Purpose: `topic_contract_of`, `publisher_of`: what moves a plant of one module may be what another
module guarantees (docs/proof.md, Composition).
Non-goals: whether that module is proved: the report holds the two against each other.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.check.constants import Calculator
from soter.language.evaluate.conjuncts import conjuncts
from soter.language.model import typed
from soter.language.model.system import modules_above
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import RecordType, leaf_count
from soter.verify.problem.verification_system import place

if TYPE_CHECKING:
    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type

TURNED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}


def topic_contract_of(flat: System, topic: int, leaf: int, low: float, high: float) -> str:
    """The module whose `safe` keeps a leaf that a plant drives within [low, high]; "": none.

    What is published is off by the measurement error, so `safe` has to leave room for that.
    """
    error = sum(
        m.bound for c in flat.components for m in c.measured if (m.topic, m.leaf) == (topic, leaf)
    )
    for module in at_all_times(flat):
        least, most = _kept(module, topic, leaf)
        if least - error >= low and most + error <= high:
            return module.name
    return ""


def at_all_times(flat: System) -> list[Module]:
    """Modules whose theorem speaks of all times: below another one it does not."""
    return [m for m in flat.modules if not modules_above(flat, m.index)]


def publisher_of(flat: System, plant: Component) -> str:
    """The module whose proof is about a plant that flies; "": none, or one that is forced.

    What that plant publishes lies in its sets wherever the proof holds: it is part of its C.
    """
    for module in at_all_times(flat):
        verify = module.symbol.verify
        if module.forced is not None or verify.induction is not None or verify.abstracts:
            continue
        try:
            there = place(flat, module)
        except SoterError:
            continue
        if any(c.name == plant.name for c in there.plants):
            return module.name
    return ""


def _kept(module: Module, topic: int, leaf: int) -> tuple[float, float]:
    """What the parts of `safe` say of a leaf by themselves."""
    symbol = module.whole or module.symbol
    low, high = -math.inf, math.inf
    calculator = Calculator(Diagnostics(), module.scope.params)
    for part in conjuncts(symbol.safe):
        if not isinstance(part, typed.TypedBinary) or part.op not in TURNED:
            continue
        for said, op, bound in (
            (part.left, part.op, part.right),
            (part.right, TURNED[part.op], part.left),
        ):
            if _leaf(module, said) != (topic, leaf) or topic_reads(bound):
                continue
            value = calculator.value(bound, "a bound")
            if not isinstance(value, float):
                continue
            if op in ("<", "<="):
                high = min(high, value)
            else:
                low = max(low, value)
    return low, high


def _leaf(module: Module, e: typed.TypedExpr) -> tuple[int, int] | None:
    """A leaf of a topic, as (topic, number of the leaf), where an expression is just that."""
    path: list[int] = []
    while isinstance(e, typed.TypedField):
        path.append(e.index)
        e = e.target
    if not isinstance(e, typed.TopicRead) or e.topic not in module.scope.topics:
        return None
    leaf, t = 0, e.topic.type
    for index in reversed(path):
        assert isinstance(t, RecordType)
        fields: list[Type] = [f for _, f in t.fields]
        leaf, t = leaf + sum(leaf_count(f) for f in fields[:index]), fields[index]
    return (module.scope.topics[e.topic], leaf) if leaf_count(t) == 1 else None

"""What `margin(M)` reads: what the decision module of M saw when it looked last.

Purpose: the topic of a module whose margin somebody reads. Its value says for how many periods
from that look on AC surely keeps control (`Module.looks_left`), its stamp when the look was.
Non-goals: how many these are (`verify/deploy/computed_predicates.py`), what is made of them
(`Module.margin_ns`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.system import Bound, Topic
from soter.language.model.typed import TopicSymbol
from soter.language.model.types import IntType

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import Module


def make_margin_topics(read: Iterable[int], modules: list[Module], first: int) -> list[Topic]:
    """A topic for every module of which somebody reads the margin, numbered from `first` on.

    `read`: indices of modules. Enters the topics' numbers in the modules.
    """
    made: list[Topic] = []
    for index in sorted(set(read)):
        module = modules[index]
        module.looked = first + len(made)
        made.append(_topic(module, module.looked))
    return made


def _topic(module: Module, index: int) -> Topic:
    name = f"{module.name}.margin"
    most = max(module.levels - 1, 1)
    looks = IntType(0, most)
    return Topic(
        index=index,
        name=name,
        symbol=TopicSymbol(name, module.symbol.span, looks, False, {}, None, None),
        type=looks,
        bounds=(Bound(0, most),),
        set_declared=True,
        default=0,
        max_age_ns=None,
        driver=module.name,
        held=True,
    )

"""What a decision module remembers, as topics: for `margin(M)`, and of its latch.

Purpose: the topic of a module whose margin somebody reads. Its value says for how many periods
from that look on AC surely keeps control (`Module.looks_left`), its stamp when the look was. And
the topic of a module with `returns after`: what its latch waits for, and since when; or with
`returns never`: whether AC has had control (docs/semantics.md, The latch).
Non-goals: how many periods these are (`verify/deploy/missing_predicates.py`), what is made of them
(`Module.margin_ns`); how a latch moves (`semantics/control.py`, `runtime/soter_kernel.c`).
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
        made.append(_topic(module, "margin", module.looked, max(module.levels - 1, 1)))
    return made


def make_latch_topics(modules: Iterable[Module], first: int) -> list[Topic]:
    """A topic for every module with a latch that may switch, numbered from `first` on.

    Enters the topics' numbers, and those of the acknowledgements, in the modules.
    """
    made: list[Topic] = []
    for module in modules:
        latch = module.symbol.latch
        if latch is None or module.forced is not None:
            continue
        module.latch = first + len(made)
        if latch.topic is not None:
            module.acknowledgement = module.scope.topics[latch.topic]
        made.append(_topic(module, "latch", module.latch, 1 if latch.topic is None else 2))
    return made


def _topic(module: Module, what: str, index: int, most: int) -> Topic:
    name = f"{module.name}.{what}"
    held = IntType(0, most)
    return Topic(
        index=index,
        name=name,
        symbol=TopicSymbol(name, module.symbol.span, held, False, {}, None, None),
        type=held,
        bounds=(Bound(0, most),),
        set_declared=True,
        default=0,
        max_age_ns=None,
        driver=module.name,
        held=True,
    )

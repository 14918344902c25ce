"""What a decision module remembers that does not give control back by itself: its latch.

Purpose: the topic of a module with `returns`; and, of a flat system, that an acknowledgement comes
from outside and is one module's alone (M027).
With `returns after`, the value is WAITS, READY or ACKNOWLEDGED, the stamp that of the takeover, of
the release that was seen after it, or of the acknowledgement; NEVER where no SC of this
start has been looked at yet. With `returns never` it is CLOSED once AC has had control.
Non-goals: how it moves (`semantics/rules.py`, `runtime/soter_kernel.c`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.system import Bound, Topic
from soter.language.model.typed import TopicSymbol
from soter.language.model.types import IntType

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.language.model.system import Module, System


def make_latch_topics(modules: Iterable[Module], first: int) -> list[Topic]:
    """A topic for every module with a latch that may switch, numbered from `first` on."""
    made: list[Topic] = []
    for module in modules:
        latch = module.symbol.latch
        if latch is None or module.forced is not None:
            continue
        module.latch = first + len(made)
        if latch.topic is not None:
            module.acknowledgement = module.scope.topics[latch.topic]
        made.append(_topic(module, module.latch, 1 if latch.topic is None else 2))
    return made


def _topic(module: Module, index: int, most: int) -> Topic:
    name = f"{module.name}.latch"
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


def check_acknowledgements(
    system: System, drivers: dict[int, list[tuple[str, Span]]], diagnostics: Diagnostics
) -> None:
    """M027 where a node or a module of the system acknowledges, or one press would count twice.

    `drivers`: by topic who publishes it, and where that stands.
    """
    first_by_topic: dict[int, Module] = {}
    for module in system.modules:
        latch = module.symbol.latch
        if latch is None or latch.topic is None:
            continue
        topic = system.topics[module.scope.topics[latch.topic]]
        for who, span in drivers.get(topic.index, []):
            if not who.startswith("plant "):
                diagnostics.error(
                    "M027",
                    f"{who} publishes `{topic.name}`, the acknowledgement of `{module.name}`",
                    latch.span,
                    also=((span, "it would give control back"),),
                    notes=("an acknowledgement is the operator's: it comes from outside",),
                    helps=(f"declare `input topic {topic.symbol.name}`",),
                )
                break
        other = first_by_topic.setdefault(topic.index, module)
        if other is not module:
            diagnostics.error(
                "M027",
                f"`{topic.name}` acknowledges for `{other.name}` and for `{module.name}`",
                latch.span,
                also=((system.components[other.dm].span, "the other module"),),
                notes=("one acknowledgement gives control back once",),
                helps=("give each module a topic of its own",),
            )

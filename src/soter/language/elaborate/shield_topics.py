"""What a module with a `shield` remembers: which of its commands may still act.

Purpose: the hidden topic of such a module: of every cell into which its commands are cut the time
until which a command of that cell was held; and what a shield cannot be said of (M027).
Non-goals: which commands are permitted (`verify/tables/shield_tables.py`), when they are judged
(`semantics/shield.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.system import Shield, Topic
from soter.language.model.typed import TopicSymbol
from soter.language.model.types import (
    FLOAT,
    ArrayType,
    FloatType,
    has_list,
    leaves,
    numbers_in,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Component, Module, System
    from soter.language.model.typed import TypedExpr

NEVER_HELD = -1.0e18
"""s: before every run."""


def make_shield_topics(
    modules: Sequence[Module],
    cells: Mapping[int, int],
    topics: Sequence[Topic],
    components: Sequence[Component],
    diagnostics: Diagnostics,
) -> list[Topic]:
    """A topic for every module that has a shield, numbered from `len(topics)` on.

    `cells`: module index -> into how many cells each number of its commands is cut.
    """
    made: list[Topic] = []
    for module in modules:
        clause = module.symbol.shield
        if clause is None or module.index not in cells:
            continue
        why = _why_not(module, topics, components)
        if why:
            _refused(module, clause, why, diagnostics)
            continue
        numbers = len(_numbers(module, topics))
        first = len(topics) + len(made)
        times = (NEVER_HELD,) * (numbers * cells[module.index])
        made.append(_topic(module, "shield", first, times))
        module.shield = Shield(cells[module.index], first)
        if module.symbol.toward_sc:
            both = 2 * _numbers(module, topics)
            made.append(_topic(module, "proposed", first + 1, both))
            module.shield.proposed = first + 1
    return made


def _why_not(module: Module, topics: Sequence[Topic], components: Sequence[Component]) -> str:
    if module.symbol.ttf is not None or module.symbol.safer is not None:
        return "`ttf` and `safer` are written: what a shield permits is computed together with them"
    if module.symbol.over is not None:
        return "a module stands in the place of its AC"
    for i in module.outputs:
        t = topics[i].type
        if has_list(t) or not all(isinstance(leaf, FloatType) for _, leaf in leaves(t)):
            return f"`{topics[i].name}` is not made of floats"
    slow = [components[i] for i in (module.ac, module.sc) if components[i].takes_ns is not None]
    if slow:
        return f"a step of `{slow[0].name}` takes time: it is judged when it begins"
    return ""


def refuse_overrun(
    system: System, component: Component, fault: str, diagnostics: Diagnostics
) -> None:
    """M027 where a controller that a shield judges would publish later than it steps."""
    module = None if component.module is None else system.modules[component.module]
    if module is None or module.shield is None or module.symbol.shield is None:
        return
    why = f"`{fault}`: what a step publishes later is judged when it begins"
    _refused(module, module.symbol.shield, why, diagnostics)


def _refused(module: Module, clause: TypedExpr, why: str, diagnostics: Diagnostics) -> None:
    diagnostics.error(
        "M027",
        f"module `{module.symbol.name}` can have no shield",
        clause.span,
        also=((module.symbol.span, "this module"),),
        notes=(why,),
        helps=("leave `shield` out",),
    )


def _numbers(module: Module, topics: Sequence[Topic]) -> tuple[float, ...]:
    """The numbers of its commands, as they are at the start."""
    return tuple(numbers_in(tuple(topics[i].default for i in module.outputs)))


def _topic(module: Module, what: str, index: int, default: tuple[float, ...]) -> Topic:
    name = f"{module.name}.{what}"
    size = len(default)
    held = ArrayType(FLOAT, size)
    return Topic(
        index=index,
        name=name,
        symbol=TopicSymbol(name, module.symbol.span, held, False, {}, None, None),
        type=held,
        bounds=(None,) * size,
        set_declared=True,
        default=default,
        max_age_ns=None,
        driver=module.name,
        held=True,
    )

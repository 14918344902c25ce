"""Makes the hidden topics in which a system remembers what its decisions depend on.

Purpose: hidden topics hold margins, the state of latches, the plan that SC follows, until when
a command in each cell of a `shield` was held, and outputs of steps that take time.
Non-goals: who writes them (`semantics/`, `runtime/soter_kernel.c`), with what (`verify/`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.elaborate.passes.system_numbers import TooLargeError
from soter.language.model.system import Bound, Shield, Topic
from soter.language.model.typed import TopicSymbol
from soter.language.model.types import (
    BOOL,
    FLOAT,
    INT,
    ArrayType,
    FloatType,
    IntType,
    RecordType,
    default_value,
    has_list,
    leaves,
    numbers_in,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.elaborate.passes.flattening import Flattening
    from soter.language.model.system import Component, Module, System
    from soter.language.model.typed import TypedExpr
    from soter.language.model.types import Type, Value


NEVER_HELD = -1.0e18
"""A time, in seconds, that is before every run."""
NO_FLOATS = "is not made of floats"
AS_FLOAT = (
    "publish the number as a float; an agent still chooses, with masks: `action_space` and `act` of"
    " soter.gym make commands of a Discrete space (docs/gym.md)"
)


def make_memory_topics(flat: Flattening) -> None:
    """Adds all hidden topics to `topics`, and sets their indices in modules and components."""
    for index in sorted(set(flat.margins)):
        module = flat.modules[index]
        module.looked = _add_counter_topic(flat, module, "margin", max(module.levels - 1, 1))
    for module in flat.modules:
        latch = module.symbol.latch
        if latch is not None and module.forced is None:
            module.latch = _add_counter_topic(
                flat, module, "latch", 1 if latch.topic is None else 2
            )
            if latch.topic is not None:
                module.acknowledgement = module.scope.topics[latch.topic]
    _add_plan_topics(flat)
    for c in flat.components:
        if c.takes_ns is not None and flat.test is None:  # the explorer holds outputs itself
            add_held_topic(flat, c)
    for module in flat.modules:
        if module.index in flat.shields and module.symbol.shield is not None:
            _add_shield_topics(flat, module, module.symbol.shield)


def _add_plan_topics(flat: Flattening) -> None:
    for module in flat.modules:
        sc, symbol = flat.components[module.sc], module.symbol.plan
        if symbol is not None and sc.node is module.symbol.sc:  # none for an SC that was replaced
            module.plan = _add_counter_topic(flat, module, "plan", len(module.symbol.plans) - 1)
            flat.topics[-1] = replace(flat.topics[-1], symbol=symbol)
            sc.scope.topics[symbol] = module.plan


def add_held_topic(flat: Flattening, c: Component) -> None:
    """Adds the topic that holds outputs until they take effect; may raise TooLargeError."""
    if c.held is not None or c.node is None or not c.node.publishes:
        return
    published = [flat.topics[c.scope.topics[t]] for t in c.node.publishes]
    fields: list[tuple[str, Type]] = []
    bounds: list[Bound | None] = []
    for k, topic in enumerate(published):
        fields += [(f"has_{k}", BOOL), (f"at_{k}", INT), (f"out_{k}", topic.type)]
        bounds += [None, None, *topic.bounds]
    t = RecordType(tuple(fields))
    if not flat.sizes.has_room_for(t):
        raise TooLargeError
    c.held = len(flat.topics)
    flat.topics.append(
        Topic(
            index=c.held,
            name=f"{c.name}.held",
            symbol=published[0].symbol,
            type=t,
            bounds=tuple(bounds),
            set_declared=False,
            default=default_value(t),
            max_age_ns=None,
            driver=c.name,
            held=True,
        )
    )


def _add_counter_topic(flat: Flattening, module: Module, purpose: str, most: int) -> int:
    return _add_hidden_topic(flat, module, purpose, IntType(0, most), (Bound(0, most),), 0)


def _add_hidden_topic(
    flat: Flattening,
    module: Module,
    purpose: str,
    held: Type,
    bounds: tuple[Bound | None, ...],
    default: Value,
) -> int:
    name = f"{module.name}.{purpose}"
    topic = Topic(
        index=len(flat.topics),
        name=name,
        symbol=TopicSymbol(name, module.symbol.span, held, False, {}, None, None),
        type=held,
        bounds=bounds,
        set_declared=True,
        default=default,
        max_age_ns=None,
        driver=module.name,
        held=True,
    )
    flat.topics.append(topic)
    return topic.index


def _add_shield_topics(flat: Flattening, module: Module, clause: TypedExpr) -> None:
    """Adds the topics of a module's shield; reports M027 if the module can have no shield."""
    why = _why_no_shield(module, flat.topics, flat.components)
    if why:
        _report_no_shield(module, clause, why, flat.diagnostics)
        return
    first_values = tuple(numbers_in(tuple(flat.topics[i].default for i in module.outputs)))
    cells = flat.shields[module.index]
    times = (NEVER_HELD,) * (len(first_values) * cells)
    module.shield = Shield(cells, _add_array_topic(flat, module, "shield", times))
    if module.symbol.toward_sc:
        module.shield.proposed = _add_array_topic(flat, module, "proposed", 2 * first_values)
    if (tried := module.symbol.candidates) is not None:
        module.scope.topics.setdefault(tried, flat.components[module.ac].scope.topics[tried])


def _add_array_topic(
    flat: Flattening, module: Module, purpose: str, default: tuple[float, ...]
) -> int:
    size = len(default)
    return _add_hidden_topic(flat, module, purpose, ArrayType(FLOAT, size), (None,) * size, default)


def _why_no_shield(module: Module, topics: Sequence[Topic], components: Sequence[Component]) -> str:
    if module.symbol.ttf is not None or module.symbol.safer is not None:
        return "`ttf` and `safer` are written: what a shield permits is computed together with them"
    for i in module.outputs:
        t = topics[i].type
        if has_list(t) or not all(isinstance(leaf, FloatType) for _, leaf in leaves(t)):
            return f"`{topics[i].name}` {NO_FLOATS}"
    slow = [components[i] for i in (module.ac, module.sc) if components[i].takes_ns is not None]
    if slow:
        return f"a step of `{slow[0].name}` takes time: it is judged when it begins"
    return _why_no_candidates(module, topics, components)


def refuse_overrun(
    system: System, component: Component, fault: str, diagnostics: Diagnostics
) -> None:
    """Reports M027 for a fault that delays the outputs of a controller that a shield judges."""
    module = None if component.module is None else system.modules[component.module]
    if module is None or module.shield is None or module.symbol.shield is None:
        return
    why = f"`{fault}`: what a step publishes later is judged when it begins"
    _report_no_shield(module, module.symbol.shield, why, diagnostics)


def _report_no_shield(
    module: Module, clause: TypedExpr, why: str, diagnostics: Diagnostics
) -> None:
    diagnostics.error(
        "M027",
        f"module `{module.symbol.name}` can have no shield",
        clause.span,
        also=((module.symbol.span, "this module"),),
        notes=(why,),
        helps=("leave `shield` out", *([AS_FLOAT] if why.endswith(NO_FLOATS) else [])),
    )


def _why_no_candidates(
    module: Module, topics: Sequence[Topic], components: Sequence[Component]
) -> str:
    """Gives the reason why candidates cannot replace AC's command; "" if they can, or none exist.

    A command that replaces AC's passes no gate. So every value that the topic of candidates may
    have must lie in the output's set.
    """
    tried = module.symbol.candidates
    if tried is None:
        return ""
    index = components[module.ac].scope.topics.get(tried)
    if index is None:
        return f"its AC does not subscribe `{tried.name}`, so that it cannot say that it is old"
    if module.symbol.rest is None:
        return f"it has no `rest`: on a grid a command is moved toward SC's, not to `{tried.name}`"
    if not module.outputs:
        return ""  # what its controllers publish is in error
    topic, (output, *others) = topics[index], (topics[i] for i in module.outputs)
    if others or not isinstance(topic.type, ArrayType) or topic.type.element != output.type:
        return f"`{tried.name}` is no array of what it publishes, as `{output.type}[3]` is"
    ends = (*output.bounds,) * topic.type.size
    within = all(
        a is not None and (b is None or (b.low <= a.low and a.high <= b.high))
        for a, b in zip(topic.bounds, ends, strict=True)
    )
    plants = [(x.scope.topics, x.plant.drives) for x in components if x.plant is not None]
    if not within or index in {at[symbol] for at, drives in plants for symbol, _ in drives}:
        return f"a value of `{tried.name}` may lie outside of the set of `{output.name}`"
    return ""

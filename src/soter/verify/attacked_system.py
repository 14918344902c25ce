"""Makes a system under attack: with the same plants and SC, and an adversary who chooses the rest.

Purpose: `attacked_system` makes the closed system in which `refute.py` looks for runs that leave C,
the states where `safe` holds. Its AC publishes values drawn from its outputs' sets, so that one
draw policy makes all choices of the environment and of AC, in C and in the interpreter alike.
`safe` becomes a property of *true* topics, published without measurement errors beside the
estimates.
Non-goals: searching (`refute.py`); delays and jitter, as virtual time has none: a run that leaves C
only by a late release is not found.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.elaborate import derived_systems
from soter.language.model import typed
from soter.language.model.system import Property
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.types import FloatType, leaves

if TYPE_CHECKING:
    from soter.language.model.system import Component, Module, System, Topic


OWN, DRAWN = "own", "drawn"
"""The controller in the place of AC: the program's own AC, or the adversary's draws."""


class NotAttackableError(Exception):
    """Raised if the closed system cannot be run as an attack; the text says why."""


def attacked_system(system: System, module: int, controller: str = DRAWN) -> System:
    """The system in which an adversary attacks the property "safe on the true state" of a module.

    Raises `NotAttackableError` if `safe` reads a topic that no plant drives, or if the AC's outputs
    have no sets to draw from (with `controller` = DRAWN).
    """
    m = system.modules[module]
    watched = _system_with_drawn_inputs(_system_watching_safe(system, m), m)
    return _system_with_drawn_controls(watched, m) if controller == DRAWN else watched


def true_topics_known_ns(system: System) -> int:
    """The time in ns from which on every true topic of an attacked system has been published."""
    return max((c.phase_ns for c in system.components if c.plant is not None), default=0)


def may_read_time(system: System, module: int) -> bool:
    """Whether anything in the closed system may depend on the time.

    The check is cautious: it looks at every function of the program, called or not.
    """
    m = system.modules[module]
    roots: list[object] = [m.symbol.ttf, m.symbol.safer]
    for c in system.components:
        if c.node is not None:
            roots += [*c.node.step, *(c.node.takeover or ())]
        if c.plant is not None:
            p = c.plant
            roots += [*p.der.values(), *p.next.values(), *(e for _, e in (*p.lets, *p.drives))]
    for f in system.program.funs.values():
        roots += list(f.body or ())
    aging = (typed.TimeRead, typed.AgeRead)
    return any(isinstance(n, aging) for n in nodes([r for r in roots if r is not None]))


def _system_watching_safe(system: System, module: Module) -> System:
    """The system with one property: `safe` over twins of its topics without measurement errors."""
    safe, scope = module.symbol.safe, module.scope
    seen = {}
    for symbol in topic_reads(safe):
        system, seen[symbol] = _system_with_twin(system, symbol, scope.topics[symbol])
    at = replace(scope, topics={**scope.topics, **seen})
    watched = Property(0, "always", safe, at, "safe, on the true state", safe.span)
    return derived_systems.with_properties(system, (watched,))


def _system_with_twin(system: System, symbol: typed.TopicSymbol, index: int) -> tuple[System, int]:
    """A copy of the system where a twin of topic `index` shows true values; also its index."""
    for c in system.components:
        if c.plant is None:
            continue
        for topic, value in c.plant.drives:
            if c.scope.topics[topic] == index:
                return _system_with_driven_twin(system, c, topic, value)
    raise NotAttackableError(f"no plant drives `{symbol.name}`, which `safe` reads")


def _system_with_driven_twin(
    system: System, c: Component, topic: typed.TopicSymbol, value: typed.TypedExpr
) -> tuple[System, int]:
    old = system.topics[c.scope.topics[topic]]
    system, twin = derived_systems.with_topic(
        system,
        old,
        replace(topic, name=f"{topic.name}_true", input=False, values={}),
        f"{old.name}_true",
        bounds=(None,) * len(old.bounds),
        set_declared=False,
        driver=c.name,
    )
    assert c.plant is not None
    plant = replace(c.plant, drives=(*c.plant.drives, (twin.symbol, value)))
    scope = replace(c.scope, topics={**c.scope.topics, twin.symbol: twin.index})
    return derived_systems.with_components(
        system, [replace(c, plant=plant, scope=scope)]
    ), twin.index


def _system_with_drawn_inputs(system: System, module: Module) -> System:
    """A copy of the system that draws free inputs from their sets, anew in each module period."""
    already = {i.topic for i in system.inputs}
    for t in system.topics:
        if (
            t.driver in ("", derived_systems.OUTSIDE)
            and t.index not in already
            and _can_be_drawn(t)
        ):
            system = derived_systems.with_drawn_topic(system, t.index, module.period_ns)
    return system


def _system_with_drawn_controls(system: System, module: Module) -> System:
    """The system whose AC publishes, at each step, values drawn from its outputs' sets."""
    ac = system.components[module.ac]
    node = ac.node
    assert node is not None, ac.name
    outputs = {t: system.topics[ac.scope.topics[t]] for t in node.publishes}
    bad = [t.name for t, output in outputs.items() if not _can_be_drawn(output)]
    if bad:
        raise NotAttackableError(f"`{bad[0]}` has no declared set to choose from")
    subscribed, step, topics = [], [], {}
    for topic, output in outputs.items():
        name = f"{output.name}_chosen"
        symbol = replace(topic, name=name, input=True)
        free = {"max_age_ns": None, "driver": derived_systems.OUTSIDE}
        system, chosen = derived_systems.with_topic(system, output, symbol, name, **free)
        system = derived_systems.with_drawn_topic(system, chosen.index, ac.period_ns)
        topics[chosen.symbol] = chosen.index
        subscribed.append(typed.Subscribed(chosen.symbol, None, "", node.span))
        read = typed.TopicRead(topic.type, node.span, chosen.symbol)
        step.append(typed.TypedPublish(node.span, topic, read))
    drawn = replace(
        node,
        extern=False,
        source=None,
        subscribes=tuple(subscribed),
        locals=(),
        initial=(),
        takeover=None,
        step=tuple(step),
    )
    return derived_systems.with_components(system, [derived_systems.with_node(ac, drawn, topics)])


def _can_be_drawn(topic: Topic) -> bool:
    """Whether every leaf of a topic has a bounded set; False for lists, which lack fixed leaves."""
    leaf_types = list(leaves(topic.type))
    return len(leaf_types) == len(topic.bounds) and all(
        "[]" not in path and (bound is not None or not isinstance(t, FloatType))
        for (path, t), bound in zip(leaf_types, topic.bounds, strict=True)
    )

"""Walks the tree of a system's instances to a flat list with full names.

Purpose: places every plant, node and module below a system, with its wires and the values of its
parameters, and applies what systems say about their parts: `force`, `replace`.
Non-goals: which part replaces another (`replace_parts.py`), making components of instances
(`make_components.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.elaborate.passes.flattening import PlacedInstance, SubSystem
from soter.language.elaborate.passes.replace_parts import replace_part
from soter.language.elaborate.passes.topics import home_of_topic
from soter.language.elaborate.passes.value_sets import set_and_default
from soter.language.model import typed
from soter.language.model.tree_walk import topics_mentioned, topics_of_instances

if TYPE_CHECKING:
    from soter.language.elaborate.passes.flattening import Bounds, Flattening, Wires
    from soter.language.elaborate.passes.system_numbers import Values
    from soter.language.model.types import Value


def place_instances(flat: Flattening) -> None:
    """Adds `placed`, `parts` and `params_at`; for a test also `gone` and `put_in`."""
    _place_instances_below(flat, flat.symbol, "", [])


def _place_instances_below(
    flat: Flattening, system: typed.SystemSymbol, prefix: str, outer: list[Wires]
) -> None:
    """Places each instance below `prefix`, then applies `force` and `replace` of the system."""
    around = flat.params_at[prefix]
    flat.parts.append(SubSystem(system, prefix, outer, around))
    if prefix:
        flat.parameters.add_settings(prefix, system.sets)
    for instance in system.instances:
        name = prefix + instance.name
        declaration = instance.what
        flat.partial = flat.partial or declaration in flat.program.damaged
        _check_wires(flat, instance)
        params = flat.parameters.values_inside(name, around)
        wires = {
            inner: home_of_topic(flat, target, prefix, outer)
            for inner, target in instance.renames.items()
        }
        if isinstance(declaration, typed.SystemSymbol):
            _warn_of_ignored_settings(flat, declaration, name)
            flat.params_at[name + "."] = params
            _place_instances_below(flat, declaration, name + ".", [wires])
            continue
        if isinstance(declaration, typed.ModuleSymbol):
            damaged = flat.program.damaged
            flat.partial = flat.partial or declaration.ac in damaged or declaration.sc in damaged
        flat.placed.append(
            PlacedInstance(name, declaration, prefix, [wires, *outer], instance.span, params)
        )
    forced = {prefix + path: to for path, to, _ in system.forces}
    for placed in flat.placed if forced else ():
        placed.forced = forced.get(placed.name, placed.forced)
    for path, by, span in system.replaces:
        replace_part(flat, prefix, path, by, span)


def _check_wires(flat: Flattening, instance: typed.InstanceSymbol) -> None:
    """Reports M013 for a wire to a topic that the instance does not have."""
    declaration = instance.what
    if not instance.renames or declaration in flat.program.damaged:
        return
    known = {*topics_mentioned(declaration)}
    if isinstance(declaration, typed.SystemSymbol):
        known |= {*topics_of_instances(declaration)}
    for topic, span in instance.rename_spans.items():
        if topic not in known:
            flat.diagnostics.error(
                "M013",
                f"`{instance.name}` has no topic `{topic.name}` that could be wired",
                span,
                "left of `=` stands a topic of the instance",
                also=((declaration.span, f"`{declaration.name}` is declared here"),),
            )


def _warn_of_ignored_settings(flat: Flattening, inner: typed.SystemSymbol, path: str) -> None:
    """Warns W006 of each `set` of a sub-system that has no effect in the running system."""
    for item in inner.sets:
        if not (item.path or flat.parameters.is_set_around(item.param, path)):
            flat.diagnostics.warning(
                "W006",
                f"`set {item.param.name}` has no effect in system `{flat.symbol.name}`",
                item.span,
                also=((flat.symbol.span, f"this system has `{inner.name}` as a part"),),
                notes=("the system that runs sets parameters, or those of its instances",),
                helps=(
                    f"repeat it in `{flat.symbol.name}`",
                    f"or write `{{ set {item.param.name} = ... }}` where it is used",
                ),
            )


def check_wired_sets(flat: Flattening) -> None:
    """Reports V010 for each wire between topics with different value sets or `max_age`s."""
    for part in flat.parts:
        for instance in part.system.instances:
            for inner, target in instance.renames.items():
                home, outer = home_of_topic(flat, target, part.prefix, part.wires)
                if not {inner, outer} & flat.program.damaged:
                    place = f"{part.prefix}{instance.name}."
                    params = flat.params_at.get(place, part.params)
                    _require_same_set_and_age(
                        flat, (inner, params), (outer, flat.params_at[home]), instance
                    )


def _require_same_set_and_age(
    flat: Flattening,
    written: tuple[typed.TopicSymbol, Values],
    used: tuple[typed.TopicSymbol, Values],
    instance: typed.InstanceSymbol,
) -> None:
    """Reports V010 if the wired topic `used` has another set or `max_age` than `written`."""
    inner, outer = written[0], used[0]
    (inner_set, old), (outer_set, new) = (_set_and_age(flat, *x) for x in (written, used))
    difference = "other values" if any(inner_set) and inner_set != outer_set else ""
    if not difference and inner.max_age is not None and old != new:
        difference = "another `max_age`"
    if difference:
        flat.diagnostics.error(
            "V010",
            f"`{outer.name}` has {difference} than `{inner.name}`, in whose place it stands",
            instance.rename_spans.get(inner, instance.span),
            "wired here",
            also=((inner.span, "written for these"), (outer.span, "gets these")),
            notes=("what was concluded from a set holds for that set only",),
            helps=("declare both alike",),
        )


def _set_and_age(
    flat: Flattening, symbol: typed.TopicSymbol, params: Values
) -> tuple[Bounds, Value | None]:
    with flat.with_params(params):
        return set_and_default(flat, symbol)[0], flat.value_of(symbol.max_age, "a `max_age`")

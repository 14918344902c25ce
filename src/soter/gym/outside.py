"""A system of which some parts are answered from outside.

Purpose: the same system (names, topics, order, properties, random draws), except that an
advanced controller and a plant are externs whose answers a session gives.
Non-goals: changing anything else; stepping (`session.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.program.system import Component, Module, System


def wrong_choice(message: str, *helps: str) -> SoterError:
    """U001: an argument that names nothing, or not one thing."""
    return SoterError((Diagnostic("U001", message, helps=tuple(h for h in helps if h)),))


def chosen_module(system: System, name: str | None) -> Module:
    """The module of that name, or the only one; SoterError U001."""
    names = [m.name for m in system.modules]
    return system.modules[_index("module", names, name, system.name)]


def chosen_plant(system: System, name: str | None) -> Component:
    """The plant of that name, or the only one; SoterError U001."""
    plants = [c for c in system.components if c.plant is not None]
    return plants[_index("plant", [c.name for c in plants], name, system.name)]


def answered_outside(system: System, indices: Sequence[int]) -> System:
    """`system` with these components (nodes or plants) as unbound externs."""
    components = tuple(_as_extern(c) if c.index in indices else c for c in system.components)
    return replace(system, components=components)


def _as_extern(component: Component) -> Component:
    """Its declaration without code: an extern has states or outputs, and no locals."""
    if component.plant is not None:
        plant = replace(component.plant, extern=True)
        return replace(component, plant=plant, binding=None)
    assert component.node is not None
    node = replace(component.node, extern=True, locals=(), initial=(), takeover=None, step=())
    return replace(component, node=node, initial=(), binding=None)


def _index(kind: str, names: list[str], wanted: str | None, system: str) -> int:
    shown = ", ".join(f"`{n}`" for n in names) or "none"
    if wanted is None:
        if len(names) == 1:
            return 0
        message = f"system `{system}` has {len(names)} {kind}s, so one has to be named"
        raise wrong_choice(message, f"there are {shown}: {kind}=...")
    if wanted not in names:
        raise wrong_choice(f"system `{system}` has no {kind} `{wanted}`", f"there are {shown}")
    return names.index(wanted)

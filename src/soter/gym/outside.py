"""What of a system is answered from outside: which module's controller, which plant.

Purpose: the module and the plant that a caller names, or the only ones.
Non-goals: the system that is left (`program/flatten/derived.py`); stepping (`session.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError

if TYPE_CHECKING:
    from soter.program.model.system import Component, Module, System


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

"""What a component of a flat system may be called by tests and faults.

Purpose: components by a path as it is written, and what to say where there is none.
Non-goals: what happens to them (`tested_system.py`, `faults.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.expressions.field import listed

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.language.model.system import Component, System


def named(system: System, path: str) -> list[Component]:
    """The components with this full name, else those that may be called so."""
    matches = [c for c in system.components if c.name == path]
    return matches or [c for c in system.components if path in _aliases(system, c)]


def _aliases(system: System, c: Component) -> set[str]:
    """What a component may be called beside its full name, as in `replace`."""
    if c.node is None:
        return set()
    symbols = [c.node]
    aliases: set[str] = set()
    if c.module is not None:
        module = system.modules[c.module]
        symbols.append(module.symbol.ac if c.role == "ac" else module.symbol.sc)
        aliases |= {f"{module.name}.{_short(s.name)}" for s in symbols}
    return aliases | {s.name for s in symbols} | {_short(s.name) for s in symbols}


def nobody(
    system: System, path: str, span: Span, diagnostics: Diagnostics, *, verb: str, plants: bool
) -> None:
    """E009: no component is called so; `verb`: what it could do, `plants`: whether they can."""
    known = [c.name for c in system.components if plants or c.role != "plant"]
    head, _, last = path.rpartition(".")
    inside = [n for n in known if n.startswith(f"{head}.") and n.endswith(f".{last}")]
    helps = diagnostics.did_you_mean(path, known, span)
    if len(inside) == 1:
        helps = (f"of a module's controller the name has the module's in it: `{inside[0]}`",)
    if any(m.name == path for m in system.modules):
        helps = (f"its decision module is `{path}.dm`",)
    what = "component" if plants else "node"
    diagnostics.error(
        "E009",
        f"this system has no {what} `{path}` that could {verb}",
        span,
        notes=(f"what steps is {listed(known)}",) if known else (),
        helps=helps,
    )


def _short(name: str) -> str:
    return name.rpartition(".")[2]

"""The recipe of a system: all that a machine which has not its files needs to fly it.

Purpose: `make_recipe` packs the C of a system (`compiled_unit.py`), its names and the C of its
externs as plain data; `unpacked_recipe` puts that C into the cache of the machine that got it.
Non-goals: sending (`fly_campaign.py`); flying (`batch_flights.py`).
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.campaign.compiled_unit import generate_measured
from soter.core.core import Call
from soter.core.core_walks import walk
from soter.core.layout import state_dtype
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.native.cache import cached_folder, digest, included_files
from soter.native.kept_state import why_it_keeps_state
from soter.simulate.module_safe_check import extern_functions

if TYPE_CHECKING:
    import numpy as np

    from soter.codegen.unit import Unit
    from soter.core.core import CoreSystem
    from soter.language.model.system import System


@dataclass(frozen=True)
class Recipe:
    """A system to fly, as plain data that can be sent to another machine.

    `properties`, `components`: index and name; `forced`: whether each module is in AC from the
    start; `bins`: the number of bins of each measure, with those below and above; `keeps`: why the
    C of externs may keep state between calls, or ""; `files`: path and text of this C and of the
    files that it includes, on the machine that made the recipe.
    """

    unit: Unit
    dtype: np.dtype[Any]
    until_ns: int
    horizon_ns: int
    optimise: str
    properties: tuple[tuple[int, str], ...]
    components: tuple[tuple[int, str], ...]
    forced: tuple[bool, ...]
    bins: tuple[int, ...]
    keeps: str
    files: tuple[tuple[str, str], ...]


def make_recipe(
    system: System, core: CoreSystem, until_ns: int, *, horizon_ns: int = 0, optimise: str = "-O3"
) -> Recipe:
    """The recipe of a system. Raises SoterError X003 if the C of an extern cannot be read."""
    unit = generate_measured(system, core)
    keeps = why_it_keeps_state(unit)
    if keeps:
        _require_stateless_c(system, core)
        unit = generate_measured(system, core, remembers=False)
    files = {str(p): t for p, t in included_files(*unit.c_sources).items()}
    return Recipe(
        unit=unit,
        dtype=state_dtype(unit.layout),
        until_ns=until_ns,
        horizon_ns=horizon_ns,
        optimise=optimise,
        properties=tuple((p.index, f"{p.kind} {p.text}") for p in system.properties),
        components=tuple((c.index, c.name) for c in system.components),
        forced=tuple(m.forced == "ac" for m in system.modules),
        bins=tuple(m.bins + 2 for m in system.measures),
        keeps=keeps,
        files=tuple(files.items()),
    )


def _require_stateless_c(system: System, core: CoreSystem) -> None:
    """Raises SoterError U003 if a measure calls C that may keep state, as runs have no measures."""
    extern = extern_functions(core)
    for measure, value in zip(system.measures, core.measures, strict=True):
        called = {x.function for x in walk((*value.body, value.value)) if isinstance(x, Call)}
        if called & extern:
            message = f"measure `{measure.name}` calls C that may keep something"
            note = "a run does not look at measures, so a flight would be another one"
            helps = ("let the function keep nothing, or measure what is in the state",)
            raise SoterError((Diagnostic("U003", message, notes=(note,), helps=helps),))


def unpacked_recipe(recipe: Recipe) -> Recipe:
    """The recipe on the receiving machine, with the C of its externs in the cache there."""
    if not recipe.files:
        return recipe
    root = os.path.commonpath([str(Path(p).parent) for p, _ in recipe.files])
    names = {p: str(Path(p).relative_to(root)) for p, _ in recipe.files}

    def write_sources(work: Path) -> None:
        for path, text in recipe.files:
            place = work / names[path]
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(text, encoding="utf-8", errors="surrogateescape")

    content = digest([x for p, t in recipe.files for x in (names[p], t)])
    folder = cached_folder("sent", content, tuple(names.values()), write_sources)
    sources = tuple(str(folder / names[str(Path(s).resolve())]) for s in recipe.unit.c_sources)
    return replace(recipe, unit=replace(recipe.unit, c_sources=sources), files=())

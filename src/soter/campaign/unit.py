"""The C of a system that a campaign flies: its program, and what it measures.

Purpose: `<prefix>_measured` (soter_batch.h), one more table behind the generated program; `Recipe`,
all that is needed to fly a system where neither the system nor its files are.
Non-goals: flying (`fleet.py`).
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.codegen import decisions
from soter.codegen.c import tree as c
from soter.codegen.c.types import float_number, int_number
from soter.codegen.unit import UnitBuilder
from soter.lower.layout import state_dtype
from soter.lower.steps import lower
from soter.native.includes import included
from soter.native.kept import digest, kept

if TYPE_CHECKING:
    import numpy as np

    from soter.codegen.unit import Unit
    from soter.lower.core import CoreSystem
    from soter.program.model.system import Measure, System


@dataclass(frozen=True)
class Recipe:
    """What is flown, as plain data that can be sent.

    `properties`, `components`: index and name; `forced`: modules that are in AC from the start;
    `bins`: of each measure, with those below and above; `files`: the C that externs are bound to
    and what it includes, by their paths where it was made.
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
    files: tuple[tuple[str, str], ...]


def recipe_of(
    system: System,
    core: CoreSystem,
    until_ns: int,
    *,
    horizon_ns: int = 0,
    optimise: str = "-O3",
) -> Recipe:
    """The recipe of a system; SoterError X003 where the C of an extern cannot be read."""
    unit = generate_measured(system, core)
    files = {str(p): t for source in unit.c_sources for p, t in included(source).items()}
    return Recipe(
        unit=unit,
        dtype=state_dtype(system, unit.layout),
        until_ns=until_ns,
        horizon_ns=horizon_ns,
        optimise=optimise,
        properties=tuple((p.index, f"{p.kind} {p.text}") for p in system.properties),
        components=tuple((c.index, c.name) for c in system.components),
        forced=tuple(m.forced == "ac" for m in system.modules),
        bins=tuple(m.bins + 2 for m in system.measures),
        files=tuple(files.items()),
    )


def unpacked(recipe: Recipe) -> Recipe:
    """The recipe where it was sent to: the C of its externs lies in this machine's cache."""
    if not recipe.files:
        return recipe
    root = os.path.commonpath([str(Path(p).parent) for p, _ in recipe.files])
    names = {p: str(Path(p).relative_to(root)) for p, _ in recipe.files}

    def make(work: Path) -> None:
        for path, text in recipe.files:
            place = work / names[path]
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(text, encoding="utf-8", errors="surrogateescape")

    content = digest([x for p, t in recipe.files for x in (names[p], t)])
    folder = kept("sent", content, tuple(names.values()), make)
    sources = tuple(str(folder / names[str(Path(s).resolve())]) for s in recipe.unit.c_sources)
    return replace(recipe, unit=replace(recipe.unit, c_sources=sources), files=())


def generate_measured(system: System, core: CoreSystem | None = None) -> Unit:
    """The unit of a system with its measures."""
    return _Builder(system, core or lower(system), None).run()


class _Builder(UnitBuilder):
    def more(self) -> list[c.CTop]:
        """The table of measures, and their functions."""
        found: list[c.CTop] = [c.Include("soter_batch.h")]
        rows: list[tuple[None, c.CExpr]] = []
        for k, (measure, value) in enumerate(
            zip(self.system.measures, self.core.measures, strict=True)
        ):
            name = f"{self.prefix}_measure_{k}"
            doc = f"measure {measure.name}"
            found.append(decisions.number(self.frame, value, name, doc))
            rows.append((None, _row(measure, name)))
        table = f"{self.prefix}_measures"
        if rows:
            found.append(c.VariableDef("soter_measure", table, c.Initializer(tuple(rows)), True))
        fields = (
            ("count", c.Number(f"{len(rows)}U")),
            ("measure", c.Name(table if rows else "NULL")),
        )
        declared = c.VariableDef("soter_measured", f"{self.prefix}_measured", None)
        value_of = c.Initializer(fields)
        defined = c.VariableDef("soter_measured", f"{self.prefix}_measured", value_of, static=False)
        return [*found, declared, defined]


def _row(measure: Measure, name: str) -> c.CExpr:
    return c.Initializer(
        (
            ("every_ns", int_number(measure.every_ns)),
            ("low", float_number(measure.low)),
            ("high", float_number(measure.high)),
            ("bins", c.Number(f"{measure.bins}U")),
            ("value", c.Name(name)),
        )
    )

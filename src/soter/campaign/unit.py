"""The C of a system that a campaign flies: its program, and what it measures.

Purpose: `<prefix>_measured` (soter_batch.h), one more table behind the generated program.
Non-goals: flying (`fleet.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen import decisions
from soter.codegen.c import tree as c
from soter.codegen.c.types import float_number, int_number
from soter.codegen.unit import UnitBuilder
from soter.lower.steps import lower

if TYPE_CHECKING:
    from soter.codegen.unit import Unit
    from soter.lower.core import CoreSystem
    from soter.program.model.system import Measure, System


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

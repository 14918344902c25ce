"""W019: a scheme that diverges where the plant does not.

Purpose: `doubt_scheme`: a warning for a plant whose rates, times its step, lie outside of the
region in which its scheme is stable.
Non-goals: proofs: they enclose the scheme, or say that they do not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.integration_stability import diverging
from soter.language.model.durations import write_ns
from soter.language.syntax.schemes import SCHEMES

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.evaluate.integration_stability import Diverging
    from soter.language.model.system import Component, System

ENDS = {1: "2", 4: "2.78"}
"""Order of a scheme -> how much of a decay, rate times step, it follows at most."""


def doubt_scheme(system: System, component: Component, diagnostics: Diagnostics) -> None:
    """W019 for states that the scheme of a plant moves away from their solution."""
    plant = component.plant
    if plant is None:
        return
    for d in diverging(system, component):
        names = ", ".join(f"`{n}`" for n in d.names)
        end = ENDS[SCHEMES[plant.method].order]
        rate = f"rate {d.rate:.3g} per second x step {d.step_s:.3g} s = {d.rate * d.step_s:.3g}"
        diagnostics.warning(
            "W019",
            f"the scheme `{plant.method}` makes {names} of plant `{plant.name}` diverge",
            d.variable.span,
            f"every step multiplies {'it' if len(d.names) == 1 else 'them'} by {d.growth:.3g}",
            notes=(f"{rate}; `{plant.method}` follows a decay up to {end}",),
            helps=tuple(_helps(component, d)),
        )


def _helps(component: Component, d: Diverging) -> list[str]:
    plant = component.plant
    assert plant is not None
    helps = []
    if d.substeps is not None:
        shorter = component.period_ns * component.substeps // d.substeps
        helps.append(
            f"`integrate {plant.method} substeps {d.substeps};`, or a period of the plant of at "
            f"most {write_ns(max(1, shorter // component.substeps))}"
        )
    if d.other is not None:
        helps.append(f"`integrate {d.other};` in place of `{plant.method}`")
    return helps or ["leave out what is that fast: say where it comes to rest"]

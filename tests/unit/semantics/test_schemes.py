"""The schemes of integration: one list, and both engines know all of it and nothing else."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from soter.lower import core
from soter.lower import plants as lowered
from soter.lower.footprint import walk
from soter.lower.steps import lower
from soter.program.build import check_file, system_of
from soter.semantics import plants as interpreted
from soter.semantics.interpreter import Interpreter
from soter.syntax.schemes import SCHEMES

if TYPE_CHECKING:
    from soter.program.model.system import System
    from soter.syntax.schemes import Scheme


def growing(scheme: str, substeps: int = 1) -> System:
    """x' = x from 1, one step of 1 s."""
    text = f"""soter 1; topic y: float;
    plant P period 1s {{
      drives y = x; state x: float = 1.0; der x = x; integrate {scheme} substeps {substeps};
    }}
    system S {{ p: P; until 1s; }}"""
    return system_of(check_file("growing.soter", text), None)


def test_both_engines_know_the_schemes_of_the_list() -> None:
    assert set(interpreted.STEPS) == set(lowered.STEPS) == set(SCHEMES)


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=lambda s: s.name)
def test_a_scheme_has_the_stages_and_the_order_of_the_list(scheme: Scheme) -> None:
    step = lower(growing(scheme.name)).plants[0]
    calls = [n for n in walk(step.integrate) if isinstance(n, core.Call)]
    assert len(calls) == scheme.stages
    errors = []
    for substeps in (8, 16):
        c, _ = Interpreter(growing(scheme.name, substeps)).run()
        errors.append(abs(c.L[0][0] - math.e))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(scheme.order, abs=0.2)


def test_a_scheme_that_an_engine_does_not_know_is_an_error_and_not_another_one() -> None:
    system = growing("rk4")
    plant = system.components[0].plant
    assert plant is not None
    plant.method = "leapfrog"
    with pytest.raises(KeyError, match="leapfrog"):
        Interpreter(system).run()
    with pytest.raises(KeyError, match="leapfrog"):
        lower(system)

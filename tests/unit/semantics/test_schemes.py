"""The schemes of integration: one list, and both engines know all of it and nothing else."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import soter
from generators.random_programs import program
from soter.core import core
from soter.core import plants as lowered
from soter.core.core_walks import walk
from soter.core.steps import lower
from soter.language.front_end import check_file, system_of
from soter.language.syntax.schemes import SCHEMES
from soter.semantics import interpreter as interpreted
from soter.semantics.interpreter import Interpreter

if TYPE_CHECKING:
    from soter.language.model.system import System
    from soter.language.syntax.schemes import Scheme


DOCS = Path(__file__).resolve().parents[3] / "docs"


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


@pytest.mark.parametrize("scheme", SCHEMES)
def test_both_engines_compute_a_scheme_to_the_last_bit(scheme: str, tmp_path: Path) -> None:
    (tmp_path / "swing.soter").write_text(f"""soter 1; topic y: float;
    plant P period 10ms {{
      drives y = x; state x: float = 0.3; state w: float = -0.2; let pull = -9.81 * sin(x);
      der x = w; der w = pull - 0.1 * w * w; integrate {scheme} substeps 3;
    }}
    system S {{ p: P; until 1s; }}""")
    program = soter.load(tmp_path / "swing.soter")
    native, interpreted = (program.simulate(engine=e) for e in ("native", "interp"))
    assert native.trace_sha256 == interpreted.trace_sha256


@pytest.mark.long
def test_random_programs_are_integrated_by_every_scheme() -> None:
    texts = [program(number) for number in range(60)]
    assert {s for s in SCHEMES if any(f"integrate {s}" in text for text in texts)} == set(SCHEMES)


def test_the_documents_name_every_scheme_and_say_what_it_computes() -> None:
    grammar = (DOCS / "grammar.ebnf").read_text(encoding="utf-8")
    written = re.search(r"'integrate' \(([^)]*)\)", grammar)
    assert written is not None
    assert re.findall(r"'(\w+)'", written[1]) == list(SCHEMES)
    semantics = (DOCS / "semantics.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^(\w+): +(?:k1 = f\(x\)|x \+ h)", semantics, re.MULTILINE)) == set(
        SCHEMES
    )
    language = (DOCS / "language.md").read_text(encoding="utf-8")
    assert [s for s in SCHEMES if f"`integrate {s}`" not in language] == []


def test_a_scheme_that_an_engine_does_not_know_is_an_error_and_not_another_one() -> None:
    system = growing("rk4")
    plant = system.components[0].plant
    assert plant is not None
    plant.method = "leapfrog"
    with pytest.raises(KeyError, match="leapfrog"):
        Interpreter(system).run()
    with pytest.raises(KeyError, match="leapfrog"):
        lower(system)

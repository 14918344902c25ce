"""The smallest whole program, flown: AC alone touches the wall, the protected system does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from soter.language.front_end import check_file, system_of
from soter.semantics.interpreter import Interpreter

CART = Path(__file__).parents[3] / "examples" / "wall" / "cart.soter"


def violations(system: str, seed: int) -> int:
    interpreter = Interpreter(system_of(check_file(str(CART)), system), seed)
    _, record = interpreter.run(5_000_000_000)
    return record.violations


@pytest.mark.parametrize("seed", range(5))
def test_protected_never_touches_the_wall(seed: int) -> None:
    assert violations("Protected", seed) == 0


def test_unprotected_does() -> None:
    assert violations("Unprotected", 0) > 0

"""Systems made from text."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter.language.front_end import check_file, system_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.system import System

ROOT = Path(__file__).resolve().parents[3]
CART = ROOT / "examples" / "wall" / "cart.soter"


@pytest.fixture
def flat() -> Callable[..., System]:
    """`flat(text, name)`: the flattened system of a program."""

    def make(text: str, name: str | None = None) -> System:
        checked = check_file("test.soter", text)
        assert not checked.diagnostics.has_errors, [d.message for d in checked.diagnostics.items]
        return system_of(checked, name)

    return make


@pytest.fixture
def cart() -> Callable[[str], System]:
    """The systems of the cart before the wall."""
    return lambda name: system_of(check_file(str(CART)), name)

"""Small programs, lowered."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.core.steps import lower
from soter.language.front_end import check_file, system_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.core import CoreSystem
    from soter.language.model.system import System


def flat(text: str) -> System:
    checked = check_file("lowered.soter", "soter 1;\n" + text)
    assert checked.ok, [(d.code, d.message) for d in checked.diagnostics.items]
    return system_of(checked, None)


@pytest.fixture
def lowered() -> Callable[[str], tuple[System, CoreSystem]]:
    """`lowered(text)` gives the system of a program and its Core."""

    def make(text: str) -> tuple[System, CoreSystem]:
        system = flat(text)
        return system, lower(system)

    return make

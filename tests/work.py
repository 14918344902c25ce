"""How much a call does, counted: seconds would say how fast the machine is and who else uses it."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

T = TypeVar("T")


def work_of(function: Callable[[], T]) -> tuple[T, int]:
    """What a function gives, and how many functions were called in this thread until it did.

    Functions in Python and in C count alike, whatever they do: a loop over n things inside one
    call to C counts once.
    """
    calls = 0

    def count(_frame: object, event: str, _argument: object) -> None:
        nonlocal calls
        calls += event in {"call", "c_call"}

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        result = function()
    finally:
        sys.setprofile(before)
    return result, calls

"""How many operations code may take.

Purpose: a rough measure by which campaigns decide what is worth a test at run time.
Non-goals: times; the cost of a step that a program may have (`language/check/step_cost.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core.core import Call, If, Loop
from soter.core.read_write_footprint import walk

if TYPE_CHECKING:
    from soter.core.core import Function, Stmt


def operations_of(functions: tuple[Function, ...]) -> dict[str, int]:
    """Of each function by its name; those that are called come first."""
    known: dict[str, int] = {}
    for f in functions:
        known[f.name] = operations(f.body, known)
    return known


def operations(body: tuple[Stmt, ...], known: dict[str, int]) -> int:
    """How many expressions a body evaluates at most, roughly; `known`: of functions by name."""
    count = 0
    for s in body:
        if isinstance(s, Loop):
            count += max(0, s.high - s.low) * operations(s.body, known)
        elif isinstance(s, If):
            count += operations(s.then, known) + operations(s.otherwise, known)
        else:
            count += sum(known[x.function] if isinstance(x, Call) else 1 for x in walk(s))
    return count

"""Which faults a flight met: inside of what proofs assume, or outside.

Purpose: whether a violation is a defect, or had an excuse that was declared before the flight.
Non-goals: what faults do (`semantics/chance/faults.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.semantics.chance.faults import begins

if TYPE_CHECKING:
    from soter.program.model.system import Fault, System

ORDER = "order any"


def outside(system: System, seed: int, until_ns: int) -> list[str]:
    """Faults outside of the assumptions that were there up to a time, as they were written."""
    found = {ORDER: None} if system.shuffled else {}
    for f in system.faults:
        if f.inside is None and f.text not in found and _was_there(system, f, seed, until_ns):
            found[f.text] = None
    return list(found)


def _was_there(system: System, f: Fault, seed: int, until_ns: int) -> bool:
    always = f.kind == "late" and f.slot_ns == 0
    return always or bool(begins(f, system.components[f.component], seed, until_ns))

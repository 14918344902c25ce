"""Safe controllers wait for their decision modules, also where these are late.

Purpose: the faults that say so, for a system in the deployed order: one thread does what an
instant releases, DMs before SCs, and proofs take that for granted.
Non-goals: systems whose order is drawn: there nobody waits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.system import Fault

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.language.model.system import Module

WAIT = "wait"


def waiting(
    modules: Sequence[Module], faults: Sequence[Fault], *, shuffled: bool
) -> tuple[Fault, ...]:
    """These faults, and what follows from them for SCs."""
    said = [f for f in faults if f.kind != WAIT]
    return (*said, *(() if shuffled else _waits(modules, said)))


def _waits(modules: Sequence[Module], faults: Sequence[Fault]) -> Iterator[Fault]:
    late = {f.component: f.inside for f in faults if f.kind == "late"}
    for m in modules:
        if m.dm in late:
            yield Fault(
                kind=WAIT,
                component=m.sc,
                stream="",
                probability=1.0,
                slot_ns=0,
                on=m.dm,
                inside="SC waits for its decision module",
                text=f"{m.name}: SC waits for its decision module",
            )

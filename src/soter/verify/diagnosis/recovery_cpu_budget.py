"""P2b last, and not for long where something cheaper fails already.

Purpose: the way back may take longer than everything else. Where `ttf`, `safer` or the start fail,
the module is undecided whatever it says, so it gets about as long as they took.
Non-goals: P2b (`recovery.py`).
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from soter.verify.claims.recovery import recover
from soter.verify.grid.claims import grids
from soter.verify.grid.sets import CancelledError

if TYPE_CHECKING:
    from soter.verify.claims.case import Case

CHEAPER = ("ttf", "safer", "start")
LEAST_S = 4.0
"""CPU seconds that it gets in any case."""


def recover_at_last(case: Case) -> None:
    """`recover`; cut short where a cheaper claim fails. Then nothing of it is kept.

    A group that is not fresh in a later attempt keeps its way back only if its target is the same:
    it must not look as if it had one. Only grids are cut: where other groups are, nothing is.
    """
    failing = next((f.claim for f in case.failures if f.claim in CHEAPER), None)
    engines = [p.engine for p in grids(case.proofs)]
    if failing is None or len(engines) < len(case.proofs):
        recover(case)
        return
    until = time.process_time() + max(LEAST_S, sum(case.spent.values()))
    before = [engine.stop for engine in engines]
    for engine in engines:
        engine.stop = lambda: time.process_time() > until
    try:
        recover(case)
    except CancelledError:
        case.failures = [f for f in case.failures if f.claim != "P2b"]
        for part in case.sets.groups:
            part.target = part.home = part.rank = part.rank_holds = None
        case.fail("P2b", f"not looked at to the end: `{failing}` fails first").cut = True
    finally:
        for engine, stop in zip(engines, before, strict=True):
            engine.stop = stop

"""P2b last, and not for long where something cheaper fails already.

Purpose: the way back may take longer than everything else. Where `ttf`, `safer` or the start fail,
`put_off` leaves it to an attempt on a finer grid; without one the module is undecided whatever P2b
says, and `recover_for_report` takes about as long as they took. So CPU time decides no verdict.
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


def put_off(case: Case) -> bool:
    """Whether a cheaper claim fails: then P2b is entered as not looked at."""
    failing = next((f.claim for f in case.failures if f.claim in CHEAPER), None)
    if failing is not None:
        case.fail("P2b", f"not looked at to the end: `{failing}` fails first").cut = True
    return failing is not None


def recover_for_report(case: Case) -> None:
    """`recover` of a case that is undecided, which put it off; cut short, nothing of it is kept.

    Only grids are cut: where other groups are, nothing is.
    """
    not_looked_at = [f for f in case.failures if f.cut]
    assert not_looked_at, "a case that may be proved has no budget"
    case.failures = [f for f in case.failures if not f.cut]
    engines = [p.engine for p in grids(case.proofs)]
    if len(engines) < len(case.proofs):
        recover(case)
        return
    until = time.process_time() + max(LEAST_S, sum(case.spent.values()))
    before = [engine.stop for engine in engines]
    for engine in engines:
        engine.stop = lambda: time.process_time() > until
    try:
        recover(case)
    except CancelledError:
        for part in case.sets.groups:
            part.target = part.home = part.rank = part.rank_holds = None
        case.failures = [f for f in case.failures if f.claim != "P2b"] + not_looked_at
    finally:
        for engine, stop in zip(engines, before, strict=True):
            engine.stop = stop

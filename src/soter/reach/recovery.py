"""P2b: SC gives control back.

Purpose: sets Q_g that SC keeps inside the states whose every estimate satisfies `safer`, and ranks
that lead there from all of K (docs/verification.md, section 3).
Non-goals: whether AC then does anything useful.
"""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING

from soter.program.durations import show_ns
from soter.reach.products import parts, product_holds

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from soter.reach.claims import Case

    Bools = NDArray[np.bool_]


def recover(case: Case) -> None:
    """Q, W and the time to Q of every group; enters failures of P2b."""
    targets = _targets(case)
    if targets is None:
        return
    longest = 0
    for i, (engine, part, target) in enumerate(
        zip(case.groups, case.sets.groups, targets, strict=True)
    ):
        inside = target & part.allowed
        part.home = engine.core(inside).witness
        if not part.home.any():
            case.fail(
                "P2b",
                "SC keeps no set inside `safer`",
                i,
                inside,
                "let SC come to rest where `safer` holds",
            )
            continue
        if importlib.util.find_spec("soter.reach.policies") is None:
            case.fail("P2b", "ranks are not computed")
            continue
        from soter.reach.policies import ranks  # noqa: PLC0415

        found = ranks(engine, part.home, part.core, part.allowed)
        part.rank, part.rank_holds = found.rank, found.holds
        longest = max(longest, found.longest_ns)
        stuck = (part.core > 0) & (found.rank == 0)
        if stuck.any():
            case.fail(
                "P2b",
                f"from {int(stuck.sum()):,} cells of K no way back to `safer` was found",
                i,
                stuck,
                "an SC that returns to where `safer` holds; a finer grid",
            )
    case.counts["recover_ns"] = longest + case.problem.times.decision
    _in_time(case)


def _targets(case: Case) -> list[Bools] | None:
    """Per group the states all of whose estimates satisfy `safer`."""
    if case.problem.computed:
        case.fail("P2b", "`safer` is still to be computed")
        return None
    found = parts(case.problem, case.groups, "safer")
    if found is None:
        case.fail("P2b", "no state was found on which `safer` surely holds")
        return None
    if not product_holds(case.forms, case.groups, found, "safer"):
        case.fail("P2b", "`safer` is no product over the groups")
        return None
    return found


def _in_time(case: Case) -> None:
    """The declared T, where there is one."""
    wanted, needed = case.problem.recover_ns, case.counts["recover_ns"]
    if wanted is not None and needed > wanted and not case.failed("P2b"):
        case.fail(
            "P2b",
            f"SC may need {show_ns(needed)}, longer than the {show_ns(wanted)} of `recover within`",
            hint="allow more time, or a quicker SC",
        )

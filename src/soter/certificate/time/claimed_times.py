"""The times that a manifest claims, checked against those of the program.

Purpose: `compare_times`; their names.
Non-goals: deriving them (`module_times.py`, `derived_times.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.format.claimed_parts import only_keys
from soter.certificate.format.errors import NotRecheckedError, RejectedError

if TYPE_CHECKING:
    from soter.certificate.reading.module_facts import Facts

DECLARED_KEYS = ("Delta_ns", "delta_ns", "J_dm_ns", "J_sc_ns", "R_dm_ns", "R_sc_ns", "L_ns")
"""Times that stand in the program, and in the manifest as they are there."""
DERIVED_KEYS = ("A_ns", "A_sc_ns", "H_star_ns", "d_ns", "j_ns", "h0_ns")
"""Times that follow: a manifest may claim more schedules than there are, never fewer."""
TIME_KEYS = (*DECLARED_KEYS, *DERIVED_KEYS, "H_ns")
BEYOND, BEYOND_NS = 4, 1_000_000_000
"""More than so many times a time, all times together and so much: a way to keep this busy."""


def compare_times(facts: Facts, given: dict[str, Any]) -> None:
    """Declared times are those of the program, derived ones no shorter; the longer ones count.

    Older reads, wider windows, a longer horizon: a claim about more schedules implies ours.
    RejectedError where they are shorter, NotRecheckedError where nobody needs such long ones.
    """
    only_keys(given, " ".join(TIME_KEYS), "`times`")
    ages = [r.max_age for r in (*facts.setting.by_dm, *facts.setting.by_sc)]
    own_jitter = facts.times["j_ns"]
    together = sum(facts.times[k] for k in TIME_KEYS) + sum(ages)
    for key in TIME_KEYS:
        value, own = given[key], facts.times[key]
        if not isinstance(value, int) or isinstance(value, bool):
            raise RejectedError(f"{key} is no time in the manifest")
        fixed = key in DECLARED_KEYS or (key == "H_ns" and facts.symbol.verify.horizon is not None)
        if value < own or (fixed and value != own):
            raise RejectedError(f"{key} is {value} in the manifest, {own} by the program")
        if value > BEYOND * own + together + BEYOND_NS:
            raise NotRecheckedError(f"{key} is {value} in the manifest, which no program needs")
        facts.times[key] = value
    if 2 * own_jitter <= facts.times["delta_ns"] < 2 * facts.times["j_ns"]:
        raise NotRecheckedError("a j in the manifest of more than half a period, and less is there")

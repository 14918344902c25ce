"""The keys that `info` has of a protected step, and which of them a caller asks for.

Purpose: a choice of keys is read once, and wrong ones are told.
Non-goals: what the keys say (`guard.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.gym.outside_roles import wrong_choice

if TYPE_CHECKING:
    from collections.abc import Collection

INFO_KEYS = (
    *("mode", "ttf", "safer", "margin", "stale", "switched", "violations", "taken_by"),
    *("action_requested", "action_taken", "gate_fault", "intervened", "cause", "cost"),
    *("off_model", "action_mask", "not_finite"),
)
"""All that `info` may say of the module."""


def known_keys(keys: Collection[str]) -> tuple[str, ...]:
    """`keys` in the order of `INFO_KEYS`; SoterError U001 for others."""
    wanted = {keys} if isinstance(keys, str) else set(keys)
    if unknown := sorted(map(str, wanted.difference(INFO_KEYS))):
        names = ", ".join(f"`{name}`" for name in unknown)
        raise wrong_choice(f"`info` says nothing of {names}", f"it has {', '.join(INFO_KEYS)}")
    return tuple(key for key in INFO_KEYS if key in wanted)

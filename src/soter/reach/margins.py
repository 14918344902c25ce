"""By how much `ttf`, `safer`, the start or the way back fail.

Non-goals: verdicts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.reach.claims import Case
    from soter.reach.experiments import Budget
    from soter.reach.results import ModuleResult


def margins(done: Sequence[Case], result: ModuleResult, budget: Budget) -> None:
    """Enter them."""

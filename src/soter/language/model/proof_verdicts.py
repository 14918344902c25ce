"""The record of what was proved of a module, below `verify/` and `simulate/`, for runs to tell.

Purpose: `Proof`: verdicts by property, and what they rest on.
Non-goals: proving (`verify/`), and where a proof is kept (`verify/proof_cache.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

NOT_FOR_SAFETY = frozenset({"P2b", "failsafe"})
"""What the theorem does without: AC's return, and what acts once the trusted part stops."""


@dataclass(frozen=True)
class Proof:
    """`verdicts`: property -> proved, assumed, undecided or refuted; of one module of a system."""

    verdicts: dict[str, str]
    assumptions: tuple[str, ...]

    def of(self, verdict: str, *names: str) -> list[str]:
        """Which of these properties (none: of all) have that verdict."""
        return [n for n, v in self.verdicts.items() if v == verdict and (not names or n in names)]

    @property
    def open(self) -> list[str]:
        """What safety needs and is neither proved nor an assumption that was told."""
        return [
            n
            for n, v in self.verdicts.items()
            if n not in NOT_FOR_SAFETY and v not in ("proved", "assumed")
        ]

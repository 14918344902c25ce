"""The record of what was proved of a module.

Purpose: `Proof` has the verdict on each property and the assumptions, so that runs can report them.
Non-goals: proving (`verify/`), and where a proof is kept (`verify/proof_cache.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

NOT_FOR_SAFETY = frozenset({"P2b", "failsafe"})
"""Properties that safety does not need: AC's return, and what acts after the trusted part."""


@dataclass(frozen=True)
class Proof:
    """The verdict on each property of a module: proved, assumed, undecided or refuted."""

    verdicts: dict[str, str]
    assumptions: tuple[str, ...]

    def names_with(self, verdict: str, *names: str) -> list[str]:
        """Gives the names of properties, among `names` or all, that have this verdict."""
        return [n for n, v in self.verdicts.items() if v == verdict and (not names or n in names)]

    @property
    def open_names(self) -> list[str]:
        """Gives the names of properties that safety needs and that are not proved or assumed."""
        return [
            n
            for n, v in self.verdicts.items()
            if n not in NOT_FOR_SAFETY and v not in ("proved", "assumed")
        ]

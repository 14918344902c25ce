"""How far a search is, as its thread tells it.

Purpose: the volatile numbers of `soter_explore_progress` as plain data, for whoever waits.
Non-goals: waiting (`explorer_library.py`), words (`results.Looked`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class EngineProgress:
    """How far a search is. `tracing`: something is violated, a way to it is looked for.

    `bytes` of tables, frontiers and remembered steps; `answers` of the one step that is tried,
    where they are very many. What is observed before `covered_ns` was judged (breadth first).
    """

    states: int
    transitions: int
    depth: int
    seconds: float
    tracing: bool = False
    bytes: int = 0
    answers: int = 0
    covered_ns: int = 0


def progress_of(p: Any, seconds: float) -> EngineProgress:  # noqa: ANN401 - cdata
    """From what the explorer writes while it searches (`soter_explore_progress`)."""
    return EngineProgress(
        states=int(p.states),
        transitions=int(p.transitions),
        depth=int(p.depth),
        seconds=seconds,
        tracing=bool(p.tracing),
        bytes=int(p.bytes),
        answers=int(p.answers),
        covered_ns=max(int(p.covered_ns), 0),
    )

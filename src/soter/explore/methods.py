"""How an exploration can be done: the strategies, storages and reductions there are.

Purpose: the one table of each; the command line, the checks of options and the engine read it, and
`soter_explore.h` has a constant for each strategy and storage (`SOTER_DFS`).
Non-goals: what they do (`explore/engine/c/`, docs/testing.md).
"""

from __future__ import annotations

EXHAUSTIVE = ("bfs", "dfs", "deepening")
SAMPLING = ("random", "pct", "coverage")
STRATEGIES = (*EXHAUSTIVE, *SAMPLING)
"""The default first."""
STORAGES = ("exact", "fingerprint")
"""The default first."""
REDUCTIONS = {"none": 0, "sleep": 1, "ample": 2, "all": 3}
"""As bits: 1 sleep sets, 2 ample sets. The default last."""


def constant(name: str) -> str:
    """What a strategy or storage is called in C."""
    return f"SOTER_{name.upper()}"

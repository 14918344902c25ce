"""How an exploration can be done: the strategies, storages and reductions there are.

Purpose: the one table of each; the command line, the checks of options and the engine read it, and
`soter_explore.h` has a constant for each strategy and storage (`SOTER_DFS`).
Also what the C has room for. Non-goals: what they do (`explore/engine/c/`, docs/testing.md).
"""

from __future__ import annotations

EXHAUSTIVE = ("bfs", "dfs", "deepening")
FALSIFY = "falsify"
SAMPLING = ("random", "pct", "coverage", FALSIFY)
STRATEGIES = (*EXHAUSTIVE, *SAMPLING)
"""The default first."""
STORAGES = ("exact", "fingerprint")
"""The default first."""
STATUSES = (
    "exhausted",
    "violated",
    "memory",
    "states",
    "runs",
    "stopped",
    "no_memory",
    "choices",
    "width",
    "length",
    "damaged",
)
"""How a search ends: `soter_explore_status`, in order."""
CHOICES_MAX = 256
"""Choices of one step (`SOTER_CHOICES`)."""
WORDS_MAX = 4096
"""Words of 64 bits of a packed configuration (`SOTER_WORDS`)."""
THREADS_BFS = 16
"""So many threads breadth-first search has room for (`SOTER_THREADS`)."""
LEAVES_MAX = 4096
"""Leaves of topics that are told apart for coverage."""
STEPS_MAX = 65_536
"""Steps of a trace."""
SLEEP, AMPLE, INSTANTS, GROUPS, SYMMETRY = 1, 2, 4, 12, 16
REDUCTIONS = {
    "none": 0,
    "sleep": SLEEP,
    "ample": AMPLE,
    "instants": INSTANTS,
    "groups": GROUPS,
    "symmetry": SYMMETRY,
    "parts": SLEEP | AMPLE | GROUPS,
    "all": SLEEP | AMPLE | GROUPS | SYMMETRY,
}
"""As bits: 1 sleep sets, 2 ample sets, 4 only ends of instants, 8 by groups, 16 equal instances.
The default last."""
PARTS = frozenset({"parts", "all"})
"""With these, parts of a system that share nothing are explored apart."""


def knows_ends(reduction: str) -> bool:
    """Whether it leaves out what lies between ends of instants."""
    return bool(REDUCTIONS[reduction] & INSTANTS)


def reduce_bits(reduction: str, *, between: bool) -> int:
    """`soter_explore_options.reduce`; `between`: what lies between ends is stored after all."""
    asked = REDUCTIONS[reduction]
    return asked & ~(SLEEP | GROUPS) if between else asked


def constant(name: str) -> str:
    """What a strategy or storage is called in C."""
    return f"SOTER_{name.upper()}"

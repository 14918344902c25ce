"""The options of a search, and the strategies, storages and reductions that it can choose from.

Purpose: each option stands here once, with its range, its default, its words and its flag; command
line, keywords, checks, JSON and pages read this record, and the engine reads the tables.
`soter_explore.h` has a constant for each strategy and storage (`SOTER_BFS`).
Non-goals: how options are read (`diagnostics/command_records.py`), what strategies do
(`explore/engine/c/`, docs/testing.md), the texts of `skew`, `horizon` and `params`, which others
read as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypedDict

from soter.diagnostics.command_records import SEVERAL, SWITCH, choice, option, seconds, size, whole

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path


SAMPLING = ("random", "falsify")
STRATEGIES = ("bfs", *SAMPLING)
"""All strategies, the default first."""
STORAGES = ("exact", "fingerprint")
"""All storages, the default first."""
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
)
"""How a search ends: `soter_explore_status`, in order."""
CHOICES_MAX = 256
"""The most choices of one step (`SOTER_CHOICES`)."""
WORDS_MAX = 4096
"""The most words of 64 bits of a packed configuration (`SOTER_WORDS`)."""
THREADS_BFS = 16
"""The most threads of a breadth-first search (`SOTER_THREADS`)."""
LEAVES_MAX = 4096
"""The most leaves of topics that coverage counts."""
STEPS_MAX = 65_536
"""The most steps of a trace."""
SLEEP, AMPLE, INSTANTS, GROUPS = 1, 2, 4, 12
REDUCTIONS = {
    "none": 0,
    "sleep": SLEEP,
    "ample": AMPLE,
    "instants": INSTANTS,
    "groups": GROUPS,
    "all": SLEEP | AMPLE | GROUPS,
}
"""The reductions as bits, the default last: 1 sleep sets, 2 ample sets, 4 only ends of instants,
8 by groups. With the last one, parts of a system that share nothing are explored apart."""


def stores_only_ends(reduction: str) -> bool:
    """Whether a reduction stores only the ends of instants."""
    return bool(REDUCTIONS[reduction] & INSTANTS)


def reduction_bits(reduction: str, *, between: bool) -> int:
    """The bits of a reduction for C; `between` (also store between ends) drops SLEEP and GROUPS."""
    asked = REDUCTIONS[reduction]
    return asked & ~(SLEEP | GROUPS) if between else asked


def c_constant(name: str) -> str:
    """The C constant of a strategy or storage, such as SOTER_BFS."""
    return f"SOTER_{name.upper()}"


@dataclass(frozen=True)
class SearchProgress:
    """The progress of a search, for a line of output.

    After it found a violation: `tracing`, it looks for an execution that shows it; `minimising`,
    for the shortest one. `bytes`: memory of all that it keeps. `answers`: those of the step that it
    tries, if very many.
    """

    test: str
    states: int
    transitions: int
    depth: int
    bytes: int
    seconds: float
    minimising: bool = False
    tracing: bool = False
    answers: int = 0
    covered_ns: int = 0
    """Everything observable before this time was judged, in all executions (breadth first)."""


def _text_of_alternatives(names: Iterable[str], default: str) -> str:
    shown = [f"{n} (the default)" if n == default else n for n in names]
    return f"{', '.join(shown[:-1])} or {shown[-1]}"


HOW = f"{STRATEGIES[0]} (the default); {', '.join(SAMPLING)}: samples, the latter by simple plans"
ALSO = "go on after a violation: which other properties can be violated, each with a trace"
SHORTEN = "to minimise or shrink the trace of a violation; by default {default:g} s, 0: do not"
LENGTH = seconds("more than 0 and at most", 10**9, optional=True)


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """The options of a search; `seed` also draws the disturbances that are drawn once."""

    test: str | Sequence[str] | None = option(
        "--test T", None, "only this test, or these; by default all", SEVERAL
    )
    strategy: str = option("--strategy S", STRATEGIES[0], HOW, choice(*STRATEGIES), "strategy")
    storage: str = option(
        "--storage S",
        "exact",
        _text_of_alternatives(STORAGES, "exact"),
        choice(*STORAGES),
        "storage",
    )
    reduction: str = option(
        "--reduction R",
        "all",
        _text_of_alternatives(REDUCTIONS, "all"),
        choice(*REDUCTIONS),
        "reduction",
    )
    threads: int = option(
        "--threads N",
        1,
        f"of bfs, up to {THREADS_BFS}; by default 1",
        whole(1, THREADS_BFS),
        "threads_asked",
    )
    memory: int = option(
        "--memory SIZE", "2G", "for all that it keeps; by default {default}", size(2**20)
    )
    time: float | None = option(
        "--time TIME", None, "for the search of a test{text}; by default no end", LENGTH
    )
    max_states: int = option(
        "--max-states N",
        0,
        "stop after so many configurations",
        whole(0, 2**63, "bound", "{}; 0: no bound"),
    )
    runs: int = option(
        "--runs N", 10_000, "of the sampling strategies; by default {default:,}", whole(1, 2**63)
    )
    seed: int = option(
        "--seed N", 1, "likewise; by default {default}", whole(0, 2**64 - 1, "seed"), "seed"
    )
    minimise: float = option("--minimise TIME", 30.0, SHORTEN, seconds("from 0 (do not) to", 10**9))
    all_properties: bool = option("--all", False, ALSO, SWITCH)
    skew: float | str | None = option(
        "--skew TIME", None, "in place of the test's own, such as 2ms"
    )
    horizon: float | str | None = option("--horizon TIME", None, "likewise, such as 500ms")
    params: Mapping[str, object] | None = option("", None, "values of parameters by full name")
    output: str | Path | None = option(
        "-o --output DIR", ".soter", "folder of traces and pages; by default {default}"
    )
    html: bool = option("--report --html", False, "write a page for every trace", SWITCH)
    junit: str | None = option(
        "--junit FILE", None, "write the verdicts as JUnit XML, for CI", keyword=False
    )
    progress: Callable[[SearchProgress], None] | None = option(
        "", None, "called with how far it is: test, states, transitions, depth, bytes, seconds"
    )
    partial: bool = option(
        "", False, "on Ctrl-C give back what was covered, instead of raising", SWITCH
    )
    GONE = (
        (
            "--checkpoint --checkpoint-every --resume",
            "searches are not stored any more: give one what it needs at once (--memory, --time)",
        ),
    )
    NEEDS = (
        (f"strategy={','.join(SAMPLING)}", "runs"),
        ("strategy=bfs", "storage reduction threads"),
        ("!output=None", "html"),
    )

    def why_fewer_threads(self, ran: int) -> str:
        """The reason why only `ran` threads searched; "" if as many ran as the user asked for."""
        few = "its first steps were all that it took, or the machine gave no more"
        return "" if ran == self.threads else few


class SearchKeywords(TypedDict, total=False):
    """The fields of `SearchOptions` except `test`, as keywords for type checkers."""

    strategy: str
    storage: str
    reduction: str
    threads: int
    memory: int | str
    time: float | None
    max_states: int
    runs: int
    seed: int
    minimise: float
    all_properties: bool
    skew: float | str | None
    horizon: float | str | None
    params: Mapping[str, object] | None
    output: str | Path | None
    html: bool
    progress: Callable[[SearchProgress], None] | None
    partial: bool

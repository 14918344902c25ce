"""The options of a run: command line, keywords, checks and pages read this record.

Purpose: each option once, with its range, its default, its words and its flag.
Non-goals: how options are read (`diagnostics/command_records.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypedDict

from soter.diagnostics.command_records import SWITCH, choice, option, whole

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from soter.simulate.outputs.to_log import RunLog
    from soter.simulate.run_observer import Kept

ENGINES = ("native", "interp")
AGAINST = "run against the clock, externs in processes of their own (docs/real-time.md)"
RECORDED = "run nothing: tell the flight that a program of `soter build` recorded (`--record FILE`)"
WHOLE = "the report in one file; by default its drawing script lies beside it"
LATE = "in real time: exit 4 beyond so many late steps of the trusted part; by default {default}"
SEED = whole(0, 2**64 - 1, "seed")


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How to run; with what only the command line takes, which is no keyword."""

    system: str | None = option("--system S", None, "by default the only one, or the `default`")
    until: float | str | None = option(
        "--until TIME", None, "such as 30s; by default the system's own"
    )
    seed: int = option("--seed N", 1, "by default {default}", SEED)
    flight: int | None = option(
        "--flight K", None, "flight K of a campaign that begins with --seed", SEED, keyword=False
    )
    arm: str | None = option(
        "--arm A", None, "by the rules of that arm of the campaign: ac, paper, ..."
    )
    campaign: str | Path | None = option(
        "--campaign DIR", None, "its folder; by default where `soter campaign` puts it"
    )
    engine: str = option(
        f"--engine {{{','.join(ENGINES)}}}",
        "native",
        "native C, or the reference interpreter",
        choice(*ENGINES),
    )
    params: Mapping[str, object] | None = option("", None, "values of parameters by full name")
    log: str | Path | RunLog | None = option("--log [PATH]", None, "write an MCAP log")
    report: str | Path | None = option("--report [PATH]", None, "write an HTML report")
    self_contained: bool = option("--self-contained", False, WHOLE, SWITCH, keyword=False)
    output: str = option(
        "-o --output DIR",
        ".soter",
        "folder of logs and reports without a path; by default {default}",
        keyword=False,
    )
    why: bool = option(
        "--why", False, "list every change of mode, and on which values", SWITCH, keyword=False
    )
    real_time: bool = option("--real-time", False, AGAINST, SWITCH)
    recorded: str | Path | None = option("--recorded FILE", None, RECORDED)
    misses: int = option("--misses N", 0, LATE, whole(0, 2**63), keyword=False)
    trace: Kept = option("", True, "keep the state after every instant, or what is named of it")
    sha256: bool = option("", True, "hash it: equal hashes are equal states", SWITCH)
    progress: Callable[[float], None] | None = option(
        "", None, "called with the share that is done, 0 to 1"
    )
    partial: bool = option("", False, "on Ctrl-C give back what was reached", SWITCH)
    apart: bool = option("", False, "nodes in Python as processes (docs/externs.md)", SWITCH)


class RunKeywords(TypedDict, total=False):
    """The options as keywords, for who checks types: those that have no place of their own."""

    arm: str | None
    campaign: str | Path | None
    log: str | Path | RunLog | None
    report: str | Path | None
    real_time: bool
    recorded: str | Path | None
    trace: Kept
    sha256: bool
    progress: Callable[[float], None] | None
    partial: bool
    apart: bool

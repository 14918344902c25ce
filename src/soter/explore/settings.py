"""What a person may say about a search, checked.

Purpose: names and numbers become `Options`, or a diagnostic that says what would be right (U001).
Non-goals: lengths of time and parameters, which others read as well.
"""

from __future__ import annotations

import math
import re

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.explore.methods import REDUCTIONS, STORAGES, STRATEGIES
from soter.explore.results import Options

UNITS = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}
THREADS_MAX = 64
MEMORY_MIN = 2**20
SECONDS_MAX = 10**9
_SIZE = re.compile(r"([0-9]{1,15}(?:\.[0-9]{1,9})?)\s*([KMGT]?)(?:i?B)?", re.IGNORECASE)


def options_of(
    *,
    strategy: str,
    storage: str,
    reduction: str,
    threads: int,
    memory: int | str,
    max_states: int,
    runs: int,
    seed: int,
    minimise: float = 30.0,
    all_properties: bool = False,
    time: float | None = None,
) -> Options:
    """The options of a search; `SoterError` U001 with all mistakes at once."""
    problems: list[Diagnostic] = []
    for what, given, known in (
        ("strategy", strategy, STRATEGIES),
        ("storage", storage, STORAGES),
        ("reduction", reduction, tuple(REDUCTIONS)),
    ):
        if given not in known:
            problems.append(_problem(f"there is no {what} `{given}`", f"there are {_list(known)}"))
    for what, number, low, high in (
        ("threads", threads, 1, THREADS_MAX),
        ("max_states", max_states, 0, 2**63),
        ("runs", runs, 1, 2**63),
        ("seed", seed, 0, 2**64 - 1),
    ):
        if isinstance(number, bool) or not isinstance(number, int) or not low <= number <= high:
            message = f"`{what}` cannot be `{str(number)[:40]}`"
            problems.append(_problem(message, f"a whole number from {low} to {high}"))
    if isinstance(minimise, bool) or not (
        isinstance(minimise, (int, float)) and 0 <= minimise <= SECONDS_MAX
    ):
        message = f"`minimise` cannot be `{str(minimise)[:40]}`"
        problems.append(_problem(message, f"seconds from 0 (do not) to {SECONDS_MAX:,}"))
    if time is not None and (
        isinstance(time, bool) or not isinstance(time, (int, float)) or not 0 < time <= SECONDS_MAX
    ):
        message = f"`time` cannot be `{str(time)[:40]}`"
        problems.append(_problem(message, f"seconds, more than 0 and at most {SECONDS_MAX:,}"))
    size = bytes_of(memory)
    if size is None or not MEMORY_MIN <= size < 2**63:
        message = f"`memory` cannot be `{str(memory)[:40]}`"
        problems.append(_problem(message, "write it as 512M or 2G; 1M at least"))
    if problems:
        raise SoterError(tuple(problems))
    assert size is not None
    return Options(
        strategy=strategy,
        storage=storage,
        reduction=reduction,
        threads=threads,
        memory=size,
        max_states=max_states,
        runs=runs,
        seed=seed,
        minimise=float(minimise),
        all_properties=bool(all_properties),
        time=math.inf if time is None else float(time),
    )


def bytes_of(given: int | str) -> int | None:
    """Bytes, from a number or a text such as `512M`; None where it is none."""
    if isinstance(given, bool):
        return None
    if isinstance(given, int):
        return given
    match = _SIZE.fullmatch(given.strip()) if isinstance(given, str) else None
    return None if match is None else int(float(match[1]) * UNITS[match[2].upper()])


def _list(names: tuple[str, ...]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _problem(message: str, help_: str) -> Diagnostic:
    return Diagnostic("U001", message, helps=(help_,))

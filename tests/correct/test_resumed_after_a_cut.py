"""A search that time, memory or a signal cut off in the middle of a step goes on as if it had not.

Searches of some hundred thousand configurations; small ones, cut at bounds on configurations, are
in test_resumed_searches_agree.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from generators.interrupted_searches import anywhere, chance, in_pieces, once
from generators.long_search_programs import wanderers
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from pathlib import Path

    from soter.language.model.system import System

OVERRUN = "overrun N by 10ms; skip A at most 1;"
MODELS = {
    "plain": (wanderers(160), SearchOptions(reduction="none")),
    "asleep": (wanderers(160), SearchOptions(reduction="sleep", threads=2)),
    "by instants": (wanderers(220), SearchOptions(reduction="instants")),
    "by instants, 2 threads": (wanderers(220), SearchOptions(reduction="instants", threads=2)),
    "overrun": (wanderers(110, extra=OVERRUN), SearchOptions(reduction="none", threads=2)),
    "overrun, ample": (wanderers(110, extra=OVERRUN), SearchOptions(reduction="ample")),
    "overrun, fingerprints": (
        wanderers(110, extra=OVERRUN),
        SearchOptions(reduction="none", storage="fingerprint", threads=2),
    ),
    "late": (wanderers(110, extra="skew 10ms;"), SearchOptions(reduction="ample", threads=2)),
    "violated": (wanderers(160, most=15), SearchOptions(reduction="none")),
}
MIB = 2**20


def system_of(text: str) -> System:
    """The test of a program."""
    return system_of_test(check_file("w.soter", text), "T")


@pytest.mark.parametrize("name", MODELS)
def test_cut_by_time(name: str, tmp_path: Path) -> None:
    text, options = MODELS[name]
    system, random = system_of(text), chance(1)
    with anywhere():
        whole = once(system, options)
        ends = [{"time": random.uniform(0.002, 0.2)} for _ in range(6)]
        said = in_pieces(system, options, tmp_path, random, ends)
    assert said == whole, f"{said}\n{whole}"


@pytest.mark.parametrize("name", MODELS)
def test_cut_by_memory(name: str, tmp_path: Path) -> None:
    text, options = MODELS[name]
    system, random = system_of(text), chance(2)
    with anywhere():
        whole = once(system, options)
        sizes = [300_000, *sorted(random.randint(300_000, 3 * MIB) for _ in range(6))]
        ends: list[dict[str, Any]] = [{"memory": size} for size in sizes]
        said = in_pieces(system, options, tmp_path, random, ends)
    assert said == whole, f"{said}\n{whole}"

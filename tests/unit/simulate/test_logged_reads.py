"""The decision module of a module with `rest` logs the estimate from which it followed SC."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from soter.api import Program
from soter.report.mcap_reading import log_messages

FOLLOW = Path(__file__).parents[3] / "examples" / "evidence" / "follow.soter"
TEXT = FOLLOW.read_text(encoding="utf-8")


def logged(folder: Path, text: str, engine: str = "native", until: str = "400ms") -> list[Any]:
    """Time, channel and message of all that the log of a run holds."""
    (folder / "flown.soter").write_text(text, encoding="utf-8")
    log = folder / "flown.mcap"
    Program(str(folder / "flown.soter")).simulate(until=until, engine=engine, log=log)
    return list(log_messages(log))


def steps_of(log: list[Any]) -> list[Any]:
    return [(time, m) for time, channel, m in log if channel == "soter/decisions"]


@pytest.mark.parametrize("engine", ["native", pytest.param("interp", marks=pytest.mark.long)])
def test_it_is_what_was_published_bit_by_bit(tmp_path: Path, engine: str) -> None:
    log = logged(tmp_path, TEXT, engine)
    sights = {time: m for time, channel, m in log if channel == "sight"}
    steps = steps_of(log)
    assert [time for time, _ in steps] == [100_000_000 * k for k in range(5)]
    for time, m in steps:
        assert m["reads"] == {"sight": {"value": sights[time], "age_ns": 0}}


def test_an_older_read_has_its_age(tmp_path: Path) -> None:
    slow = TEXT.replace("max_age 20ms", "max_age 40ms").replace(
        "Track period 10ms", "Track period 30ms"
    )
    log = logged(tmp_path, slow)
    sights = {time: m for time, channel, m in log if channel == "sight"}
    for time, m in steps_of(log):
        last = time // 30_000_000 * 30_000_000
        assert m["reads"]["sight"] == {"value": sights[last], "age_ns": time - last}


def test_a_stale_read_is_logged_with_its_age(tmp_path: Path) -> None:
    silent = TEXT.replace("  until 30s;", "  until 30s;\n  faults { silent r at 1 per 4s for 1s; }")
    reads = [
        (m["reads"]["sight"]["age_ns"], m)
        for _, m in steps_of(logged(tmp_path, silent, until="8s"))
    ]
    stale = [m for age, m in reads if age > 20_000_000]
    assert len(stale) > 5
    assert all(m["predicates"]["stale"] and m["mode_after"] == "SC" for m in stale)


def test_where_steps_are_in_any_order_nobody_knows_it(tmp_path: Path) -> None:
    shuffled = TEXT.replace("  until 30s;", "  until 30s;\n  faults { order any; }")
    assert not any("reads" in m for _, m in steps_of(logged(tmp_path, shuffled)))


def test_nobody_else_logs_it(tmp_path: Path) -> None:
    cart = FOLLOW.parents[1] / "wall" / "cart.soter"
    steps = steps_of(logged(tmp_path, cart.read_text(encoding="utf-8")))
    assert steps
    assert not any("reads" in m for _, m in steps)

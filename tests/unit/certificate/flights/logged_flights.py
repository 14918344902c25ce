"""Flights of examples/evidence/follow.soter as somebody may have logged them, and a certificate."""

from __future__ import annotations

import struct
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.language.front_end import check_file
from soter.report.mcap_log import (
    NUMBER,
    DecisionStep,
    LogChannel,
    LogHeader,
    ModeRecord,
    object_schema,
    write_mcap,
)
from unit.certificate import small_proofs
from unit.certificate.tubes import rest_entries

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

FOLLOW = Path(__file__).parents[4] / "examples" / "evidence" / "follow.soter"
TEXT = FOLLOW.read_text(encoding="utf-8")
MS = 1_000_000
SIGHT = object_schema({"gap": NUMBER, "way": NUMBER, "v": NUMBER})
LEVERS = object_schema({"gas": NUMBER, "brake": NUMBER})
BOX, WAYS = {"r.v": (-0.308, 0.302)}, {"r.v": (-0.361, 0.354)}


def certificate(folder: Path, text: str = TEXT, rest: str = "rest", system: str = "Line") -> Path:
    """A sealed certificate of the module of a program; `rest`: what stands for how it decides."""
    made = rest_entries.entry(rest_entries.flat_of(text), BOX, WAYS) | {"system": system}
    made[rest] = made.pop("rest")
    small_proofs.write(folder, {"follow.soter": text}, "follow.soter", [made], {})
    return folder


def sight_at(time_ns: int) -> dict[str, float]:
    """A train at 10 m/s far behind another one."""
    return {"gap": 200.0 - 1e-9 * time_ns, "way": 1e-8 * time_ns + 0.1, "v": 10.0}


@cache
def sha256() -> str:
    """Of the program."""
    checked = check_file(str(FOLLOW))
    assert checked.program is not None
    return checked.program.sha256


class Flight:
    """What a log holds, to be changed before it is written.

    `modes`: of each verdict, every 100 ms from 0 on; a period of the plant is 10 ms. `levers`: what
    AC or SC published, whenever SC steps.
    """

    def __init__(self, modes: str = "AAAAAAAA", last_ns: int | None = None) -> None:
        last_ns = (len(modes) - 1) * 100 * MS if last_ns is None else last_ns
        times = range(0, last_ns + 1, 10 * MS)
        self.sights: dict[int, dict[str, float]] = {t: sight_at(t) for t in times}
        self.levers = {t: {"gas": 0.0, "brake": 1.0} for t in range(0, last_ns + 1, 50 * MS)}
        self.steps: dict[int, dict[str, Any]] = {}
        self.modes = [(0, "SC")]
        before = "SC"
        for k, letter in enumerate(modes):
            after = "AC" if letter == "A" else "SC"
            if after != before:
                self.modes.append((100 * MS * k, after))
            self.steps[100 * MS * k] = self.step(100 * MS * k, before, after)
            before = after
        self.header = {"program_sha256": sha256(), "system": "Line"}
        self.more: dict[str, str] = {}

    def step(self, time_ns: int, before: str, after: str) -> dict[str, Any]:
        good = after == "AC"
        predicates = {"ttf": not good, "safer": good, "stale": False, "gate_fault": False}
        return {
            "mode_before": before,
            "mode_after": after,
            "predicates": predicates,
            "reads": {"sight": {"value": dict(sight_at(time_ns)), "age_ns": 0}},
        }

    def read(self, time_ns: int) -> dict[str, Any]:
        """What the verdict of a time read of `sight`, to be changed."""
        read: dict[str, Any] = self.steps[time_ns]["reads"]["sight"]
        return read

    def write(self, path: Path, *, messages: bool = True, module: str = "Follow") -> Path:
        steps = [DecisionStep(t, module, **s) for t, s in sorted(self.steps.items())]
        modes = [ModeRecord(t, module, m) for t, m in self.modes]  # type: ignore[arg-type]
        every = {"sight": (SIGHT, self.sights), "levers": (LEVERS, self.levers)}
        if not messages:
            del every["sight"]
        channels = [LogChannel(n, of, sorted(x.items())) for n, (of, x) in every.items()]
        header = LogHeader(**self.header, seed=1, tool_version="1", more=self.more)
        return write_mcap(path, channels, modes=modes, decisions=steps, header=header)


class Standstill:
    """What stands for the tube: good is whatever is slower than 30 m/s."""

    estimate_fields = ("sight.gap", "sight.way", "sight.v")
    judges_commands = False

    def why_not_good(self, estimate: Mapping[str, float]) -> str | None:
        return None if estimate["sight.v"] < 30.0 else "it is too fast"


def next_float(x: float) -> float:
    """The next number up of a positive one."""
    (bits,) = struct.unpack("<q", struct.pack("<d", x))
    (up,) = struct.unpack("<d", struct.pack("<q", bits + 1))
    return float(up)


def changed(flight: Flight, change: Callable[[Flight], object]) -> Flight:
    """A copy that somebody tampered with."""
    other = deepcopy(flight)
    change(other)
    return other

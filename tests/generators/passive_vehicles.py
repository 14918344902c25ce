"""Vehicles among moving things, and what is wrong with each in many ways.

Purpose: edits of `examples/exploration/` (`wheels`, …), none of which may be proved: what each
makes wrong is its name.
Non-goals: the rover of `people.soter` (`passive_program.py`); judging them.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "exploration"


@dataclass(frozen=True)
class WrongVehicle:
    """`edits`: pairs of what stands in the file and what is written in its place."""

    file: str
    name: str
    edits: tuple[tuple[str, str], ...]
    fails: tuple[str, ...]
    """The rows of the verdict one of which does not hold."""

    def write(self, folder: Path) -> Path:
        """The wrong program, with what it imports, in a folder."""
        text = (FOLDER / self.file).read_text("utf-8")
        for old, new in self.edits:
            assert old in text, old
            text = text.replace(old, new)
        tree = Path(shutil.copytree(FOLDER.parent, folder / "examples"))
        path = tree / "exploration" / self.file
        path.write_text(text, "utf-8")
        return path


def _wrong(file: str, fails: tuple[str, ...], *edits: tuple[str, str, str]) -> list[WrongVehicle]:
    return [WrongVehicle(file, name, ((old, new),), fails) for name, old, new in edits]


DRIVES_ON = ("P3", "start")
WRONG_VEHICLES = [
    *_wrong(
        "wheels.soter",
        DRIVES_ON,
        (
            "people run, and ttf counts with people who walk",
            "disturbance walks: float in [-W, W]",
            "disturbance walks: float in [-2.0 * W, 2.0 * W]",
        ),
        ("at rest is less than the slope", "REST: float = 0.15", "REST: float = 0.02"),
        (
            "the base brakes less than ttf counts on",
            "disturbance grip: float in [WEAK, STRONG]",
            "disturbance grip: float in [0.5 * WEAK, STRONG]",
        ),
        (
            "the base picks up more than ttf counts on",
            "disturbance grip: float in [WEAK, STRONG]",
            "disturbance grip: float in [WEAK, 1.5 * STRONG]",
        ),
        ("ttf without the time until SC acts", "LOOK: float = 0.12", "LOOK: float = 0.0"),
        ("reads are older than ttf allows for", "max_age 50ms", "max_age 200ms"),
        ("ttf without what people walk", "W * meanwhile(v)", "0.0"),
        ("ttf without the way to a stop", "s * s / (2.0 * BRAKE)", "0.0"),
        ("a slope on which nothing stands", "der v = grip", "der v = 8.0 * slope + grip"),
        (
            "SC creeps on",
            "publish drive = { v: 0.0, w: 0.0 }; }",
            "publish drive = { v: 0.2, w: 0.0 }; }",
        ),
        (
            "a base that comes to speeds slowly",
            "GAIN * (drive.v - v)",
            "0.15 * GAIN * (drive.v - v)",
        ),
        ("the DM looks too seldom", "  period 50ms;\n  safe", "  period 250ms;\n  safe"),
        (
            "the distance is off by more than ttf allows for",
            "seen.gap within 0.05",
            "seen.gap within 0.5",
        ),
    ),
    *_wrong(
        "wheels.soter",
        ("failsafe",),
        (
            "nobody tells the base to stop once the trusted part has",
            "failsafe drive = { v: 0.0, w: 0.0 }",
            "failsafe drive = { v: 0.3, w: 0.0 }",
        ),
    ),
    *_wrong(
        "announced.soter",
        DRIVES_ON,
        (
            "they are faster than is reckoned with when this robot stands",
            "- W * put_off",
            "- 2.0 * W * put_off",
        ),
        (
            "they speed up by more than is reckoned with",
            "der gap = more -",
            "der gap = more - 2.0 * RISE * stands(v) -",
        ),
        ("more is told than is left", "within LESS,", "within LESS + 0.2,"),
        (
            "ttf at rest without what AC may do until SC acts",
            "const AT_REST: float = 0.8",
            "const AT_REST: float = 0.5",
        ),
        ("ttf is that of a robot at rest", " + 0.75 * abs(v)", ""),
        ("ttf without the way to a stop", "AT_FASTEST: float = 1.42", "AT_FASTEST: float = 1.1"),
        ("what is told is too old", '"m/s" } max_age 50ms', '"m/s" } max_age 200ms'),
        ("it brakes less than is counted on", "[wheels.WEAK, wheels", "[0.5 * wheels.WEAK, wheels"),
    ),
    *_wrong(
        "hover.soter",
        DRIVES_ON,
        (
            "people run, and the drone counts with people who walk",
            "in [-W - DRIFT, W + DRIFT]",
            "in [-3.0 * W, 3.0 * W]",
        ),
        ("at rest is less than the error", "REST: float = 0.4", "REST: float = 0.09"),
        ("wind that SC does not stand against", "dx: float in [-D, D]", "dx: float in [-2.0, 2.0]"),
        ("the drone reads too old a state", "max_age 20ms", "max_age 150ms"),
        (
            "the drone's ttf without the time until SC acts",
            "LOOK: float = 0.05",
            "LOOK: float = 0.0",
        ),
        (
            "the drone's ttf without what people walk",
            "(W + DRIFT) * (LOOK + 0.15 + max(x, y) / B)",
            "0.0",
        ),
        (
            "SC brakes on one axis",
            "vec2(brake(near.wx), brake(near.wy)); }",
            "vec2(brake(near.wx), 0.0); }",
        ),
        ("ttf knows of no speed aside", " || abs(near.wy) > FAST;", ";"),
        (
            "the speed aside is off by more than ttf allows for",
            "near.wy within E_V",
            "near.wy within 0.5",
        ),
    ),
]
"""Each leaves `safe`, or loses what the proof rests on."""

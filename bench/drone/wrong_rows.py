"""The wrong stacks as rows of text, and the worlds in which they are flown.

Purpose: `WRONG`, changes that are unsafe in a world that is named with them, or say why no flight
can show that; `ASSUMED`, changes that break what the proofs take for granted of the program: those
are proved, and the verdict has to name what they break. Beside what bench/rows.py says of the text:
a section is a kind, a row `NAME: WORDS`; `in` is the file that is changed where an edit names
none, `verify` and `?` are `Wrong.verify` and `Wrong.assumed`, `flown` is one of `WORLDS`, `no` is
`Wrong.why`.
Non-goals: verifying, flying (`wrong_base.py`).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from bench.drone.wrong_base import Edit, World, Wrong
from bench.rows import Groups, edits_of, rows

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.rows import Row

RAMS = "examples/drone/corridor_adversaries.soter"
HOSTILE = "examples/drone/surveillance_adversaries.soter"
OWN = "bench/drone/drone_wrong_{}.soter"
LEFT = "Contains"
"""The box that is flown."""
EMPTY, RESERVE = "charge > 0.0", "DRAIN"
WORST = (
    Edit("battery.soter", "power: float in [LEAST, MOST]", "power: float in [MOST, MOST]"),
    Edit("battery.soter", "{ charge: charge, docked", "{ charge: charge + ERROR, docked"),
    Edit("battery.soter", "measured battery.charge within ERROR;", ""),
)
"""All the time the most power there may be, and a charge that is shown as high as it may be."""
LOW = (("battery.START_CHARGE", 0.05),)
"""The unbroken stack stays in its dock with so little."""


def _worlds(file: str, systems: str, *more: object, **others: object) -> tuple[World, ...]:
    return tuple(World(file, system, *more, **others) for system in systems.split())  # type: ignore[arg-type]


WORLDS = {
    "late": _worlds(OWN.format("battery"), "Late Wavering", 3600.0, RESERVE, 4, narrowed=WORST),
    "late empty": _worlds(OWN.format("battery"), "Late Wavering", 3600.0, EMPTY, 4, narrowed=WORST),
    "lying": _worlds(OWN.format("planner"), "Lying", 40.0, "Sound", 4),
    "rammed": _worlds(RAMS, "Ramming Pushing Jerking", 60.0, LEFT, 4),
    "collision": _worlds(RAMS, "Ramming", 60.0, "NoCollision", 4),
    "jumps": _worlds(OWN.format("corridor"), "Jumping", 60.0, LEFT, 4),
    "landing": _worlds(OWN.format("corridor"), "Landing Jumping", 60.0, LEFT, 4),
    "stack": _worlds(HOSTILE, "Ramming Twitching", 60.0, LEFT, 3),
    "stack lying": _worlds(HOSTILE, "Lying", 60.0, "Sound", 3),
    "airborne": _worlds(HOSTILE, "Careless", 60.0, EMPTY, 2, LOW),
}
GROUPS: Groups = {}


def _edits(row: Row) -> Iterator[Edit]:
    for line in row.said[""]:
        file, edit = re.findall(r"(?:(\w+\.soter): )?(.*)", line)[0]
        yield from (Edit(file or row.one("in"), *made) for made in edits_of(edit, GROUPS))


def _wrong(row: Row) -> Wrong:
    name, _, words = row.name.partition(": ")
    file, _, module = row.one("verify").partition(" ")
    why = row.one("no")
    worlds = () if why else WORLDS[row.one("flown")]
    verify = (file, module or None)
    return Wrong(row.section, name, words, tuple(_edits(row)), verify, worlds, why, row.one("?"))


_TEXT = Path(__file__).with_name("wrong_stacks.txt")
_ALL = [_wrong(row) for row in rows(_TEXT, ("in", "verify", "flown", "no", "?"), GROUPS)]
WRONG = tuple(wrong for wrong in _ALL if not wrong.assumed)
ASSUMED = tuple(wrong for wrong in _ALL if wrong.assumed)
assert len({(wrong.kind, wrong.name) for wrong in _ALL}) == len(_ALL), "two of the same name"

"""Nobody is nearer than one scan makes certain: the node against an exact referee.

Purpose: people where every error is at its bound, and the places where somebody could be unseen;
wrong nodes, each with one margin less, are caught by the same scenes; what no scene needs is named
in `SPARE`. The street with a lidar: nobody is touched by a rover that moves.
Non-goals: figures (`bench/exploration/people.py`).
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import numpy as np
import pytest

from generators.sight_referee import is_nearer, passes
from generators.sight_scenes import Declared, Sampler, Walk
from generators.sight_variants import Sights
from long_tests import examples

if TYPE_CHECKING:
    from pathlib import Path

    from generators.sight_scenes import Scene

    Edits = tuple[tuple[str, str], ...]

RIGHT, SILENT = "as it is", "silence counts"
SILENCE: Edits = (("param SILENCE: bool = false", "param SILENCE: bool = true"),)

FREE = "max(r - worlds.ERROR_RANGE, 0.0)"
SPREAD = "ray.slope + worlds.ERROR_HEADING"
ASIDE = "spread * (ray.free + THICK) + ray.jump + ray.moved"
LIMIT = "(THICK - ray.jump - ray.moved) / spread"
ALONG = "ray.free + before - ray.moved - THICK * worlds.ERROR_HEADING"
TO_BOX = "far - turned * (ray.slope * s + ray.jump)"
SINCE = "MIDDLE + old + LATE"
OFF = "ERROR_SPEED + PULL * (TURN + old + LATE)"
JUMP = "abs(v) * max(abs(t - before), abs(t - after)) * (abs(sin(a)) + slope)"
MOVED = "abs(t) * (people.W + off)"
DRIFT = "since * (ERROR_SPEED + PULL * (0.5 * since + NEW))"
END = "least - THICK - people.W * since - drift - MORE"

WRONG: dict[str, Edits] = {
    "no error of the range": ((FREE, "r"),),
    "nothing that people walk until it is told": ((END, END.replace(" - people.W * since", "")),),
    "error of the range added": ((FREE, "r + worlds.ERROR_RANGE"),),
    "silence always counts": (("SILENCE && r == worlds.NOTHING", "r == worlds.NOTHING"),),
    "rays that were dropped count": (("SILENCE && r == worlds.NOTHING", "r == worlds.NEVER"),),
    "no angle between rays": (("tan(0.5 * BETWEEN * float(wide))", "0.0"),),
    "no error of the heading": ((SPREAD, "ray.slope"),),
    "people are hit where they are nearest": (
        ("sqrt(max(THICK * THICK - aside * aside, 0.0))", "THICK"),
    ),
    "no angle in how far beside": ((ASIDE, "ray.jump + ray.moved"),),
    "beside without walking": ((ASIDE, ASIDE.replace(" + ray.moved", "")),),
    "beside without other origins": ((ASIDE, ASIDE.replace(" + ray.jump", "")),),
    "along without walking": ((ALONG, ALONG.replace(" - ray.moved", "")),),
    "no limit by THIN": ((LIMIT, "RANGE"),),
    "limit without walking": ((LIMIT, LIMIT.replace(" - ray.moved", "")),),
    "limit without other origins": ((LIMIT, LIMIT.replace(" - ray.jump", "")),),
    "limit by twice THIN": ((LIMIT, LIMIT.replace("THICK", "THIN")),),
    "on the ray, not beside": ((TO_BOX, "far"),),
    "beside it without other origins": ((TO_BOX, TO_BOX.replace(" + ray.jump", "")),),
    "nobody has a size": ((END, END.replace(" - THICK", "")),),
    "no time since the scan": ((SINCE, "MIDDLE + LATE"),),
    "no time until the middle of the turn": ((SINCE, "old + LATE"),),
    "no time until it is told": ((SINCE, "MIDDLE + old"),),
    "people stand still while it turns": ((MOVED, "abs(t) * off"),),
    "no other origins": ((JUMP, "0.0"),),
    "one origin for all rays": (("v * (t - since), a)", "-v * since, a)"),),
    "the rover is where the rays left": (("v * (t - since), a)", "0.0, a)"),),
    "no error of the speed while it turns": ((OFF, "0.0"),),
    "no acceleration since": ((DRIFT, "since * ERROR_SPEED"),),
    "no drift": ((END, END.replace(" - drift", "")),),
    "the speed is exact": ((DRIFT, DRIFT.replace("ERROR_SPEED", "0.0")),),
    "the speed is new": ((DRIFT, DRIFT.replace(" + NEW", "")),),
    "all rays left at once": (
        ("(newest - k / worlds.AT_ONCE + worlds.FIRINGS) % worlds.FIRINGS", "0"),
    ),
    "the turn ends behind": (
        (
            "(newest - k / worlds.AT_ONCE + worlds.FIRINGS) % worlds.FIRINGS",
            "worlds.FIRINGS - 1 - k / worlds.AT_ONCE",
        ),
    ),
    "neighbours that were dropped count": (("let wide = max(left[k], right[k])", "let wide = 1"),),
    "the nearer neighbour": (("max(left[k], right[k])", "min(left[k], right[k])"),),
    "half a metre of people": (("THIN: float = 0.2", "THIN: float = 0.5"),),
}
"""One margin less each; the first ones are tried always."""
QUICK = 2

SPARE: dict[str, Edits] = {}
"""What no scene was found to need; docs/exploration.md derives all of it."""


class Court:
    """Nodes that are tried on scenes, and what the referee finds."""

    def __init__(self, variants: dict[str, Edits], work: Path) -> None:
        self.sights = Sights(variants, work)
        self.declared = Declared.of(self.sights.constants)
        self.sampler = Sampler(self.declared)

    def scene(self, kind: str, number: int) -> Scene:
        draw = random.Random(f"{kind} {number}")  # noqa: S311 - draws, not secrets
        people = kind == "people"
        return self.sampler.with_people(draw) if people else self.sampler.with_things(draw)

    def certain(self, name: str, scene: Scene) -> float:
        return self.sights.certain(name, scene.ranges, scene.newest, scene.told, scene.old)

    def nearer(self, scene: Scene, walk: Walk, gap: float) -> bool:
        d = self.declared
        box = (float(scene.x(d.late)), d.long, d.wide)
        return is_nearer((walk.x, walk.y), walk.radius, box, gap)

    def may_be(self, scene: Scene) -> bool:
        """Whether the scan is one that the declared errors allow, with these people there."""
        d = self.declared
        t, says = scene.times(d), scene.ranges
        for k, (m, angle) in enumerate(zip(says, d.directions() + scene.headings, strict=True)):
            if not (0.0 <= m <= d.reach or m == d.nothing):
                continue
            length = d.reach if m == d.nothing else float(m) - d.e_range
            origin, along = (
                (float(scene.x(t[k])), 0.0),
                (float(np.cos(angle)), float(np.sin(angle))),
            )
            for walk in scene.people:
                x, y = walk.at(t[k : k + 1], d.late)
                if not passes(origin, along, length, (float(x[0]), float(y[0])), walk.radius):
                    return False
        return bool(np.abs(scene.headings).max() <= d.e_heading)

    def first_lie(self, name: str, count: int) -> int | None:
        """The first scene in which somebody is nearer than a wrong node says."""
        for number in range(count):
            scene = self.scene("people", number)
            gap = self.certain(name, scene)
            if any(self.nearer(scene, walk, gap) for walk in scene.people):
                assert self.may_be(scene), number
                return number
        return None


@pytest.fixture(scope="module")
def court(tmp_path_factory: pytest.TempPathFactory) -> Court:
    some = {RIGHT: (), SILENT: SILENCE, **WRONG, **SPARE}
    return Court({n: (*SILENCE, *e) if n not in (RIGHT, SILENT) and e[0][0][:7] != "SILENCE" else e for n, e in some.items()}, tmp_path_factory.mktemp("sights"))

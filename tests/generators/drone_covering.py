"""`Cover` and `Route` of examples/drone, compiled: many plans in one call, each with its time.

Purpose: what flies on board, called as functions, without a simulation around it.
Non-goals: judging what they answer (`drone_corridors.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from cffi import FFI

from soter.codegen.unit import generate
from soter.language.front_end import check_file, system_of
from soter.native.shared_library import library

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Plan = Sequence[Sequence[float]]

PROGRAM = """soter 1;
import "{folder}/boxes.soter" as boxes;
import "{folder}/cover.soter" as cover;
import "{folder}/roadmap.soter" as roadmap;
input topic start: Vec3;
input topic goal: Vec3;
topic plan: boxes.Plan;
topic corridor: boxes.Corridor;
topic asked: boxes.Corridor;
node Planner period 100ms {{
  subscribes start, goal;
  publishes plan;
  step {{ publish plan = roadmap.Route(start, goal); }}
}}
node Follower period 100ms {{
  subscribes plan, start, goal;
  publishes corridor, asked;
  step {{
    publish corridor = cover.Cover(plan);
    publish asked = cover.CoverFor(plan, start, goal);
  }}
}}
system Main {{ node Planner; node Follower; until 1s; }}
"""
COVER = (
    "void soter_cover_plans(int64_t n, const double *points, const int32_t *lengths, "
    "const double *ends, bool asked, double *boxes, int32_t *counts, "
    "uint8_t *verdicts, double *nanoseconds);"
)
ROUTE = (
    "void soter_route_plans(int64_t n, const double *ends, "
    "double *points, int32_t *lengths, double *nanoseconds);"
)
GLUE = """
#include <string.h>
#include <time.h>
{cover}
{route}
static double since(const struct timespec *a) {{
  struct timespec b;
  (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &b);
  return (double)(b.tv_sec - a->tv_sec) * 1e9 + (double)(b.tv_nsec - a->tv_nsec);
}}
{cover_opening} {{
  for (int64_t i = 0; i < n; i++) {{
    {p}_Vec3_list_{points} plan;
    memset(&plan, 0, sizeof plan);
    memcpy(plan.items, points + i * 3 * {points}, sizeof plan.items);
    plan.len = lengths[i];
    {p}_Vec3 e[2];
    memcpy(e, ends + 6 * i, sizeof e);
    struct timespec a;
    soter_fault fault = SOTER_OK;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &a);
    {p}_boxes_Corridor c;
    memset(&c, 0, sizeof c);
    if (asked) {p}_cover_CoverFor_fn(&plan, e[0], e[1], &c, &fault);
    else {p}_cover_Cover_fn(&plan, &c, &fault);
    nanoseconds[i] = since(&a);
    memcpy(boxes + i * 9 * {blocks}, c.blocks.items, sizeof c.blocks.items);
    counts[i] = c.blocks.len;
    verdicts[i] = fault == SOTER_OK ? c.verdict : 255U;
  }}
}}
{route_opening} {{
  for (int64_t i = 0; i < n; i++) {{
    {p}_Vec3 e[2];
    memcpy(e, ends + 6 * i, sizeof e);
    struct timespec a;
    soter_fault fault = SOTER_OK;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &a);
    {p}_Vec3_list_{points} plan;
    memset(&plan, 0, sizeof plan);
    {p}_roadmap_Route_fn(e[0], e[1], &plan, &fault);
    nanoseconds[i] = since(&a);
    memcpy(points + i * 3 * {points}, plan.items, sizeof plan.items);
    lengths[i] = fault == SOTER_OK ? plan.len : -1;
  }}
}}
"""


@dataclass(frozen=True)
class Covered:
    """The answer for one plan: verdict by name, boxes (n, 9) as low, high, aim; CPU time in s."""

    verdict: str
    boxes: NDArray[np.float64]
    seconds: float


@dataclass(frozen=True)
class Routed:
    """The way that the roadmap knows: points (n, 3); empty where there is none; CPU time in s."""

    plan: NDArray[np.float64]
    seconds: float


class Onboard:
    """`cover.Cover` and `roadmap.Route` as they are compiled.

    `drone` is the folder of boxes.soter, `work` one for the program that calls them.
    """

    def __init__(self, drone: Path, work: Path) -> None:
        path = work / "covering.soter"
        path.write_text(PROGRAM.format(folder=drone.as_posix()), encoding="utf-8")
        checked = check_file(str(path))
        assert checked.ok, checked.diagnostics.items
        assert checked.program is not None
        self.constants: dict[str, Any] = {
            name.removeprefix("boxes."): c.value for name, c in checked.program.consts.items()
        }
        answer: Any = checked.program.topics["corridor"].type
        self.verdicts: tuple[str, ...] = dict(answer.fields)["verdict"].members
        self.points, self.blocks = self.constants["POINTS"], self.constants["BLOCKS"]
        unit = generate(system_of(checked, "Main", {}))
        openings = {"cover_opening": COVER[:-1], "route_opening": ROUTE[:-1]}
        glue = GLUE.format(
            p=unit.prefix,
            points=self.points,
            blocks=self.blocks,
            cover=COVER,
            route=ROUTE,
            **openings,
        )
        built = library(replace(unit, source=unit.source + glue), extra=("-std=gnu11",))
        self._ffi: Any = FFI()
        self._ffi.cdef(COVER + ROUTE)
        self._lib: Any = self._ffi.dlopen(str(built))

    def _pointer(self, kind: str, array: NDArray[Any]) -> Any:
        return self._ffi.cast(f"{kind} *", array.ctypes.data)

    def cover(self, plans: Sequence[Plan], ends: Sequence[Plan] | None = None) -> list[Covered]:
        """The corridor of each plan, or why it is refused; `ends`: as `CoverFor` answers."""
        n = len(plans)
        given = np.zeros((n, 6)) if ends is None else np.asarray(ends, dtype=float).reshape(n, 6)
        points, boxes = np.zeros((n, self.points, 3)), np.zeros((n, self.blocks, 9))
        lengths = np.array([len(p) for p in plans], dtype=np.int32)
        for row, plan in zip(points, plans, strict=True):
            if len(plan):
                row[: len(plan)] = np.asarray(plan, dtype=float)
        counts, verdicts, times = np.zeros(n, np.int32), np.zeros(n, np.uint8), np.zeros(n)
        self._lib.soter_cover_plans(
            n,
            self._pointer("double", points),
            self._pointer("int32_t", lengths),
            self._pointer("double", given),
            ends is not None,
            self._pointer("double", boxes),
            self._pointer("int32_t", counts),
            self._pointer("uint8_t", verdicts),
            self._pointer("double", times),
        )
        names = [self.verdicts[v] if v < len(self.verdicts) else "fault" for v in verdicts]
        return [
            Covered(name, box[:count], time / 1e9)
            for name, box, count, time in zip(names, boxes, counts, times, strict=True)
        ]

    def route(self, ends: Sequence[Plan]) -> list[Routed]:
        """The way of the roadmap between two points, for each pair."""
        n = len(ends)
        given = np.asarray(ends, dtype=float).reshape(n, 6)
        points = np.zeros((n, self.points, 3))
        lengths, times = np.zeros(n, np.int32), np.zeros(n)
        self._lib.soter_route_plans(
            n,
            self._pointer("double", given),
            self._pointer("double", points),
            self._pointer("int32_t", lengths),
            self._pointer("double", times),
        )
        assert (lengths >= 0).all(), "Route faults"
        return [
            Routed(row[:k], time / 1e9) for row, k, time in zip(points, lengths, times, strict=True)
        ]

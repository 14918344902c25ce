"""`Cover` of examples/drone/boxes.soter, compiled: many plans in one call, each with its time.

Purpose: what flies on board, called as a function, without a simulation around it.
Non-goals: judging what it answers (`corridors.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from cffi import FFI

from soter.codegen.unit import generate
from soter.native.build import library
from soter.program.build import check_file, system_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

PROGRAM = """soter 1;
import "{boxes}" as boxes;
input topic plan: boxes.Plan;
topic corridor: boxes.Corridor;
node Follower period 100ms {{
  subscribes plan;
  publishes corridor;
  step {{ publish corridor = boxes.Cover(plan); }}
}}
system Main {{ node Follower; until 1s; }}
"""
SIGNATURE = (
    "void soter_cover_plans(const double *points, const int32_t *lengths, int64_t n, "
    "double *boxes, int32_t *counts, uint8_t *verdicts, double *nanoseconds);"
)
GLUE = """
#include <string.h>
#include <time.h>
{signature}
{opening} {{
  for (int64_t i = 0; i < n; i++) {{
    {p}_Vec3_list_{points} plan;
    memset(&plan, 0, sizeof plan);
    memcpy(plan.items, points + i * 3 * {points}, sizeof plan.items);
    plan.len = lengths[i];
    struct timespec a, b;
    soter_fault fault = SOTER_OK;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &a);
    const {p}_boxes_Corridor c = {p}_boxes_Cover_fn(plan, &fault);
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &b);
    nanoseconds[i] = (double)(b.tv_sec - a.tv_sec) * 1e9 + (double)(b.tv_nsec - a.tv_nsec);
    memcpy(boxes + i * 9 * {blocks}, c.blocks.items, sizeof c.blocks.items);
    counts[i] = c.blocks.len;
    verdicts[i] = fault == SOTER_OK ? c.verdict : 255U;
  }}
}}
"""


@dataclass(frozen=True)
class Covered:
    """The answer for one plan: verdict by name, boxes (n, 9) as low, high, aim; CPU time in s."""

    verdict: str
    boxes: NDArray[np.float64]
    seconds: float


class Cover:
    """`boxes.Cover` as it is compiled; `folder` is for the program that it stands in."""

    def __init__(self, boxes: Path, folder: Path) -> None:
        path = folder / "covering.soter"
        path.write_text(PROGRAM.format(boxes=boxes.as_posix()), encoding="utf-8")
        checked = check_file(str(path))
        assert checked.ok, checked.diagnostics.items
        assert checked.program is not None
        self.constants: dict[str, Any] = {
            name.removeprefix("boxes."): c.value for name, c in checked.program.consts.items()
        }
        answer: Any = checked.program.topics["corridor"].type
        self.verdicts: tuple[str, ...] = dict(answer.fields)["verdict"].members
        unit = generate(system_of(checked, "Main", {}))
        self.points, self.blocks = self.constants["POINTS"], self.constants["BLOCKS"]
        glue = GLUE.format(
            p=unit.prefix,
            points=self.points,
            blocks=self.blocks,
            signature=SIGNATURE,
            opening=SIGNATURE[:-1],
        )
        ffi: Any = FFI()
        ffi.cdef(SIGNATURE)
        self._ffi = ffi
        built = library(replace(unit, source=unit.source + glue), extra=("-std=gnu11",))
        self._lib = ffi.dlopen(str(built))

    def __call__(self, plans: Sequence[Sequence[Sequence[float]]]) -> list[Covered]:
        """The corridor of each plan, or why it is refused."""
        n = len(plans)
        points = np.zeros((n, self.points, 3))
        lengths = np.array([len(p) for p in plans], dtype=np.int32)
        for row, plan in zip(points, plans, strict=True):
            if plan:
                row[: len(plan)] = np.asarray(plan, dtype=float)
        boxes = np.zeros((n, self.blocks, 9))
        counts, verdicts = np.zeros(n, np.int32), np.zeros(n, np.uint8)
        times = np.zeros(n)
        arrays = (points, lengths, n, boxes, counts, verdicts, times)
        kinds = ("double", "int32_t", "", "double", "int32_t", "uint8_t", "double")
        self._lib.soter_cover_plans(
            *(
                self._ffi.cast(f"{kind} *", a.ctypes.data) if isinstance(a, np.ndarray) else a
                for a, kind in zip(arrays, kinds, strict=True)
            )
        )
        names = [self.verdicts[v] if v < len(self.verdicts) else "fault" for v in verdicts]
        return [
            Covered(name, box[:count], time / 1e9)
            for name, box, count, time in zip(names, boxes, counts, times, strict=True)
        ]

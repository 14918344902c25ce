"""One reach question asked of Soter's check, of rtreach and of immrax, on one core in one run.

    .venv/bin/python bench/tubes/peers.py --rtreach libRtreach.so --immrax PYTHON

`--rtreach` is the library that build_rtreach.sh of pmusau17/rtreach_f1tenth makes, `--immrax` an
interpreter that has immrax; without them only Soter's row is printed. Both refine by a step of
time: a row each, of rtreach until one is as near as Soter's check. How near: the distance before
a box at which the tool last says that a car that rolls out stays clear (`turning_car.py`). The
steps of immrax are Euler's, whose own error is in no bound.
Purpose: cost beside tightness. Non-goals: what they do not have (ages, lateness, any command).
"""

from __future__ import annotations

import argparse
import ctypes as ct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.tubes.check_cost import built  # noqa: E402 - as above
from bench.tubes.turning_car import (  # noqa: E402
    BOXES,
    CH,
    ERRORS,
    HORIZON_S,
    PROGRAM,
    SPEED,
    STEER,
    grown,
    nearest,
)

from soter.report.terminal_tables import table  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    Row = tuple[str, float, float]
    """What was asked, how near in metres, microseconds of a decision."""

ASKED = 200
DIMENSIONS = 4
REFINED = 14


def median_us(ask: Callable[[Sequence[float]], float], near: float) -> float:
    """Of decisions a centimetre before the last yes; `ask` returns microseconds."""
    return sorted(ask((-near - 0.01, 0.0, SPEED, 0.0)) for _ in range(ASKED))[ASKED // 2]


def soter_row() -> Row:
    """The check that flies, asked with 20 boxes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = folder / "turning_car.soter"
        program.write_text(PROGRAM, encoding="utf-8")
        ffi, library, n = built(program, folder)
        assert n == DIMENSIONS
        us = ffi.new("double *")

        def clear(x: Sequence[float]) -> bool:
            return bool(library.ask(ffi.new("double[]", list(x)), us))

        def ask(x: Sequence[float]) -> float:
            assert clear(x)
            return float(us[0])

        near = nearest(clear)
        return "Soter", near, median_us(ask, near)


class _Range(ct.Structure):
    _fields_ = (("min", ct.c_double), ("max", ct.c_double))


class _Settings(ct.Structure):
    """`LiftingSettings` of face_lift.h."""

    _fields_ = (
        ("init", _Range * DIMENSIONS),
        ("reach_s", ct.c_double),
        ("step_s", ct.c_double),
        ("widest", ct.c_double),
        ("runtime_ms", ct.c_int),
        ("at_each", ct.c_void_p),
        ("at_last", ct.c_void_p),
        ("again", ct.c_void_p),
    )


class Rtreach:
    """Its face lifting, one pass with a step that is given."""

    def __init__(self, library: str) -> None:
        self._library = ct.CDLL(str(Path(library).resolve()))
        self._kept = [self._corners(b) for b in grown()]  # what C points to
        pointers = [ct.addressof(of) for of, *_ in self._kept]
        self._boxes = (ct.c_void_p * len(BOXES))(*pointers)
        ct.c_void_p.in_dll(self._library, "obstacles").value = ct.addressof(self._boxes)
        ct.c_int.in_dll(self._library, "obstacle_count").value = len(BOXES)
        self._at_each = ct.cast(self._library.intermediateState, ct.c_void_p).value
        self._lifted = self._library.face_lifting_iterative_improvement_bicycle
        self._lifted.argtypes = [ct.c_int, ct.POINTER(_Settings), ct.c_double, ct.c_double]
        self._lifted.restype = ct.c_bool

    @staticmethod
    def _corners(box: Sequence[float]) -> tuple[ct.Array[Any], ...]:
        x, y = ((ct.c_double * 2)(*box[k : k + 2]) for k in (0, 2))
        return (ct.c_void_p * 2)(ct.addressof(x), ct.addressof(y)), x, y

    def ask(self, x: Sequence[float], step_s: float) -> tuple[bool, float]:
        """Whether it is clear, and microseconds; a negative budget would refine."""
        ends = [_Range(v - e, v + e) for v, e in zip(x, ERRORS, strict=True)]
        at_each = self._at_each
        init = (_Range * DIMENSIONS)(*ends)
        settings = _Settings(init, HORIZON_S, step_s, 100.0, 0, at_each, None, None)
        began = time.process_time()
        clear = self._lifted(0, ct.byref(settings), STEER, CH)
        return clear, 1e6 * (time.process_time() - began)

    def rows(self) -> Iterator[Row]:
        """A row a step, each half of the one before."""
        for k in range(REFINED):
            step = HORIZON_S / 10 / 2**k
            near = nearest(lambda x: self.ask(x, step)[0])  # noqa: B023 - asked at once
            us = median_us(lambda x: self.ask(x, step)[1], near)  # noqa: B023 - as above
            yield f"rtreach, {1e3 * step:.3g} ms", near, us


def immrax_rows(interpreter: str) -> Iterator[Row]:
    """What `immrax_car.py` prints."""
    script = Path(__file__).with_name("immrax_car.py")
    told = subprocess.run([interpreter, script], check=True, capture_output=True, text=True)
    for line in told.stdout.splitlines():
        step, near, us = map(float, line.split())
        yield f"immrax, {1e3 * step:.3g} ms", near, us


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rtreach", help="libRtreach.so")
    parser.add_argument("--immrax", help="an interpreter that has immrax")
    given = parser.parse_args()
    ours = soter_row()
    rows = [ours]
    if given.rtreach:
        for row in Rtreach(given.rtreach).rows():
            rows.append(row)
            if row[1] <= ours[1]:
                break
    if given.immrax:
        rows += immrax_rows(given.immrax)
    heads = ["asked", "clear at", "a decision", "times Soter's"]
    print(
        table(heads, [[n, f"{d:.3f} m", f"{t:.0f} us", f"{t / ours[2]:.2f}"] for n, d, t in rows])
    )


if __name__ == "__main__":
    main()

"""Boxes that move together move as each of them alone: the same bits.

The engine's own functions are called: `soter_reach_hold`, which asks the law, beside
`soter_reach_move`, which is told the command that the law gives, on every kind of vectors of this
machine.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.native.compiler import vector_flags
from soter.verify.enclose.compiled_enclosures import ReachLibrary
from soter.verify.grid.grid_problem import GridInputs
from soter.verify.grid.sets import GridGroup
from tables import all_rows
from unit.verify.grid.small_enclosure_units import QUICK, linear_source
from unit.verify.grid.test_grid_enclosures import MS

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

NARROW = ("-mno-avx512f", "-mno-avx512dq")
LANES = {4: (*NARROW, "-mavx2"), 2: (*NARROW, "-mno-avx2", "-mno-avx")} if vector_flags() else {}
if "-mavx512f" in vector_flags() or not LANES:
    LANES[8 if LANES else 2] = ()
"""How many boxes move at once, and the flags of it: those of this machine, and fewer."""


@dataclass(frozen=True)
class Flow:
    """x' = a x + b u + w, u = clamp(-gains x, +-limit), |w| <= wind."""

    a: Sequence[Sequence[float]]
    b: Sequence[Sequence[float]]
    gains: Sequence[Sequence[float]]
    limit: float
    wind: float
    end: float
    """The grid goes from -end to end along each axis."""

    def engine(self, flags: tuple[str, ...] = ()) -> GridGroup:
        a, b, gains = (np.array(v, dtype=np.float64) for v in (self.a, self.b, self.gains))
        library = ReachLibrary(linear_source(a, b, gains, self.limit), (*QUICK, *flags))
        inputs = GridInputs(
            states=((-self.end, self.end),) * len(a),
            controls=((-self.limit, self.limit),) * b.shape[1],
            disturbances=((-self.wind, self.wind),) * len(a),
            period_ns=20 * MS,
        )
        edges = np.linspace(-self.end, self.end, 13)
        return GridGroup(library, inputs, [(i, edges) for i in range(len(a))])

    def commands(self, low: Floats, high: Floats) -> Floats | None:
        """What the law gives all over a box; None: not one number each."""
        gains = np.array(self.gains)
        middle, half = gains @ (low + high) / 2, np.abs(gains) @ (high - low) / 2
        if (np.abs(middle) - half > 1.001 * self.limit).all():
            return np.asarray(-np.sign(middle) * self.limit)
        return np.zeros(len(gains)) if not gains.any() else None


CART = Flow([[0, 1], [0, 0]], [[0], [1]], [[300, 200]], 3.0, 0.0, 4.0)
FLOWS = {
    "cart": CART,
    "wind": Flow([[0, 1], [0, 0]], [[0], [1]], [[300, 200]], 3.0, 0.25, 4.0),
    "no push": Flow([[0, 1], [-1, -0.25]], [[0], [1]], [[0, 0]], 3.0, 0.0, 4.0),
    "lag": Flow(
        [[0, 1, 0], [0, 0, 1], [0, 0, -10]], [[0], [0], [10]], [[90, 80, 0]], 3.0, 0.0, 3.0
    ),
    "kept": Flow([[-2, 0.25], [0.25, -3]], [[1], [-1]], [[40, 30]], 1.0, 0.0, 2.0),
    "cut": Flow([[-1.125, 1], [0, 0]], [[0], [1]], [[-900, -800]], 40.0, 0.0, 2.0),
    "one": Flow([[-1]], [[1]], [[70]], 0.5, 0.0, 2.0),
    "four": Flow(
        [[0, 1, 0, 0], [0, -0.5, 0, 0], [0, 0, 0, 1], [0.25, 0, -1, 0]],
        [[0, 0], [1, 0.5], [0, 0], [0, 1]],
        [[50, 90, 0, 0], [0, 0, 40, 70]],
        2.0,
        0.125,
        4.0,
    ),
}


@dataclass
class Chains:
    """Some chains of an engine, as its own functions see them."""

    engine: GridGroup

    @cached_property
    def lib(self) -> ctypes.CDLL:
        lib = ctypes.CDLL(str(self.engine.library.path))
        lib.soter_reach_move.restype = ctypes.c_uint
        return lib

    @cached_property
    def scratch(self) -> ctypes.Array[ctypes.c_double]:
        n = self.engine.library.inputs
        room = (ctypes.c_double * (2 * n * (4 + n) + 8))()
        self.lib.soter_reach_inputs(self.group, ctypes.byref(room))
        return room

    @cached_property
    def group(self) -> ctypes.c_void_p:
        return self.address(self.engine.c)

    def address(self, at: Any) -> ctypes.c_void_p:
        return ctypes.c_void_p(int(self.engine.library.ffi.cast("uintptr_t", at)))

    def started(self, boxes: list[tuple[Floats, Floats]]) -> Any:
        """Chains that begin in boxes."""
        chains = self.engine.library.ffi.new("soter_reach_chain[]", len(boxes))
        for k, (low, high) in enumerate(boxes):
            ends = [v.ctypes.data_as(ctypes.c_void_p) for v in (low, high)]
            self.lib.soter_reach_start(self.group, *ends, self.address(chains + k))
        return chains

    def hold(self, chain: Any) -> Floats | None:
        """One hold; its tube and image."""
        out = np.zeros((4, 4))
        to = out.ctypes.data_as(ctypes.c_void_p)
        scratch = ctypes.byref(self.scratch)
        done = self.lib.soter_reach_hold(self.group, scratch, self.address(chain), to)
        return out[:, : len(self.engine.axes)] if done else None

    def move(self, chains: Any, commands: Floats) -> tuple[int, Floats]:
        """One hold of all: which moved, their tubes and images."""
        out, count = np.zeros((len(commands), 4, 4)), len(commands)
        movers = np.zeros((count, 3), dtype=np.uintp)
        for k in range(count):
            movers[k] = (self.address(chains + k).value or 0, commands[k].ctypes.data, 0)
            movers[k, 2] = out[k].ctypes.data
        to = movers.ctypes.data_as(ctypes.c_void_p)
        moved = self.lib.soter_reach_move(self.group, ctypes.c_int(count), to)
        return int(moved), out[:, :, : len(self.engine.axes)]

    def numbers(self, chain: Any) -> list[float]:
        """All that a chain goes on from."""
        n = range(len(self.engine.axes))
        rows = [[c[i] for i in n] for c in (chain.m, chain.box, chain.lo, chain.hi)]
        flat = [x for row in rows for x in row] + [chain.g[i][j] for i in n for j in n]
        return [*flat, float(chain.holds)]


def boxes_of(flow: Flow, rng: np.random.Generator, count: int) -> list[tuple[Floats, Floats]]:
    """Boxes on all of which the law gives one command, some of them at ends of the grid."""
    found: list[tuple[Floats, Floats]] = []
    while len(found) < count:
        low = rng.uniform(-flow.end, flow.end, len(flow.a))
        high = low + rng.choice([0.0, 0.01, 0.3]) * rng.random(len(low))
        at_end = rng.random(len(low)) < 0.2
        high = np.where(at_end, flow.end, np.minimum(high, flow.end))
        low = np.where(at_end, np.minimum(low, flow.end) / 2 + flow.end / 2, low)
        if rng.random() < 0.5:
            low, high = -high, -low
        if flow.commands(low, high) is not None:
            found.append((low, high))
    return found


CASES = [(name, max(LANES)) for name in FLOWS] + [
    (name, lanes) for name in ("wind", "kept", "four") for lanes in LANES if lanes < max(LANES)
]


@all_rows(("name", "lanes"), CASES)
def test_boxes_move_together_as_alone(name: str, lanes: int) -> None:
    flow, rng = FLOWS[name], np.random.default_rng(3)
    chains = Chains(flow.engine(LANES[lanes]))
    compared = refused = 0
    for turn in range(40):
        boxes = boxes_of(flow, rng, 1 + turn % lanes)
        alone, together = chains.started(boxes), chains.started(boxes)
        for _ in range(3):
            now = [
                (np.array(list(c.lo)[: len(flow.a)]), np.array(list(c.hi)[: len(flow.a)]))
                for c in together
            ]
            commands = [flow.commands(low, high) for low, high in now]
            if any(u is None for u in commands):
                break
            before = [chains.numbers(c) for c in together]
            moved, told = chains.move(together, np.array(commands))
            for k in range(len(boxes)):
                held = chains.hold(alone + k)
                if not moved >> k & 1:
                    assert chains.numbers(together[k]) == before[k]
                    chains.hold(together + k)
                    refused += 1
                    continue
                assert held is not None
                assert chains.numbers(together[k]) == chains.numbers(alone[k])
                assert held.tobytes() == told[k].tobytes()
                compared += 1
    assert compared > 40
    assert refused <= compared // 10


@pytest.mark.parametrize("side", [1, -1])
def test_what_passes_an_end_that_runs_keep_is_cut(side: int) -> None:
    """y is pushed out of the grid, and x' = y - x would follow it: but such runs are lost."""
    engine = FLOWS["cut"].engine()
    assert (engine.c.kept_low[0], engine.c.kept_high[0]) == (1, 1)
    chains = Chains(engine)
    corner = (np.array([1.9, 1.99]), np.array([2.0, 2.0]))
    boxes = [corner if side > 0 else (-corner[1], -corner[0])]
    together, alone = chains.started(boxes), chains.started(boxes)
    moved, _ = chains.move(together, np.array([[40.0 * side]]))
    chains.hold(alone)
    assert moved == 1
    assert (together[0].hi[0] if side > 0 else together[0].lo[0]) == 2.0 * side
    assert side * together[0].m[0] + together[0].g[0][0] > 1.99
    assert chains.numbers(together[0]) == chains.numbers(alone[0])


def test_a_box_that_may_stand_does_not_move_with_others() -> None:
    """Where v may be 0 all along: what stands is not grown by rounding, and is asked of alone."""
    flow = FLOWS["no push"]
    chains = Chains(flow.engine())
    still = (np.zeros(2), np.zeros(2))
    going = (np.array([1.0, 1.0]), np.array([1.1, 1.1]))
    together = chains.started([going, still])
    moved, _ = chains.move(together, np.zeros((2, 1)))
    assert moved == 1
    assert list(together[1].lo)[:2] == [0.0, 0.0] == list(together[1].hi)[:2]
    assert (together[0].holds, together[1].holds) == (1, 0)

"""Steps of the trusted thread, timed one by one on this machine.

Purpose: `time_steps` gives, for every component of the thread that is Soter code, the times of
single steps, on states of a run (`sampled_states`) and on copies of them in which what the
component reads is drawn at random (`varied_states`), each with the processor's caches as they are
and swept. `StepTimes` has the figures, and the `wcet` that they suggest.
Non-goals: bounds, which no measurement gives; random locals, which keep the values of the run.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.codegen.unit import generate
from soter.core.layout import encode_into, state_dtype
from soter.language.model.system import Bound, Component, System, queues_read_by
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    Type,
    Value,
    leaves,
    write_ns,
)
from soter.native.c_interface import address, declarations, interface, open_library
from soter.native.shared_library import RUNTIME, library
from soter.simulate.externs.c_extern import linked_symbols

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy.typing as npt

    from soter.core.core import CoreSystem
    from soter.core.layout import Bytes, StateLayout


WILD = 1e3
"""Floats of a topic without a set are drawn from -WILD to WILD."""
FAR = 1 << 31
"""Ints of a topic without a set are drawn from -FAR to FAR."""


def sampled_states(trace: Bytes, count: int) -> Bytes:
    """A copy of at most `count` states, evenly spread over a trace (n, size)."""
    places = np.unique(np.linspace(0, len(trace) - 1, min(count, len(trace))).astype(int))
    states: Bytes = trace[places].copy()
    return states


def topics_read(system: System, c: Component) -> tuple[int, ...]:
    """The topics that a component's step or decision reads, without its queues."""
    if c.role == "dm":
        assert c.module is not None
        topics: set[int] = set(system.modules[c.module].reads)
    else:
        topics = set() if c.node is None else {*c.reads}
    return tuple(sorted(topics - set(queues_read_by(system, c))))


def varied_states(
    system: System, layout: StateLayout, c: Component, states: Bytes, count: int, rng: random.Random
) -> Bytes:
    """`count` copies (count, size) of states (n, size), with random values for the reads of `c`.

    The topics get values of their sets, with stamps at the time of the state. In one copy of eight,
    all numbers are at an end of their sets, and lists are full.
    """
    variants: Bytes = states[[rng.randrange(len(states)) for _ in range(count)]].copy()
    group = next(g for g in layout.groups if g.owner < 0)
    at = {m.name: group.offset + m.offset for m in group.struct.members}

    def stamp_at(index: int) -> int:
        return layout.stamp_offset + 8 * index

    for k in range(count):
        ends = rng.random() < 0.125
        row = bytearray(variants[k].tobytes())
        for index in topics_read(system, c):
            topic = system.topics[index]
            value = _any_value(topic.type, iter(topic.bounds), rng, ends=ends)
            encode_into(row, at[topic.name], topic.type, value)
            row[stamp_at(index) : stamp_at(index) + 8] = row[:8]  # ct is the first of a state
        variants[k] = np.frombuffer(row, dtype=np.uint8)
    return variants


def _any_value(t: Type, bounds: Iterator[Bound | None], rng: random.Random, *, ends: bool) -> Value:
    if isinstance(t, RecordType):
        return tuple(_any_value(f, bounds, rng, ends=ends) for _, f in t.fields)
    if isinstance(t, ArrayType):
        return tuple(_any_value(t.element, bounds, rng, ends=ends) for _ in range(t.size))
    if isinstance(t, ListType):
        n = t.capacity if ends else rng.randint(0, t.capacity)
        of = [next(bounds, None) for _ in leaves(t.element)]
        return tuple(_any_value(t.element, iter(of), rng, ends=ends) for _ in range(n))
    return _random_scalar(t, next(bounds, None), rng, ends=ends)


def _random_scalar(t: Type, bound: Bound | None, rng: random.Random, *, ends: bool) -> float | int:
    if isinstance(t, BoolType):
        return rng.random() < 0.5
    if isinstance(t, EnumType):
        return rng.randrange(len(t.members))
    if isinstance(t, IntType):
        low = max(t.low, -FAR) if bound is None else int(bound.low)
        high = min(t.high, FAR) if bound is None else int(bound.high)
        return rng.choice((low, high)) if ends else rng.randint(low, high)
    assert isinstance(t, FloatType)
    below, above = (-WILD, WILD) if bound is None else (bound.low, bound.high)
    below, above = max(below, -1e300), min(above, 1e300)
    value = rng.choice((below, above)) if ends else rng.uniform(below, above)
    return value if math.isfinite(value) else 0.0


FOLDER = Path(__file__).resolve().parent / "c"
ENGINE = (FOLDER / "soter_stopwatch.c", FOLDER / "soter_stopwatch.h")
SWEPT_BYTES = 4 * 1024 * 1024
"""The bytes that are swept, more than the caches near a processor hold."""
PERCENTILES = (50.0, 90.0, 99.0, 99.9)
GRAIN_NS = 1_000
"""A suggested `wcet` is a whole number of these."""


@dataclass(frozen=True)
class StepTimes:
    """One component: percentiles and the longest of `samples` steps, in ns; how many faulted.

    `wcet_ns`: the longest time multiplied by the margin, in whole microseconds, as a suggestion.
    """

    name: str
    declared: str
    role: str
    samples: int
    percentiles: tuple[tuple[float, int], ...]
    longest_ns: int
    faulted: int
    wcet_ns: int

    @property
    def line(self) -> str:
        """The line of source that declares the suggested `wcet`, for the node or the `rta`."""
        return f"wcet {write_ns(self.wcet_ns)};"


def time_steps(
    made: TimedUnit,
    trace: Bytes,
    *,
    samples: int,
    margin: float,
    seed: int,
    progress: Callable[[float], None] | None = None,
) -> tuple[StepTimes, ...]:
    """Times each component of Soter code in the trusted thread, on states of `trace`, (n, size).

    About `samples` steps each: a quarter from states of the run, a quarter from varied states, and
    both again with caches swept.
    """
    rng = random.Random(f"measure {seed}")  # noqa: S311 - states, not secrets
    mine = timed_components(made.system)
    measured = []
    for k, c in enumerate(mine):
        quarter = max(1, samples // 4)
        seen = sampled_states(trace, quarter)
        made_up = varied_states(made.system, made.layout, c, seen, quarter, rng)
        took: list[npt.NDArray[np.int64]] = []
        faulted = 0
        for states in (seen, made_up):
            for swept in (False, True):
                times, wrong = made.measure_steps(c, states, swept=swept)
                took.append(times)
                faulted += wrong
        measured.append(step_times(made.system, c, np.concatenate(took), faulted, margin=margin))
        if progress is not None:
            progress((k + 1) / len(mine))
    return tuple(measured)


def timed_components(system: System) -> list[Component]:
    """The components of the trusted thread that are Soter code."""
    return [c for c in system.components if c.in_thread and not c.extern]


def step_times(
    system: System, c: Component, took: npt.NDArray[np.int64], faulted: int = 0, *, margin: float
) -> StepTimes:
    """The summary of a component's measured times (samples,) in ns; `faulted` of them faulted."""
    longest = int(took.max())
    if c.node is not None:
        declared = c.node.name
    else:
        assert c.module is not None
        declared = system.modules[c.module].symbol.name
    return StepTimes(
        name=c.name,
        declared=declared,
        role=c.role,
        samples=len(took),
        percentiles=tuple((q, int(np.percentile(took, q, method="higher"))) for q in PERCENTILES),
        longest_ns=longest,
        faulted=faulted,
        wcet_ns=-(-int(longest * margin) // GRAIN_NS) * GRAIN_NS,
    )


class TimedUnit:
    """The compiled C of a system, with the stopwatch in `c/`."""

    def __init__(self, system: System, core: CoreSystem | None) -> None:
        self.system = system
        self.unit = generate(system, core)
        self.layout = self.unit.layout
        self.dtype = state_dtype(self.layout)
        path = library(self.unit, engine=ENGINE)
        self.ffi: Any = interface(
            declarations(RUNTIME / "soter.h"), declarations(FOLDER / "soter_stopwatch.h")
        )
        self.lib = open_library(self.ffi, path, linked_symbols(system, core))
        prefix = self.unit.prefix
        self.program = address(self.ffi, path, f"{prefix}_program", "const soter_program *")
        self.state = np.zeros(self.layout.size, dtype=np.uint8)
        self.swept = np.zeros(SWEPT_BYTES, dtype=np.uint8)

    def measure_steps(
        self, c: Component, states: Bytes, *, swept: bool
    ) -> tuple[npt.NDArray[np.int64], int]:
        """The ns of a step from each row of `states` (n, size), and how many steps faulted."""
        took = np.zeros(len(states), dtype=np.int64)
        states = np.ascontiguousarray(states)
        job = self.ffi.new(
            "soter_timing *",
            {
                "program": self.program,
                "component": c.index,
                "from": self._pointer("const void *", states),
                "stride": self.layout.size,
                "count": len(states),
                "state": self._pointer("void *", self.state),
                "swept": self._pointer("unsigned char *", self.swept),
                "size": SWEPT_BYTES if swept else 0,
                "took": self._pointer("int64_t *", took),
            },
        )
        return took, int(self.lib.soter_stopwatch(job))

    def _pointer(self, type_: str, array: npt.NDArray[Any]) -> Any:  # noqa: ANN401 - cdata
        return self.ffi.cast(type_, array.ctypes.data)

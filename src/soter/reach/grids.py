"""Sets of states on rectilinear grids (docs/verification.md, section 3).

Purpose: the Python face of `runtime/soter_reach*.c` for one group of up to four axes. Sets are
numpy arrays of the grid's shape, one item a cell, in C order; bool, or uint8 witnesses. All times
are nanoseconds. Every set that is claimed is claimed of the real dynamics: rounding is outward.
Non-goals: extracting the problem, verdicts, certificates; synthesis and ranks (`reach/policies.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.reach.linear import scheme_error

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from soter.reach.native import ReachLibrary
    from soter.reach.problem import Group, Problem

    Bools = npt.NDArray[np.bool_]
    Bytes = npt.NDArray[np.uint8]
    Floats = npt.NDArray[np.float64]

TILE = {1: (64,), 2: (8, 8), 3: (4, 4, 4), 4: (2, 2, 4, 4)}
SLICE_S = 0.1
"""How long the engine works between two looks at the stop flag."""
LONGEST = 250
"""The largest N a witness (uint8) may have, with room for a mark."""
OUTSET = 2.0**-20
"""How much larger than the grid (relative to an axis) the domain of the enclosures is: a run that
leaves the grid is still inside it, so no claim inside rests on what happens outside."""
POOL_BYTES = 2**28
NS = 1e-9


class CancelledError(Exception):
    """The stop flag was set."""


class UnboundedError(Exception):
    """The enclosures give no finite bound (a possible step fault, or too stiff a flow)."""


@dataclass(frozen=True)
class GridInputs:
    """Everything a group's analysis is told; build it with `of_problem`, or by hand in tests.

    Ranges are (low, high) pairs in the order of the inputs of the enclosure unit.
    """

    states: tuple[tuple[float, float], ...]
    controls: tuple[tuple[float, float], ...]
    disturbances: tuple[tuple[float, float], ...] = ()
    errors: tuple[tuple[float, float], ...] = ()
    others: tuple[tuple[float, float], ...] = ()
    kind: str = "flow"
    """"flow" or "map"."""
    period_ns: int = 0
    """delta of SC (flow) or the plant's period (map)."""
    delay_ns: int = 0
    """d: how old the state is that a command answers."""
    jitter_ns: int = 0
    """j."""
    parameters: tuple[int, ...] = ()
    plant_period_ns: int = 0
    """Of the simulator's step; its error against the exact solution becomes disturbance. 0: none."""
    error_of: Mapping[int, float] = field(default_factory=dict)
    """State -> largest measurement error of it, where a driven topic leaf is that state."""

    @property
    def ranges(self) -> tuple[tuple[float, float], ...]:
        """All inputs in order."""
        return self.states + self.controls + self.disturbances + self.errors + self.others


def of_problem(problem: Problem, parameters: Sequence[int] = ()) -> GridInputs:
    """The inputs of a problem for one combination of parameter values."""
    times = problem.times
    pairs = [
        tuple((x.low, x.high) for x in part)
        for part in (
            problem.states,
            problem.controls,
            problem.disturbances,
            problem.errors,
            problem.others,
        )
    ]
    acts = times.response_sc + times.acts
    is_map = problem.kind == "map"
    return GridInputs(
        *pairs,
        kind=problem.kind,
        period_ns=problem.plant_period_ns if is_map else times.delta_sc,
        delay_ns=0 if is_map else times.age_sc + acts,
        jitter_ns=0 if is_map else times.late_sc + acts,
        parameters=tuple(parameters),
        plant_period_ns=problem.scheme_step_ns,
    )


@dataclass(frozen=True)
class Core:
    """K: `witness` holds N per cell, 0 = not in K. `rounds`, `steps`: what it took."""

    witness: Bytes
    rounds: int
    steps: int

    @property
    def cells(self) -> Bools:
        """Which cells are in K."""
        return self.witness != 0


def _guesses(edges: Floats) -> npt.NDArray[np.int32]:
    """For equal buckets over the axis, a cell near each; the engine corrects from there."""
    n = len(edges) - 1
    width = np.diff(edges)
    even = bool(np.allclose(width, width[0], rtol=1e-6))
    buckets = n if even else min(16 * n, max(n, int(np.ceil(edges[-1] - edges[0]) / width.min())))
    at = edges[0] + (edges[-1] - edges[0]) * (np.arange(buckets) + 0.5) / buckets
    return np.clip(np.searchsorted(edges, at, side="right") - 1, 0, n - 1).astype(np.int32)


class GridGroup:
    """The engine for one group: its grid, its dynamics, its sets."""

    def __init__(
        self,
        library: ReachLibrary,
        inputs: GridInputs,
        axes: Sequence[tuple[int, Sequence[float]]],
        *,
        threads: int = 2,
        linear: bool | None = None,
        progress: Callable[[str, float], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> None:
        """`axes`: (index among the states, breakpoints) of each axis, one to four.

        `linear`: whether a flow is enclosed by one linear model for the whole domain; None: if it
        is linear but for remainders below a thousandth of its rates. `progress(what, share)` is
        told now and then; CancelledError is raised soon after `stop()` turns true.
        UnboundedError where the dynamics have no finite enclosure over the domain.
        """
        self.library, self.inputs, self.threads = library, inputs, threads
        self.progress, self.stop = progress, stop
        self.axes = tuple(int(i) for i, _ in axes)
        self.edges = tuple(np.ascontiguousarray(e, dtype=np.float64) for _, e in axes)
        self.shape = tuple(len(e) - 1 for e in self.edges)
        assert 1 <= len(self.axes) <= 4, "a group has one to four axes"
        assert max(self.shape) < 2**16 - 1, "an axis has fewer than 65535 cells"
        assert all(np.all(np.diff(e) > 0) for e in self.edges), "breakpoints increase"
        assert library.inputs == max(1, len(inputs.ranges)), "the unit has other inputs"
        assert 2 * inputs.jitter_ns <= inputs.period_ns, "the jitter is below half a period"
        self._kept: list[Any] = []
        self._group = self._described()
        self._linearize(linear)

    @classmethod
    def of(
        cls,
        library: ReachLibrary,
        problem: Problem,
        group: Group,
        parameters: Sequence[int] = (),
        **options: Any,  # noqa: ANN401 - those of __init__
    ) -> GridGroup:
        """The engine for a group of a problem."""
        axes = [(a.state, a.edges) for a in group.axes]
        return cls(library, of_problem(problem, parameters), axes, **options)

    # ------------------------------------------------------------ the description in C

    def _array(self, values: Any, dtype: str, ctype: str) -> Any:  # noqa: ANN401 - cdata
        array = np.ascontiguousarray(values, dtype=dtype)
        self._kept.append(array)
        return self.library.ffi.cast(ctype, array.ctypes.data)

    def _described(self) -> Any:  # noqa: ANN401 - cdata
        ffi, x = self.library.ffi, self.inputs
        g = ffi.new("soter_reach_group *")
        low, high = (np.array([r[k] for r in x.ranges] or [0.0]) for k in (0, 1))
        n = len(x.states)
        for axis, edges in zip(self.axes, self.edges, strict=True):
            low[axis], high[axis] = min(low[axis], edges[0]), max(high[axis], edges[-1])
        margin = (high[:n] - low[:n]) * OUTSET
        low[:n] -= margin
        high[:n] += margin
        self.low, self.high = low, high
        g.low, g.high = (self._array(v, "f8", "double *") for v in (low, high))
        g.param = self._array(x.parameters or (0,), "i8", "int64_t *")
        g.law = self.library.symbol("law")
        g.rate = self.library.symbol("next" if x.kind == "map" else "derivative")
        g.states, g.controls, g.inputs = n, len(x.controls), self.library.inputs
        g.is_map = x.kind == "map"
        g.axes = len(self.axes)
        tile = TILE[len(self.axes)]
        for a, (state, edges) in enumerate(zip(self.axes, self.edges, strict=True)):
            guess = _guesses(edges)
            g.axis[a], g.cells[a], g.tile[a] = state, len(edges) - 1, tile[a]
            g.tiles[a] = -(-(len(edges) - 1) // tile[a])
            g.edges[a] = self._array(edges, "f8", "double *")
            g.guess[a] = self._array(guess, "i4", "int32_t *")
            g.guesses[a] = len(guess)
        g.words = -(-self.shape[-1] // 64)
        g.period = x.period_ns * NS
        g.delay, g.jitter = (
            float(np.nextafter(v * NS, np.inf)) if v else 0.0 for v in (x.delay_ns, x.jitter_ns)
        )
        g.past = 1 + (2 * x.jitter_ns + x.delay_ns) // max(1, x.period_ns)
        return g

    def _pointer(self, array: npt.NDArray[Any], ctype: str) -> Any:  # noqa: ANN401 - cdata
        return self.library.ffi.cast(ctype, array.ctypes.data)

    def _linearize(self, linear: bool | None) -> None:
        g, lib = self._group, self.library.lib
        ends = [self._pointer(v, "double *") for v in (self.low, self.high)]
        g.is_local = 0
        if not lib.soter_reach_linearize(g, *ends):
            g.is_local = 1
            if linear or not lib.soter_reach_linearize(g, *ends):
                raise UnboundedError("the dynamics have no finite enclosure over the grid")
        if self.inputs.kind == "flow" and not g.is_local:
            remainder = self._remainder()
            g.is_local = not (remainder < 1e-3 if linear is None else linear)
        if not g.is_local and self.inputs.kind == "flow" and self.inputs.plant_period_ns:
            extra = scheme_error(self.model(), *self._largest(), self.inputs.plant_period_ns * NS)
            for i, w in enumerate(extra):
                g.extra_w[i] = w
            if not lib.soter_reach_linearize(g, *ends):
                raise UnboundedError("the dynamics have no finite enclosure over the grid")
        if g.is_local and not lib.soter_reach_linearize(g, *ends):
            raise UnboundedError("the dynamics have no finite enclosure over the grid")
        if not lib.soter_reach_prepare(g):
            raise UnboundedError("the flow is too stiff for one period of SC")

    @property
    def is_linear(self) -> bool:
        """Whether one linear model serves the whole domain (flows)."""
        return not self._group.is_map and not self._group.is_local

    def model(self) -> dict[str, Floats]:
        """A (n, n), B (n, commands), c (n), w (n) of x' in A x + B u + c + [-w, w]; `commands`."""
        g, n = self._group, len(self.axes)
        m = g.model
        return {
            "A": np.array([[m.a[i][j] for j in range(n)] for i in range(n)]),
            "B": np.array([[m.b[i][a] for a in range(g.commands)] for i in range(n)]).reshape(
                n, -1
            ),
            "c": np.array([m.c[i] for i in range(n)]),
            "w": np.array([m.w[i] for i in range(n)]),
            "commands": np.array([g.command[a] for a in range(g.commands)], dtype=np.float64),
        }

    def _remainder(self) -> float:
        """How much W grows from a small box to the whole domain, relative to the rates."""
        g, lib, n = self._group, self.library.lib, len(self.inputs.states)
        whole, moving = self.model(), np.zeros(len(self.low), dtype=bool)
        moving[list(self.axes)] = True
        moving[n : n + len(self.inputs.controls)] = True
        mid, half = self.low / 2 + self.high / 2, self.high / 2 - self.low / 2
        low = np.where(moving, mid - half * OUTSET, self.low)
        high = np.where(moving, mid + half * OUTSET, self.high)
        if not lib.soter_reach_linearize(
            g, self._pointer(low, "double *"), self._pointer(high, "double *")
        ):
            return np.inf
        small = self.model()
        ends = [self._pointer(v, "double *") for v in (self.low, self.high)]
        lib.soter_reach_linearize(g, *ends)
        rates = np.abs(whole["A"]) @ half[list(self.axes)] + whole["w"]
        commands = [n + int(c) for c in whole["commands"]]
        rates += np.abs(whole["B"]) @ half[commands]
        grown = whole["w"] - small["w"]
        return float(np.max(np.where(rates > 0, grown / np.where(rates > 0, rates, 1), 0)))

    def _largest(self) -> tuple[Floats, Floats]:
        """Largest |x| per axis, |u| per command."""
        largest = np.maximum(np.abs(self.low), np.abs(self.high))
        commands = [len(self.inputs.states) + int(c) for c in self.model()["commands"]]
        return largest[list(self.axes)], largest[commands]

    # ------------------------------------------------------------ calls in slices

    def _tell(self, what: str, share: float) -> None:
        if self.stop is not None and self.stop():
            raise CancelledError
        if self.progress is not None:
            self.progress(what, share)

    def _bits(self, cells: Bools) -> npt.NDArray[np.uint64]:
        assert cells.shape == self.shape, f"a set has the grid's shape {self.shape}"
        rows = int(np.prod(self.shape[:-1], dtype=np.int64))
        bits = np.empty(rows * self._group.words, dtype=np.uint64)
        data = np.ascontiguousarray(cells).view(np.uint8)
        self.library.lib.soter_reach_pack(
            self._group, self._pointer(data, "uint8_t *"), self._pointer(bits, "uint64_t *")
        )
        return bits

    def _cells(self, bits: npt.NDArray[np.uint64]) -> Bools:
        out = np.empty(self.shape, dtype=np.uint8)
        self.library.lib.soter_reach_unpack(
            self._group, self._pointer(bits, "uint64_t *"), self._pointer(out, "uint8_t *")
        )
        return out.view(np.bool_)

    @property
    def _tiles(self) -> int:
        return int(np.prod([self._group.tiles[a] for a in range(len(self.axes))]))

    # ------------------------------------------------------------ predicates

    def truth(
        self,
        predicate: str,
        *,
        ranges: Mapping[int, tuple[float, float]] | None = None,
    ) -> Bytes:
        """Truth of `safe`, `core`, `ttf` or `safer` over each cell: bit 0 may be false, bit 1 may
        be true, bit 2 a step fault is possible. Estimated predicates see every error within E.

        `ranges`: input -> (low, high) for other inputs than their whole range.
        """
        low, high = self.low.copy(), self.high.copy()
        for i, (a, b) in (ranges or {}).items():
            low[i], high[i] = a, b
        test = self.library.symbol(predicate)
        assert test != self.library.ffi.NULL, f"the unit has no `{predicate}`"
        out = np.empty(self.shape, dtype=np.uint8)
        at = 0
        while at < self._tiles:
            at = self.library.lib.soter_reach_truth(
                self._group,
                self._pointer(low, "double *"),
                self._pointer(high, "double *"),
                test,
                self._pointer(out, "uint8_t *"),
                at,
                SLICE_S,
                self.threads,
            )
            self._tell(predicate, at / self._tiles)
        return out

    def definitely(
        self, predicate: str, *, ranges: Mapping[int, tuple[float, float]] | None = None
    ) -> Bools:
        """Cells on all of which the predicate is true and no step fault is possible."""
        return self.truth(predicate, ranges=ranges) == 2

    def may_hold(
        self, predicate: str, *, ranges: Mapping[int, tuple[float, float]] | None = None
    ) -> Bools:
        """Cells somewhere on which (plus any error of E) the predicate may be true."""
        return (self.truth(predicate, ranges=ranges) & 6) != 0

    def may_fail(
        self, predicate: str, *, ranges: Mapping[int, tuple[float, float]] | None = None
    ) -> Bools:
        """Cells somewhere on which (plus any error of E) the predicate may be false."""
        return (self.truth(predicate, ranges=ranges) & 5) != 0

    def constraint(
        self,
        *,
        hint: bool = False,
        ranges: Mapping[int, tuple[float, float]] | None = None,
    ) -> Bools:
        """C: cells on all of which `safe` (with `hint` also `core`) is true."""
        cells = self.definitely("safe", ranges=ranges)
        return cells & self.definitely("core", ranges=ranges) if hint else cells

    # ------------------------------------------------------------ K

    def core(self, allowed: Bools, *, longest: int = LONGEST, patience: int = 4) -> Core:
        """K: the greatest fixpoint of {c in `allowed`: for some N <= `longest` the tube over
        [0, N delta + j] lies in `allowed` and the image over [N delta - j, N delta + j] in K}.

        A chain is given up when its images have been more than a cell away from K `patience`
        times in a row: a smaller K at worst. The result does not depend on threads.
        """
        return self._core(allowed, longest, patience)

    def _core(self, allowed: Bools, longest: int, patience: int) -> Core:
        assert 1 <= longest <= LONGEST
        assert self._group.law != self.library.ffi.NULL or self._group.held_low, "there is no law"
        ffi, lib, n = self.library.ffi, self.library.lib, len(self.axes)
        size = int(np.prod(self.shape))
        bits = self._bits(allowed)
        pool = max(256, min(size, POOL_BYTES // ffi.sizeof("soter_reach_chain")))
        witness = np.empty(self.shape, dtype=np.uint8)
        w = ffi.new("soter_reach_work *")
        rounds = self._rounds(w.r)
        w.allowed = self._pointer(bits, "uint64_t *")
        w.witness = self._pointer(witness, "uint8_t *")
        memory = [np.empty(size * 2 * n, dtype=np.uint16), np.empty(size, dtype=np.int32)]
        memory.append(np.empty(pool * ffi.sizeof("soter_reach_chain"), dtype=np.uint8))
        w.image, w.slot = (self._pointer(m, f"{m.dtype}_t *") for m in memory[:2])
        w.pool = self._pointer(memory[2], "soter_reach_chain *")
        w.pool_size, w.longest, w.patience = pool, longest, patience
        lib.soter_reach_core_begin(self._group, w)
        while not lib.soter_reach_core_continue(self._group, w, SLICE_S, self.threads):
            self._tell("core", w.r.cursor / max(1, w.r.dirty_n))
        lib.soter_reach_core_end(self._group, w)
        del rounds, memory
        return Core(witness, int(w.r.rounds), int(w.r.steps))

    def _rounds(self, r: Any) -> dict[str, npt.NDArray[Any]]:  # noqa: ANN401 - cdata
        """Memory of a fixpoint; the caller keeps what is given back as long as `r` is in use."""
        n, tiles = len(self.axes), self._tiles
        sums = int(np.prod([self._group.tiles[a] + 1 for a in range(n)]))
        rows = int(np.prod(self.shape[:-1], dtype=np.int64))
        found: dict[str, npt.NDArray[Any]] = {
            "kept": np.empty(rows * self._group.words, dtype=np.uint64),
            "reaches": np.empty(tiles * 2 * n, dtype=np.uint16),
            "changed": np.empty(tiles, dtype=np.uint64),
            "begun": np.empty(tiles, dtype=np.uint8),
            "dirty": np.empty(tiles, dtype=np.int32),
            "sums": np.empty(sums, dtype=np.int32),
        }
        for name, array in found.items():
            setattr(r, name, self._pointer(array, f"{array.dtype}_t *"))
        return found

    # ------------------------------------------------------------ tubes under all of U

    def safe_for(self, t_ns: int, target: Bools, *, segments: int | None = None) -> Bools:
        """R(t) for the target: cells from which every run over [0, t], under any measurable
        command in U, stays in the target. A map's t is a whole number of periods.

        `segments`: into how many pieces a flow's tube is cut; more is tighter and slower.
        """
        assert t_ns >= 0
        ffi, lib, period = self.library.ffi, self.library.lib, self.inputs.period_ns
        out = np.empty(self.shape, dtype=np.uint8)
        bits = self._bits(target)
        tube, steps, group = ffi.NULL, 0, self._group
        if t_ns == 0:
            return target.copy()
        if self.is_linear:
            tube = ffi.new("soter_reach_tube *")
            if not lib.soter_reach_tube_prepare(group, t_ns * NS, segments or 2, tube):
                raise UnboundedError("the flow is too stiff for so long a tube")
        elif self.inputs.kind == "map":
            assert t_ns % period == 0, "a map is defined at multiples of its period"
            steps = t_ns // period
        else:
            steps = segments or max(1, -(-t_ns // period))
            group = ffi.new("soter_reach_group *", group[0])
            group.period = float(np.nextafter(t_ns * NS / steps, np.inf))
        at = 0
        while at < self._tiles:
            at = lib.soter_reach_safe(
                group,
                tube,
                steps,
                self._pointer(bits, "uint64_t *"),
                self._pointer(out, "uint8_t *"),
                at,
                SLICE_S,
                self.threads,
            )
            self._tell("tubes", at / self._tiles)
        return out.view(np.bool_)

    # ------------------------------------------------------------ estimates

    def _reach_of(self, errors: Mapping[int, float]) -> list[tuple[Any, Any]]:
        """Per axis: first and last cell that [cell - e, cell + e] touches; outside counts on."""
        found = []
        for state, edges in zip(self.axes, self.edges, strict=True):
            e, n = errors.get(state, 0.0), len(edges) - 1
            low, high = edges[:-1], edges[1:]
            if e:
                low, high = np.nextafter(low - e, -np.inf), np.nextafter(high + e, np.inf)
            first = np.searchsorted(edges, low, side="right") - 1
            last = np.searchsorted(edges, high, side="left") - 1
            last = np.where(high > edges[-1], n, last)
            found.append((first.astype(np.int32), last.astype(np.int32)))
        return found

    def _moved(self, cells: Bools, errors: Mapping[int, float], *, grow: bool) -> Bools:
        now = np.ascontiguousarray(cells).view(np.uint8)
        for a, (first, last) in enumerate(self._reach_of(errors)):
            if not errors.get(self.axes[a], 0.0):
                continue
            n, after = self.shape[a], int(np.prod(self.shape[a + 1 :], dtype=np.int64))
            out, scratch = np.empty_like(now), np.empty((n + 1) * after, dtype=np.int32)
            self.library.lib.soter_reach_shrink(
                now.size // (n * after),
                n,
                after,
                self._pointer(first, "int32_t *"),
                self._pointer(last, "int32_t *"),
                int(grow),
                self._pointer(now, "uint8_t *"),
                self._pointer(out, "uint8_t *"),
                self._pointer(scratch, "int32_t *"),
            )
            now = out
        return now.view(np.bool_)

    def erode(self, cells: Bools, errors: Mapping[int, float]) -> Bools:
        """Cells c with c + E inside the set: {x^ : x^ - E in the set} on whole cells, and as well
        {z : z + E in the set}. `errors`: state -> largest error; E is that box, symmetric."""
        return self._moved(cells, errors, grow=False)

    def dilate(self, cells: Bools, errors: Mapping[int, float]) -> Bools:
        """Cells that c + E touches for some c of the set."""
        return self._moved(cells, errors, grow=True)

    # ------------------------------------------------------------ for tests and refutation

    def enclosures(self, low: Sequence[float], high: Sequence[float], holds: int) -> list[Any]:
        """Images and tubes, shape (k, axes, 2) each, of up to `holds` holds from a box."""
        n = len(self.axes)
        ends = [np.array(v, dtype=np.float64) for v in (low, high)]
        images, tubes = (np.zeros((holds, n, 2)) for _ in range(2))
        done = self.library.lib.soter_reach_run(
            self._group,
            self._pointer(ends[0], "double *"),
            self._pointer(ends[1], "double *"),
            holds,
            self._pointer(images, "double *"),
            self._pointer(tubes, "double *"),
        )
        return [images[:done], tubes[:done]]

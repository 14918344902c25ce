"""A group of states as the C engine sees it: its grid, ranges, dynamics, the ends it keeps.

Purpose: `GridModel` fills in the group's description in C and its linear model, and allocates the
engine's memory, for `sets.py`, which calls the engine. `kept_ends_of` finds the ends that no run
passes (a level that is never below zero, a state between two stops), so that a grid may end exactly
there though images round outward, and rates that are zero but for rounding:
`soter_reach_invariant_ends.c` uses both.
Non-goals: computing sets (`sets.py`); ends that only SC keeps: commands may be anything in U here.

An end is kept when the flow points inwards, or along it, all over a strip beyond it, for all
commands, disturbances and other states within their ranges. The strip is a part of the domain of
the enclosures: what lies between the grid and what a run, followed back to where it was read, may
have come from. The argument stands in `soter_reach_invariant_ends.c`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.verify.enclose.compiled_enclosures import FORM, affine_inputs
from soter.verify.grid.scheme_error import SchemeSolution, SimulatedFlow, scheme_solution
from soter.verify.problem.problem import FARTHEST, NS

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    import numpy.typing as npt

    from soter.core.layout import Bools, Floats
    from soter.verify.enclose.compiled_enclosures import ReachLibrary
    from soter.verify.grid.grid_problem import GridInputs

    Ints = npt.NDArray[np.int32]

TILE = {1: (64,), 2: (8, 8), 3: (4, 4, 4), 4: (2, 2, 4, 4)}
OUTSET = 2.0**-20
"""By this share of an axis the domain of the enclosures is larger than the grid: a run that leaves
the grid is still in the domain, so no claim inside depends on what happens outside."""
DOMAIN = 2.0**20
"""The same share as `OUTSET`, for an axis without ends, whose state nothing reads."""
SEAM = 2.0**-40
"""By how much the outer cells of an axis that wraps around are longer than it is declared."""
TURN = 2.0 * np.pi
NO_COMMAND_IS_KNOWN = 2**31 - 1
"""The number of commands since a read that tells the engine: any command of U may have acted."""
LONGER = 1e-9
"""By this share the engine's span of reads is longer than a period of SC."""
NO_ENCLOSURE = "the dynamics have no finite enclosure over the grid"
AXIS_MAX = 2**16 - 1
"""An axis has fewer cells than this; the engine keeps their numbers in 16 bits."""
UNBOUNDED, WRAPS = 2, 3
"""The values of `SOTER_REACH_UNBOUNDED` (the last cell also holds all that lies beyond it) and of
`SOTER_REACH_WRAPS` (the first cell follows the last one)."""
BACK = 4.0
"""The strip is |x'| (d + 2 j) times this factor wide, as a-priori boxes are larger than runs."""
DUST = 1e-10
"""A rate below this share of the largest may be zero but for rounding; it is examined again."""
LOOK_AHEAD = 4.0
"""The stages of the simulator's scheme stay within this many of its steps from the state."""


class UnboundedError(Exception):
    """Raised if the dynamics or a tube have no finite enclosure; `hint` is advice."""

    def __init__(self, why: str, hint: str = "a smaller grid") -> None:
        super().__init__(why)
        self.hint = hint


def _search_starts(edges: Floats) -> Ints:
    """For each of many equal parts of an axis a cell near it, from which a search starts."""
    n = len(edges) - 1
    width = np.diff(edges)
    even = bool(np.allclose(width, width[0], rtol=1e-6))
    buckets = n if even else min(16 * n, max(n, int(np.ceil(edges[-1] - edges[0]) / width.min())))
    at = edges[0] + (edges[-1] - edges[0]) * (np.arange(buckets) + 0.5) / buckets
    return np.asarray(np.clip(np.searchsorted(edges, at, side="right") - 1, 0, n - 1), np.int32)


def _overlapped_cells_on_turn(edges: Floats, off: float) -> tuple[Ints, Ints]:
    """First and last overlapped cell of each cell on a wrapping axis; the last may pass n - 1."""
    n, low, high = len(edges) - 1, edges[:-1], edges[1:]
    turns = np.concatenate([low - TURN, low, low + TURN])
    low, high = np.nextafter(low - off, -np.inf), np.nextafter(high + off, np.inf)
    first = np.searchsorted(turns, low, side="right") - 1
    count = np.searchsorted(turns, high, side="left") - first
    begin = np.where(count >= n, 0, first % n)
    return begin.astype(np.int32), (begin + np.minimum(count, n) - 1).astype(np.int32)


class GridModel:
    """Describes a group of states for the C engine, with the grid and the dynamics."""

    def __init__(
        self,
        library: ReachLibrary,
        inputs: GridInputs,
        axes: Sequence[tuple[int, Sequence[float] | Floats]],
        *,
        threads: int = 2,
        linear: bool | None = None,
        open_ends: Collection[int] = (),
        unbounded: Collection[int] = (),
        wraps: Collection[int] = (),
    ) -> None:
        """Describes the group with these `axes`, one to four pairs (index of the state, edges).

        `linear`: whether one linear model encloses a flow over the whole domain; None: if it is
        linear but for remainders below a thousandth of its rates. States of flows by their axis:
        `open_ends`, no run is assumed to pass the last breakpoint; `unbounded`, the outer cells
        have no outer end, and no rate, law or other group reads the state; `wraps`, the axis is a
        full turn, and everything reads the state modulo a turn. `UnboundedError` where the dynamics
        have no finite enclosure over the domain.
        """
        self.library, self.inputs, self.threads = library, inputs, threads
        self.open_ends, self.unbounded = frozenset(open_ends), frozenset(unbounded)
        self.wraps = frozenset(wraps)
        self.axes = tuple(int(i) for i, _ in axes)
        self.edges = tuple(
            self._lengthened_edges(i, np.array(e, dtype=np.float64)) for i, e in axes
        )
        self.shape = tuple(len(e) - 1 for e in self.edges)
        assert 1 <= len(self.axes) <= 4, "a group has one to four axes"
        longest = [n * (1 + (i in self.wraps)) for i, n in zip(self.axes, self.shape, strict=True)]
        assert max(longest) < AXIS_MAX, "an axis has fewer than 65535 cells"
        assert all(np.all(np.diff(e) > 0) for e in self.edges), "breakpoints increase"
        assert library.inputs == max(1, len(inputs.ranges)), "the unit has other inputs"
        if not inputs.read_age_ns:
            assert 2 * inputs.jitter_ns <= inputs.period_ns, "the jitter is below half a period"
        assert inputs.period_ns % (inputs.map_step_ns or 1) == 0, "SC steps with the map"
        self._kept: list[Any] = []
        self.c = self._description_in_c()
        self.covers_scheme = False
        """Whether each step of the simulator's scheme is a solution of the model."""
        self.stiff = ""
        """Why no step is, in words, if only the step of the scheme is too long; otherwise ""."""
        self.crossed: list[str] = []
        """Ends that the flow keeps but the simulator's scheme is not shown to keep, in words."""
        self._linearize(linear)
        self._narrow_law()

    def _lengthened_edges(self, state: int, edges: Floats) -> Floats:
        """The breakpoints; on a wrapping axis the outer cells are lengthened until they meet."""
        if state in self.wraps and edges[-1] - edges[0] < TURN + SEAM:
            edges[[0, -1]] += -SEAM, SEAM
        return edges

    def _kept_array(self, values: Any, dtype: str, ctype: str) -> Any:  # noqa: ANN401 - cdata
        array = np.ascontiguousarray(values, dtype=dtype)
        self._kept.append(array)
        return self.library.ffi.cast(ctype, array.ctypes.data)

    def _description_in_c(self) -> Any:  # noqa: ANN401 - cdata
        ffi, x = self.library.ffi, self.inputs
        g = ffi.new("soter_reach_group *")
        low, high = (np.array([r[k] for r in x.ranges] or [0.0]) for k in (0, 1))
        n = len(x.states)
        for axis, edges in zip(self.axes, self.edges, strict=True):
            low[axis], high[axis] = min(low[axis], edges[0]), max(high[axis], edges[-1])
        endless = [i in self.unbounded for i in range(n)]
        margin = (high[:n] - low[:n]) * np.where(endless, DOMAIN, OUTSET)
        margin[list(self.wraps)] = TURN / 2
        low[:n] -= margin
        high[:n] += margin
        self.low, self.high = low, high
        g.low, g.high = (self._kept_array(v, "f8", "double *") for v in (low, high))
        g.param = self._kept_array(x.parameters or (0,), "i8", "int64_t *")
        g.law = self.library.symbol("law")
        g.rate = self.library.symbol("next" if x.kind == "map" else "derivative")
        g.states, g.controls, g.inputs = n, len(x.controls), self.library.inputs
        g.is_map = x.kind == "map"
        g.hold_steps = max(1, x.period_ns // (x.map_step_ns or max(1, x.period_ns)))
        g.axes = len(self.axes)
        tile = TILE[len(self.axes)]
        for a, (state, edges) in enumerate(zip(self.axes, self.edges, strict=True)):
            guess = _search_starts(edges)
            g.axis[a], g.cells[a], g.tile[a] = state, len(edges) - 1, tile[a]
            g.tiles[a] = -(-(len(edges) - 1) // tile[a])
            g.edges[a] = self._kept_array(edges, "f8", "double *")
            g.guess[a] = self._kept_array(guess, "i4", "int32_t *")
            g.guesses[a], g.per_unit[a] = len(guess), len(guess) / (edges[-1] - edges[0])
        g.words = -(-self.shape[-1] // 64)
        g.period = x.period_ns * NS
        g.delay, g.jitter = (
            float(np.nextafter(v * NS, np.inf)) if v else 0.0 for v in (x.delay_ns, x.jitter_ns)
        )
        g.past = 1 + (2 * x.jitter_ns + x.delay_ns) // max(1, x.period_ns)
        if x.read_age_ns:
            g.delay, g.jitter = float(np.nextafter(x.read_age_ns * NS, np.inf)), 0.0
            g.swept = g.period * (1 + LONGER)
            g.past = NO_COMMAND_IS_KNOWN
        return g

    @property
    def spans(self) -> list[Floats]:
        """The breakpoints (cells + 1,) of each axis; an unbounded axis has the ends ±`FARTHEST`."""
        spans = [e.copy() for e in self.edges]
        for state, edges in zip(self.axes, spans, strict=True):
            if state in self.unbounded:
                edges[0], edges[-1] = -FARTHEST, FARTHEST
        return spans

    @property
    def turns(self) -> list[bool]:
        """For each axis whether it is a full turn, with ends that meet."""
        return [state in self.wraps for state in self.axes]

    def pointer(self, array: npt.NDArray[Any], ctype: str) -> Any:  # noqa: ANN401 - cdata
        """The address of an array's data, of any shape; the caller must keep the array alive."""
        return self.library.ffi.cast(ctype, array.ctypes.data)

    def _enclose_dynamics(self, ends: Sequence[Any]) -> None:
        if not self.library.lib.soter_reach_linearize(self.c, *ends):
            raise UnboundedError(NO_ENCLOSURE)

    def _linearize(self, linear: bool | None) -> None:
        g, lib = self.c, self.library.lib
        ends = [self.pointer(v, "double *") for v in (self.low, self.high)]
        g.is_local = 0
        if not lib.soter_reach_linearize(g, *ends):
            g.is_local = 1
            if linear:
                raise UnboundedError(NO_ENCLOSURE)
            self._enclose_dynamics(ends)
        if self.inputs.kind == "flow" and not g.is_local:
            remainder = self._growth_of_remainder()
            g.is_local = not (remainder < 1e-3 if linear is None else linear)
        by_scheme = self._scheme_solution()
        extra, self.stiff = by_scheme.error, by_scheme.stiff
        self.covers_scheme = extra is not None
        if extra is not None:
            for i, w in enumerate(extra):
                g.extra_w[i] = w
            self._enclose_dynamics(ends)
        if g.is_local:
            self._enclose_dynamics(ends)
        if self.inputs.kind == "flow":
            self._extend_to_kept_ends()
        if self.inputs.kind == "flow" and not g.commands:
            g.delay = g.jitter = g.swept = (
                0.0  # no command moves this group: when one acts is all the same
            )
            g.past = 1
        if not lib.soter_reach_prepare(g):
            raise UnboundedError("the flow is too stiff for one period of SC", "a shorter period")

    def _extend_to_kept_ends(self) -> None:
        found, g = kept_ends_of(self), self.c
        if found is None:
            return
        self.low[:], self.high[:] = found.low, found.high
        self.crossed += found.crossed
        g.scheme = found.scheme
        for i, dust in enumerate(found.dust):
            g.dust[i] = dust
        for (i, upper), how in found.kept.items():
            (g.kept_high if upper else g.kept_low)[i] = how

    @property
    def is_linear(self) -> bool:
        """Whether the group is a flow and one linear model encloses it over the whole domain."""
        return not self.c.is_map and not self.c.is_local

    def linear_model(self) -> dict[str, Floats]:
        """The parts A (n, n), B (n, commands), c (n,), w (n,) of x' in A x + B u + c + [-w, w].

        The part `commands` has the numbers of the commands u.
        """
        g, n = self.c, len(self.axes)
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

    def _narrow_law(self) -> None:
        """Lets the engine compute only one output of SC if no other control moves the group.

        The engine then does not see a fault elsewhere in SC, so all of SC must be free of faults
        over the whole domain, in which all states lie that SC reads.
        """
        g = self.c
        if g.commands != 1 or g.controls == 1 or g.law == self.library.ffi.NULL:
            return
        alone = self.library.symbol(f"law_{g.command[0]}")
        if alone == self.library.ffi.NULL:
            return
        forms, out = self._forms_of_inputs(self.low, self.high)
        ends = [self.library.ffi.cast("void *", x.ctypes.data) for x in (forms, out)]
        if not self.library.lib.soter_law(ends[0], g.param, ends[1]):
            g.law = alone

    def _forms_of_inputs(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """The affine forms of the inputs over their ranges, and an empty array for results."""
        count = self.library.inputs
        results = max(count, len(self.inputs.states), len(self.inputs.controls))
        forms = affine_inputs(np.stack([low, high], axis=1), count)
        return forms, np.zeros((results, FORM + count))

    def rates_within(self, low: Floats, high: Floats) -> Floats | None:
        """Bounds (states, 2) of all rates over ranges of all inputs; None: no bound, or a fault."""
        found = self._rate_forms(low, high)
        if found is None or not np.isfinite(found[0][:, :2]).all():
            return None
        return np.asarray(found[0][:, :2])

    def rate_reads_states(self, state: int, low: Floats, high: Floats) -> bool:
        """Whether the rate of a state may depend on any state over these ranges (one per input)."""
        found = self._rate_forms(low, high)
        return found is None or bool(found[0][state, FORM : FORM + len(self.inputs.states)].any())

    def _growth_of_remainder(self) -> float:
        """The growth of the remainder w from a small box to the domain, relative to the rates."""
        g, lib, n = self.c, self.library.lib, len(self.inputs.states)
        model_over_domain, moving = self.linear_model(), np.zeros(len(self.low), dtype=bool)
        moving[list(self.axes)] = True
        moving[n : n + len(self.inputs.controls)] = True
        mid, half = self.low / 2 + self.high / 2, self.high / 2 - self.low / 2
        low = np.where(moving, mid - half * OUTSET, self.low)
        high = np.where(moving, mid + half * OUTSET, self.high)
        if not lib.soter_reach_linearize(
            g, self.pointer(low, "double *"), self.pointer(high, "double *")
        ):
            return np.inf
        small = self.linear_model()
        ends = [self.pointer(v, "double *") for v in (self.low, self.high)]
        lib.soter_reach_linearize(g, *ends)
        rates = np.abs(model_over_domain["A"]) @ half[list(self.axes)] + model_over_domain["w"]
        commands = [n + int(c) for c in model_over_domain["commands"]]
        rates += np.abs(model_over_domain["B"]) @ half[commands]
        grown = model_over_domain["w"] - small["w"]
        return float(np.max(np.where(rates > 0, grown / np.where(rates > 0, rates, 1), 0)))

    def _scheme_solution(self) -> SchemeSolution:
        """Whether the simulator's steps solve the model, and what must be added to it for that."""
        x = self.inputs
        if x.kind != "flow" or not self.is_linear or not x.steps:
            return SchemeSolution()
        names = x.names or tuple(f"state {k}" for k in range(len(x.states)))
        stepped = SimulatedFlow(self._rate_forms, names, x.steps, len(x.controls))
        return scheme_solution(stepped, self.low, self.high, self.axes)

    def _rate_forms(self, low: Floats, high: Floats) -> tuple[Floats, Floats] | None:
        """Forms of all rates, (states, 4 + inputs), and the radius of each input; None: a fault."""
        ffi, n = self.library.ffi, len(self.inputs.states)
        forms, out = self._forms_of_inputs(low, high)
        radius = forms[range(len(low)), range(FORM, FORM + len(low))]
        ends = [ffi.cast("void *", x.ctypes.data) for x in (forms, out)]
        if self.library.lib.soter_derivative(ends[0], self.c.param, ends[1]):
            return None
        return out[:n], radius

    def bits_of(self, cells: Bools) -> npt.NDArray[np.uint64]:
        """The engine's bits, shape (rows * words,), of a set of the grid's shape."""
        assert cells.shape == self.shape, f"a set has the grid's shape {self.shape}"
        rows = int(np.prod(self.shape[:-1], dtype=np.int64))
        bits = np.empty(rows * self.c.words, dtype=np.uint64)
        data = np.ascontiguousarray(cells).view(np.uint8)
        self.library.lib.soter_reach_pack(
            self.c, self.pointer(data, "uint8_t *"), self.pointer(bits, "uint64_t *")
        )
        return bits

    def cells_of(self, bits: npt.NDArray[np.uint64]) -> Bools:
        """The set, of the grid's shape, for the engine's bits, which have shape (rows * words,)."""
        out = np.empty(self.shape, dtype=np.uint8)
        self.library.lib.soter_reach_unpack(
            self.c, self.pointer(bits, "uint64_t *"), self.pointer(out, "uint8_t *")
        )
        return out.view(np.bool_)

    @property
    def tiles(self) -> int:
        """The number of the grid's tiles, which are small blocks of cells."""
        return int(np.prod([self.c.tiles[a] for a in range(len(self.axes))]))

    def overlapped_cells(self, errors: Mapping[int, float]) -> list[tuple[Any, Any]]:
        """The first and last cell within the error of each cell, per axis; -1 or n is outside."""
        cell_ranges = []
        for state, edges in zip(self.axes, self.edges, strict=True):
            e, n = errors.get(state, 0.0), len(edges) - 1
            if state in self.wraps:
                cell_ranges.append(_overlapped_cells_on_turn(edges, e + SEAM))
                continue
            low, high = edges[:-1], edges[1:]
            if e:
                low, high = np.nextafter(low - e, -np.inf), np.nextafter(high + e, np.inf)
            first = np.searchsorted(edges, low, side="right") - 1
            last = np.searchsorted(edges, high, side="left") - 1
            last = np.where(high > edges[-1], n, last)
            if state in self.unbounded:
                first, last = np.clip(first, 0, n - 1), np.clip(last, 0, n - 1)
            cell_ranges.append((first.astype(np.int32), last.astype(np.int32)))
        return cell_ranges

    def allocate_rounds(self, r: Any) -> dict[str, npt.NDArray[Any]]:  # noqa: ANN401 - cdata
        """Allocates the buffers (length,) of a fixpoint, by name; they must outlive `r`."""
        n, tiles = len(self.axes), self.tiles
        sums = int(np.prod([self.c.tiles[a] + 1 for a in range(n)]))
        rows = int(np.prod(self.shape[:-1], dtype=np.int64))
        buffers: dict[str, npt.NDArray[Any]] = {
            "kept": np.empty(rows * self.c.words, dtype=np.uint64),
            "reaches": np.empty(tiles * 2 * n, dtype=np.uint16),
            "changed": np.empty(tiles, dtype=np.uint64),
            "begun": np.empty(tiles, dtype=np.uint8),
            "dirty": np.empty(tiles, dtype=np.int32),
            "sums": np.empty(sums, dtype=np.int32),
        }
        for name, array in buffers.items():
            setattr(r, name, self.pointer(array, f"{array.dtype}_t *"))
        return buffers


@dataclass(eq=False)
class KeptEnds:
    """The ends of axes that no run passes, and the domain, which reaches beyond these ends."""

    low: Floats
    high: Floats
    scheme: float
    dust: list[float] = field(default_factory=list)
    """For each axis the size below which a rate may be zero but for rounding."""
    kept: dict[tuple[int, bool], int] = field(default_factory=dict)
    """How each end, (axis, whether it is the upper one), is kept: a number of the engine."""
    crossed: list[str] = field(default_factory=list)
    """Ends that the flow keeps but the simulator's scheme is not shown to keep, in words."""


def kept_ends_of(model: GridModel) -> KeptEnds | None:
    """The ends of the axes that no run passes; None where a rate has no bounds.

    The simulator's scheme must keep the end, too, as the scheme of a linear flow is part of the
    proof. A rate that depends on no state is the same in all stages of a step, so the scheme moves
    as the rate says, rounding included.
    """
    g = model.c
    domain_rates = model.rates_within(model.low, model.high)
    if domain_rates is None:
        return None
    steps = [step for step, _, _ in model.inputs.steps]
    step = max(steps, default=0.0) if model.covers_scheme else 0.0
    found = KeptEnds(model.low.copy(), model.high.copy(), LOOK_AHEAD * step)
    back = BACK * (g.delay + max(2 * g.jitter, g.swept)) if g.is_local else 0.0
    for i, state in enumerate(model.axes):
        largest = float(np.abs(domain_rates[state]).max())
        found.dust.append(DUST * largest + 8.0 * g.extra_w[i])
        endless = UNBOUNDED if state in model.unbounded else WRAPS if state in model.wraps else 0
        for upper in (False, True):
            if endless:
                found.kept[i, upper] = endless
            else:
                _enter_end_if_kept(model, found, i, back * largest, upper=upper)
    return found


def _enter_end_if_kept(
    model: GridModel, found: KeptEnds, i: int, back: float, *, upper: bool
) -> None:
    """Enters one end of axis `i` in `found` if the flow keeps runs inside this end."""
    state, edges = model.axes[i], model.edges[i]
    low, high = found.low.copy(), found.high.copy()
    if upper:
        low[state], high[state] = edges[-1], high[state] + back
    else:
        low[state], high[state] = low[state] - back, edges[0]
    rates = model.rates_within(low, high)
    if rates is None:
        return
    if not (upper and state in model.open_ends):
        inwards = -rates[state][1] if upper else rates[state][0]
        if not inwards >= 0.0:
            return
        if not inwards >= model.c.extra_w[i] and model.rate_reads_states(
            state, found.low, found.high
        ):
            count = len(model.inputs.states)
            names = model.inputs.names or tuple(f"state {k}" for k in range(count))
            side, end = ("below", edges[-1]) if upper else ("above", edges[0])
            found.crossed.append(f"{names[state]} {side} {float(end):g}")
            return
    found.kept[i, upper] = 1
    if upper:
        found.high[state] = high[state]
    else:
        found.low[state] = low[state]

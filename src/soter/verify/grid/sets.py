"""Sets of states on rectilinear grids (docs/verification.md, section 3).

Purpose: `GridGroup` calls `verify/engine/soter_reach*.c` for one group of up to four axes. Sets are
numpy arrays of the grid's shape, one item a cell, in C order: bool, or uint8 witnesses. Times are
in nanoseconds. Claims are about the real dynamics: rounding is outward.
Symbols, here and in this folder: C, the states where `safe` holds. K, the core: states of C from
which SC keeps C for ever. R(t): states from which no command of U leads out of K within t. S_j: the
estimates at which the DM may leave AC control. Q: states of K that SC keeps inside `safer`. W: the
states from which SC leads to Q (docs/proof.md#setting, docs/proof-sets.md).
Non-goals: the problem, verdicts, certificates; synthesis (`find_sc.py`), Q and W (`recovery.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.current_phase import share_done
from soter.verify.grid.grid_problem import grid_inputs_of
from soter.verify.grid.group_model import GridModel, UnboundedError
from soter.verify.problem.problem import NS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from soter.core.layout import Bools, Bytes, Floats
    from soter.verify.enclose.compiled_enclosures import ReachLibrary
    from soter.verify.grid.group_model import Ints
    from soter.verify.problem.problem import Group, Problem

SLICE_S = 0.1
"""How long the engine works between two looks at the stop flag."""
LONGEST = 250
"""The longest chain, in periods of SC: a witness (uint8) holds it, besides `RESTS`."""
RESTS = 255
"""The witness of a cell that is kept without a chain: SC stands still there (`resting.py`)."""
VAIN_LEAST = 100
"""For no more cells than this followed in vain K is never given up, as these are quick."""
HOLDS_LEAST = 100_000
"""For no more periods of SC than this K is never given up: they take 3 s of CPU time at most."""
POOL_BYTES = 2**28
SEGMENTS = 2
SEGMENTS_MAX = 64
"""The most segments of a tube, as `SOTER_REACH_SEGMENTS`."""
WORTH_IT = 0.005
"""The segments of a tube are doubled again while that adds this share of the target's cells."""
STEPS_MAX = 8
WORTH_A_STEP = 0.02
"""The same share as `WORTH_IT`, for a nonlinear flow, whose segments cost a step for each box."""


@dataclass(frozen=True)
class Core:
    """K: `witness` has for each cell the length N of its chain in periods of SC; 0: not in K.

    `rounds`, `steps`: the work done. `vain`: cells that were followed to the end and never came
    back to K. `spent`: K was given up because a limit of the work was reached.
    """

    witness: Bytes
    rounds: int
    steps: int
    vain: int = 0
    spent: bool = False

    @property
    def cells(self) -> Bools:
        """The cells of K, as a set of the grid's shape."""
        return np.asarray(self.witness != 0)


class GridGroup(GridModel):
    """The engine that computes sets on the grid of one group of states.

    `GridModel` describes the group in C (`c`) and connects memory to the engine: `pointer` to an
    array, `bits_of` a set, buffers by `allocate_rounds`. The engine works on the cells of `tiles`.
    """

    _scratch: tuple[npt.NDArray[np.uint16], Ints, Bytes] | None = None

    @classmethod
    def for_group(
        cls,
        library: ReachLibrary,
        problem: Problem,
        group: Group,
        parameters: Sequence[int] = (),
        **options: Any,  # noqa: ANN401 - those of __init__
    ) -> GridGroup:
        """A new engine for one group of a problem; `options` are those of `GridModel`."""
        axes = [(a.state, a.edges) for a in group.axes]
        ends = {a.state for a in group.axes if a.open}
        endless = {a.state for a in group.axes if a.unbounded}
        around = {a.state for a in group.axes if a.wraps}
        inputs = grid_inputs_of(problem, parameters)
        options |= {"open_ends": ends, "unbounded": endless, "wraps": around}
        return cls(library, inputs, axes, **options)

    def truth_bits(
        self, predicate: str, *, ranges: Mapping[int, tuple[float, float]] | None = None
    ) -> Bytes:
        """The truth of a predicate over each cell, in the grid's shape.

        Bit 0 means that it may be false, bit 1 that it may be true, bit 2 that a step fault is
        possible. Predicates on estimates see every error within E. `ranges` has (low, high) by
        input, in place of the input's whole range.
        """
        low, high = self.low.copy(), self.high.copy()
        for i, (a, b) in (ranges or {}).items():
            low[i], high[i] = a, b
        test = self.library.symbol(predicate)
        assert test != self.library.ffi.NULL, f"the unit has no `{predicate}`"
        out = np.empty(self.shape, dtype=np.uint8)
        at = 0
        while at < self.tiles:
            at = self.library.lib.soter_reach_truth(
                self.c,
                self.pointer(low, "double *"),
                self.pointer(high, "double *"),
                test,
                self.pointer(out, "uint8_t *"),
                at,
                SLICE_S,
                self.threads,
            )
            share_done(at / self.tiles, predicate)
        return out

    def cells_true(
        self, predicate: str, *, ranges: Mapping[int, tuple[float, float]] | None = None
    ) -> Bools:
        """The cells, in the grid's shape, on which the predicate is true all over without fault."""
        return np.asarray(self.truth_bits(predicate, ranges=ranges) == 2)

    def cells_maybe_true(self, predicate: str) -> Bools:
        """The cells, in the grid's shape, where the predicate may be true with some error in E."""
        return np.asarray((self.truth_bits(predicate) & 6) != 0)

    def cells_maybe_false(self, predicate: str) -> Bools:
        """The cells, in the grid's shape, where the predicate may be false with some error in E."""
        return np.asarray((self.truth_bits(predicate) & 5) != 0)

    def compute_constraint(
        self, *, hint: bool = False, ranges: Mapping[int, tuple[float, float]] | None = None
    ) -> Bools:
        """The cells of C, in the grid's shape, on which `safe` holds, and with `hint` `core`.

        If the unit has a `constraint`, plants also publish only values in their topics' sets there.
        """
        named = self.library.symbol("constraint") != self.library.ffi.NULL
        cells = self.cells_true("constraint" if named else "safe", ranges=ranges)
        return cells & self.cells_true("core", ranges=ranges) if hint else cells

    def compute_core(
        self,
        allowed: Bools,
        *,
        longest: int = LONGEST,
        patience: int = 4,
        vain: float = 0.0,
        resting: Bools | None = None,
        members: Bools | None = None,
        holds: int = 0,
    ) -> Core:
        """The set K: cells from which the law stays in `allowed` and comes back to K.

        It is the greatest fixpoint of {c in `allowed`: for some N <= `longest` the tube over [0, N
        delta + j] lies in `allowed` and the image over [N delta - j, N delta + j] in K}. A chain is
        given up when its images have been more than a cell away from K `patience` times in a row: a
        smaller K at worst. The result does not depend on threads. All sets have the grid's shape.
        At most one of these two is passed: `resting`, cells of `allowed` that are in K in any case,
        with `RESTS` for N; `members`, the cells that K may have. K is given up, and empty, when a
        limit is passed: `vain`, the share of `allowed` that may be followed in vain; `holds`, how
        many periods of SC may be computed for a cell of `allowed` on average (`HOLDS_LEAST` in all
        are free). 0: no limit.
        """
        assert resting is None or members is None
        members = allowed if members is None else members & allowed
        if self.never_moves:
            return Core(np.asarray(members).astype(np.uint8), 0, 0)
        if members.all() and self.never_leaves_grid:
            return Core(np.ones(self.shape, dtype=np.uint8), 0, 0)
        most = max(VAIN_LEAST, int(vain * np.count_nonzero(allowed))) if vain else 0
        kept = np.zeros(self.shape, dtype=np.bool_) if resting is None else resting
        assert 1 <= longest <= LONGEST
        assert self.c.law != self.library.ffi.NULL or self.c.held_low, "there is no law"
        return self._run_core_engine(
            allowed, members, kept, longest=longest, patience=patience, vain_max=most, holds=holds
        )

    @property
    def never_moves(self) -> bool:
        """Whether no state of the group ever changes; no run then leaves any set of cells."""
        return set(self.axes) <= self.inputs.still

    @property
    def never_leaves_grid(self) -> bool:
        """Whether no run leaves the grid, whatever the commands, by the flow at its two ends.

        It looks at one axis of a linear flow that no command moves: x' <= 0 wherever x is at the
        upper end and x' >= 0 at the lower one, for everything else in its range. The solutions of a
        scalar equation keep their order, so none passes an end.
        """
        if len(self.axes) != 1 or not self.is_linear or self.c.commands:
            return False
        model = self.linear_model()
        a, c, w = (float(model[k].flat[0]) for k in ("A", "c", "w"))
        low, high = float(self.edges[0][0]), float(self.edges[0][-1])
        slack = 2.0**-48 * (abs(a) * max(abs(low), abs(high)) + abs(c) + w) + 1e-300
        return a * high + c + w + slack <= 0 and a * low + c - w - slack >= 0

    def _run_core_engine(
        self,
        allowed: Bools,
        members: Bools,
        resting: Bools,
        *,
        longest: int,
        patience: int,
        vain_max: int,
        holds: int,
    ) -> Core:
        """Computes K for `compute_core`; it follows at most `vain_max` cells in vain if not 0."""
        ffi, lib, n = self.library.ffi, self.library.lib, len(self.axes)
        size = int(np.prod(self.shape))
        allowed_bits, member_bits, resting_bits = map(self.bits_of, (allowed, members, resting))
        pool = max(256, min(size, POOL_BYTES // ffi.sizeof("soter_reach_chain")))
        witness = np.empty(self.shape, dtype=np.uint8)
        w = ffi.new("soter_reach_work *")
        memory_of_rounds = self.allocate_rounds(w.r)  # the engine has pointers into it
        w.allowed = self.pointer(allowed_bits, "uint64_t *")
        w.members = self.pointer(member_bits, "uint64_t *")
        w.resting = self.pointer(resting_bits, "uint64_t *")
        w.witness = self.pointer(witness, "uint8_t *")
        if self._scratch is None:  # kept for the next time: fresh pages cost more than the work
            self._scratch = (
                np.empty(size * 2 * n, dtype=np.uint16),
                np.empty(size, dtype=np.int32),
                np.empty(pool * ffi.sizeof("soter_reach_chain"), dtype=np.uint8),
            )
        image, slot, chains = self._scratch
        w.image, w.slot = self.pointer(image, "uint16_t *"), self.pointer(slot, "int32_t *")
        w.pool = self.pointer(chains, "soter_reach_chain *")
        known = np.empty(self.tiles, dtype=np.uint8)
        commands = np.empty(self.tiles * max(1, int(self.c.commands)), dtype=np.float64)
        w.known, w.command = self.pointer(known, "uint8_t *"), self.pointer(commands, "double *")
        w.pool_size, w.longest, w.patience = pool, longest, patience
        w.r.vain_max = vain_max
        w.r.steps_max = max(HOLDS_LEAST, holds * np.count_nonzero(allowed)) if holds else 0
        lib.soter_reach_core_begin(self.c, w)
        while not lib.soter_reach_core_continue(self.c, w, SLICE_S, self.threads):
            share_done(0.0, "core")  # nobody knows how many rounds are left
        lib.soter_reach_core_end(self.c, w)
        spent = w.r.dirty_n > 0
        if spent:
            witness[...] = 0
        witness[resting] = RESTS
        del memory_of_rounds
        return Core(witness, int(w.r.rounds), sum(w.r.steps), sum(w.r.vain), spent)

    def cells_safe_for(self, t_ns: int, target: Bools) -> Bools:
        """The set R(t) of a target, the cells from which no command of U leads out within t.

        Every run over [0, t] under any measurable command stays in the target. For a map, t is a
        whole number of periods. The number of pieces of a flow's tube is doubled as long as this
        adds cells, and a cell that was shown stays shown. Sets have the grid's shape.
        """
        assert t_ns >= 0
        period = self.inputs.map_step_ns or self.inputs.period_ns
        if t_ns == 0 or self.never_moves or (target.all() and self.never_leaves_grid):
            return np.array(target, dtype=np.bool_)
        if self.inputs.kind == "map":
            assert t_ns % period == 0, "a map is defined at multiples of its period"
            return self._cells_safe_in_pieces(t_ns, target, np.zeros_like(target), t_ns // period)
        pieces, most, worth = max(1, -(-t_ns // period)), STEPS_MAX, WORTH_A_STEP
        if self.is_linear:
            pieces, most, worth = SEGMENTS, SEGMENTS_MAX, WORTH_IT
        cells = self._cells_safe_in_pieces(t_ns, target, np.zeros_like(target), pieces)
        while 2 * pieces <= most and not cells.all():
            pieces *= 2
            more = self._cells_safe_in_pieces(t_ns, target, cells, pieces)
            gained = int(more.sum()) - int(cells.sum())
            cells = more
            if gained < worth * int(target.sum()):
                break
        return cells

    def _cells_safe_in_pieces(self, t_ns: int, target: Bools, known: Bools, pieces: int) -> Bools:
        """The set R(t) by tubes of `pieces` pieces, for a map periods; it contains `known`."""
        ffi, lib = self.library.ffi, self.library.lib
        out = np.empty(self.shape, dtype=np.uint8)
        bits, done = self.bits_of(target), self.bits_of(known)
        tube, group = ffi.NULL, self.c
        if self.is_linear:
            tube = ffi.new("soter_reach_tube *")
            if not lib.soter_reach_tube_prepare(group, t_ns * NS, pieces, tube):
                hint = "a smaller grid, or a shorter horizon"
                raise UnboundedError("the flow is too stiff for so long a tube", hint)
        elif self.inputs.kind == "flow":
            group = ffi.new("soter_reach_group *", group[0])
            group.period = float(np.nextafter(t_ns * NS / pieces, np.inf))
        at = 0
        while at < self.tiles:
            at = lib.soter_reach_safe(
                group,
                tube,
                pieces,
                self.pointer(bits, "uint64_t *"),
                self.pointer(done, "uint64_t *"),
                self.pointer(out, "uint8_t *"),
                at,
                SLICE_S,
                self.threads,
            )
            share_done(at / self.tiles, "tubes")
        return out.view(np.bool_)

    def _shifted_cells(self, cells: Bools, errors: Mapping[int, float], *, grow: bool) -> Bools:
        now = np.ascontiguousarray(cells).view(np.uint8)
        for a, cells_by_cell in enumerate(self.overlapped_cells(errors)):
            if not errors.get(self.axes[a], 0.0):
                continue
            turns = 1 + (self.axes[a] in self.wraps)  # behind the last cell is the first one
            now = np.concatenate([now] * turns, axis=a)
            first, last = (np.concatenate([x] * turns) for x in cells_by_cell)
            n, after = now.shape[a], int(np.prod(self.shape[a + 1 :], dtype=np.int64))
            out, scratch = np.empty_like(now), np.empty((n + 1) * after, dtype=np.int32)
            self.library.lib.soter_reach_shrink(
                now.size // (n * after),
                n,
                after,
                self.pointer(first, "int32_t *"),
                self.pointer(last, "int32_t *"),
                int(grow),
                self.pointer(now, "uint8_t *"),
                self.pointer(out, "uint8_t *"),
                self.pointer(scratch, "int32_t *"),
            )
            now = np.ascontiguousarray(out[(slice(None),) * a + (slice(self.shape[a]),)])
        return now.view(np.bool_)

    def erode(self, cells: Bools, errors: Mapping[int, float]) -> Bools:
        """The cells that stay inside the set with every error in E, in the grid's shape.

        `errors` has each state's largest error and defines E. As E is symmetric, the result has the
        estimates with all states in the set, and also the states with all estimates in the set.
        """
        return self._shifted_cells(cells, errors, grow=False)

    def dilate(self, cells: Bools, errors: Mapping[int, float]) -> Bools:
        """The cells, in the grid's shape, that an error in E can reach from a cell of the set."""
        return self._shifted_cells(cells, errors, grow=True)

    def images_and_tubes(
        self, low: Sequence[float] | Floats, high: Sequence[float] | Floats, holds: int
    ) -> list[Floats]:
        """The images and tubes (k, axes, 2) from a box, after each of up to `holds` SC periods.

        It is there for tests.
        """
        n = len(self.axes)
        ends = [np.array(v, dtype=np.float64) for v in (low, high)]
        images, tubes = (np.zeros((holds, n, 2)) for _ in range(2))
        done = self.library.lib.soter_reach_run(
            self.c,
            self.pointer(ends[0], "double *"),
            self.pointer(ends[1], "double *"),
            holds,
            self.pointer(images, "double *"),
            self.pointer(tubes, "double *"),
        )
        return [images[:done], tubes[:done]]

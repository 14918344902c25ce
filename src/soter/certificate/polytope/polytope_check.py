"""The claims about one polytope group, each shown again from its half-spaces and multipliers.

Purpose: `PolytopeCheck`: K, R(H), the levels of computed predicates, the start, Q, the way to it.
Non-goals: predicates of the user (`predicates_on_boxes.py`), the DM (`dm_half_spaces.py`).

K is a core (docs/proof.md, "Polytopes"): from every state of K at a nominal time C holds for a
period and K when it ends, whatever is outstanding from the period before and whatever of the next
output acts early. The state is in K at a_0, which is the first nominal time.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from soter.certificate.format.errors import RejectedError
from soter.certificate.polytope.certificate_tables import HalfSpaces
from soter.certificate.polytope.dual_bounds import BoundedPolytope, in_balls, within
from soter.certificate.polytope.half_space_images import BallFlow, FreeImage, HoldImage
from soter.certificate.polytope.linear_with_noise import enclosed_flow
from soter.certificate.polytope.sc_linear_law import linear_law
from soter.certificate.reading.linear_flows import is_linear, linear_flow
from soter.certificate.reading.problem import error_of
from soter.certificate.terms.arb_balls import TINIEST, UNIT_ROUNDOFF, ZERO, exact
from soter.certificate.terms.terms import NotRecheckedError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flint import arb

    from soter.certificate.polytope.certificate_tables import PolytopeTables, Triples
    from soter.certificate.reading.case_model import CaseModel


def errors_of(model: CaseModel, tables: PolytopeTables) -> list[arb]:
    """By how much estimates of the group's states may be off, with the rounding of their sum."""
    errors = []
    for state in tables.states:
        error = exact(error_of(model.facts, state))
        if not error.is_zero():
            largest = max((abs(exact(x)) for x in model.extents[state]), key=float)
            error += (largest + error) * (2 * UNIT_ROUNDOFF) + TINIEST
        errors.append(error)
    return errors


WORK_MAX = 1_000_000
"""Of all claims about a group, in half-spaces times pieces of time times states: a minute or so."""


def affordable(tables: PolytopeTables) -> None:
    """NotRecheckedError where the sets and instants of a group are more work than is done.

    Every half-space is carried over every piece of time of each claim, and those of Q over as many
    holds as it takes to get there.
    """
    count = {name: len(instants) for name, instants in tables.instants.items()}
    n = len(tables.states)

    def faces(*sets: HalfSpaces | None) -> int:
        return sum(len(p.rows) + 2 * n for p in sets if p is not None)

    home = faces(tables.home)
    pieces = count["hold"] * (faces(tables.core) + home + 2 * n + faces(tables.target))
    pieces += count["hold"] * home * tables.periods
    pieces += faces(tables.core) * (count["R"] + count["start"])
    pieces += faces(*tables.levels, *tables.carried) * count["window"]
    if pieces * n > WORK_MAX:
        raise NotRecheckedError(
            f"polytopes of {n} states ask for {pieces:,} half-spaces times pieces of time: more "
            "work than is done"
        )


class PolytopeCheck:
    """One group in one case; `model.extents` of its states are the box of C.

    `delays_ns`: d and j, as `sc_chains.py` has them for grids.
    """

    def __init__(
        self, model: CaseModel, tables: PolytopeTables, delays_ns: tuple[int, int]
    ) -> None:
        if model.facts.kind != "flow":
            raise NotRecheckedError("a polytope group of a map")
        affordable(tables)
        self.model, self.tables, self.delays_ns = model, tables, delays_ns
        box = list(zip(tables.constraint.low, tables.constraint.high, strict=True))
        if box != [model.extents[s] for s in tables.states]:
            raise RejectedError("a polytope group ranges over another box than its C")
        self.law = linear_law(model, tables.states, tables.law)
        if tables.flow is None or is_linear(model, tables.states):
            flow = linear_flow(model, tables.states)
        else:
            flow = enclosed_flow(model, tables.states, self.law.controls, tables.flow)
        self.flow = BallFlow(flow, box, self.law.controls)

    @cached_property
    def core(self) -> BoundedPolytope:
        """K in balls."""
        return BoundedPolytope(self.tables.core)

    @cached_property
    def errors(self) -> list[arb]:
        """E."""
        return errors_of(self.model, self.tables)

    # ------------------------------------------------------------ helpers

    def _given(self, part: str) -> Iterator[Triples]:
        """The multipliers of a part of the proof, one claim after the other."""
        if part not in self.tables.multipliers:
            raise RejectedError(f"there are no multipliers for {part}")
        yield from self.tables.multipliers[part]
        raise RejectedError(f"there are too few multipliers for {part}")

    def _spent(self, part: str, given: Iterator[Triples]) -> None:
        """RejectedError where there are multipliers that nothing needed."""
        try:
            next(given)
        except RejectedError:
            return
        raise RejectedError(f"there are too many multipliers for {part}")

    def _instants(self, name: str, until_ns: int) -> tuple[int, ...]:
        instants = self.tables.instants[name]
        if instants[-1] != until_ns:
            raise RejectedError(f"the instants of `{name}` do not end when they should")
        return instants

    def _hold(self, which: str) -> HoldImage:
        rate = self.tables.rates[which]
        if rate.shape != (len(self.law.controls),):
            raise RejectedError("the rates of a polytope group are not one for each control")
        period = self.model.facts.times["delta_ns"]
        instants = self._instants("hold", period)
        return HoldImage(self.flow, self.law, rate.tolist(), instants, self.delays_ns)

    def _boxed_in(self, what: str, inner: HalfSpaces, outer: HalfSpaces) -> None:
        if not inner.boxed_in(outer):
            raise RejectedError(f"{what}: its box is larger")

    # ------------------------------------------------------------ SC

    def _kept(
        self,
        what: str,
        hold: HoldImage,
        own: HalfSpaces,
        within_faces: HalfSpaces,
        given: Iterator[Triples],
    ) -> None:
        """SC keeps a set and, on the way, C and some half-spaces."""
        self._boxed_in(f"{what} in C", own, self.tables.constraint)
        bounded = BoundedPolytope(own)
        if within_faces.rows:
            rows = in_balls(within_faces.rows)
            limits = [exact(x) for x in within_faces.bounds]
            bounded.require(f"{what} in what it keeps", rows, limits, next(given))
        for rows, limits in hold.linear():
            bounded.require(f"{what}: SC is linear", rows, limits, next(given))
        faces, ends = within_faces.faces
        for row, loss in hold.everywhere(in_balls(faces)):
            bounded.require(f"{what}: C during a period", row, within(ends, loss), next(given))
        faces, ends = own.faces
        row, loss = hold.after(in_balls(faces))
        bounded.require(f"{what} after a period", row, within(ends, loss), next(given))

    @cached_property
    def hold_of_core(self) -> HoldImage:
        """A hold of SC that begins in K."""
        return self._hold("K")

    def show_core(self) -> None:
        """K."""
        own, given = self.tables.constraint, self._given("K")
        self._kept("K", self.hold_of_core, self.tables.core, own, given)
        self._spent("K", given)

    def show_home(self) -> None:
        """Q is kept inside the target, whose tube the estimates follow, and K leads there.

        RejectedError where that does not hold, or Q or its target is not there.
        """
        tables = self.tables
        home, target = tables.home, tables.target
        if home is None or target is None:
            raise RejectedError("a claim needs Q and its target, which are not there")
        given = self._given("Q")
        rows, bounds = target.faces
        box = tables.constraint
        inside = HalfSpaces(box.low, box.high, tuple(rows), tuple(bounds))
        self._kept("Q", self._hold("Q"), home, inside, given)
        hold = self.hold_of_core
        faces, ends = home.faces
        row, loss = in_balls(faces), [ZERO] * len(faces)
        for _ in range(tables.periods):
            row, more = hold.after(row)
            loss = [a + b for a, b in zip(loss, more, strict=True)]
        self.core.require("K returns to Q", row, within(ends, loss), next(given))
        self._spent("Q", given)

    # ------------------------------------------------------------ any command

    def _free(
        self,
        what: str,
        start: HalfSpaces,
        inner: tuple[Sequence[Sequence[float]], Sequence[arb]],
        instants: Sequence[int],
        given: Iterator[Triples] | None,
    ) -> None:
        """From `start` the state is in `inner` for all of the time, whatever is commanded."""
        self._boxed_in(f"{what} in C", start, self.tables.constraint)
        bounded = BoundedPolytope(start)
        faces, ends = inner
        for row, loss in FreeImage(self.flow, instants).everywhere(in_balls(faces)):
            limits = [a - b for a, b in zip(ends, loss, strict=True)]
            bounded.require(what, row, limits, None if given is None else next(given))

    def _plain(self, p: HalfSpaces) -> tuple[list[tuple[float, ...]], list[arb]]:
        faces, ends = p.faces
        return faces, [exact(x) for x in ends]

    def _eroded(self, p: HalfSpaces) -> tuple[list[tuple[float, ...]], list[arb]]:
        """{z : z + E in p}."""
        faces, ends = p.faces
        losses = [
            sum((abs(exact(a)) * e for a, e in zip(row, self.errors, strict=True)), ZERO)
            for row in faces
        ]
        return faces, within(ends, losses)

    def show_free(self, horizon_ns: int) -> None:
        """R(H)."""
        instants = self._instants("R", horizon_ns)
        tables, given = self.tables, self._given("R")
        self._free("R(H)", tables.free, self._plain(tables.core), instants, given)
        self._spent("R", given)

    def show_start(self, low: Sequence[float], high: Sequence[float], until_ns: int) -> None:
        """A box of initial states stays in K until SC acts."""
        box = HalfSpaces(tuple(low), tuple(high), (), ())
        instants = self._instants("start", until_ns)
        self._free("an initial state", box, self._plain(self.tables.core), instants, None)

    def show_levels(self, window_ns: int) -> None:
        """S_0, S_1, ... of computed predicates.

        RejectedError where they do not hold, or are not as many as the levels ask for.
        """
        tables, given = self.tables, self._given("S")
        count = self.model.facts.levels - 1
        if len(tables.levels) != max(count, 1) or len(tables.carried) != len(tables.levels) - 1:
            raise RejectedError("the sets S are not as many as the levels ask for")
        self._estimates("S_0", tables.levels[0], tables.free, next(given))
        instants = self._instants("window", window_ns)
        for k, carried in enumerate(tables.carried):
            before, after = tables.levels[k], tables.levels[k + 1]
            self._free(f"G_{k + 1}", carried, self._eroded(before), instants, given)
            self._estimates(f"S_{k + 1}", after, carried, next(given))
            self._boxed_in(f"S_{k + 1} in S_{k}", after, before)
            if before.rows:
                limits = [exact(x) for x in before.bounds]
                rows = in_balls(before.rows)
                BoundedPolytope(after).require(f"S_{k + 1} in S_{k}", rows, limits, next(given))
        self._spent("S", given)

    def _estimates(
        self, what: str, estimates: HalfSpaces, states: HalfSpaces, weights: Triples
    ) -> None:
        """Every state behind an estimate of the one set lies in the other."""
        faces, limits = self._eroded(states)
        BoundedPolytope(estimates).require(what, in_balls(faces), limits, weights)

"""The claims about one polytope group, and what plants publish of states kept on polytopes.

Purpose: `PolytopeCheck` shows K, R(H), predicates, the start, Q and the way to it (`groups.py`).
`all_published` shows that what plants publish lies in its declared set, from K on, at all times of
a hold of SC (docs/verification.md, section 10); `starts_in_sets` shows it of initial states.
Non-goals: states on grids (`cell_predicates.py`); what is not affine in the states.

K is a core (docs/proof-sets.md, "Polytopes"): from every state of K at a nominal time C holds for a
period and K when it ends, whatever is outstanding from the period before and whatever of the next
output acts early. The state is in K at a_0, which is the first nominal time.

Of an affine leaf a x + r, r within what is no state of a polytope: a x(t) <= a' x(0) + loss for one
of the instants (`half_space_images.py`), and a' x <= b on K by weak duality
(`certificate_tables.py`). Multipliers are HiGHS's where it is installed; any are right, and without
them only the box of K is counted with.
"""

from __future__ import annotations

from contextlib import contextmanager
from functools import cached_property
from itertools import chain
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.cell_predicates import AdmitCheck, cells_published_in_set
from soter.certificate.cell_sets import Axes, Grid
from soter.certificate.groups import GroupCheck, whole
from soter.certificate.polytope.certificate_tables import INSTANTS, HalfSpaces, minus_losses
from soter.certificate.polytope.half_space_images import BallFlow, FreeImage, HoldImage
from soter.certificate.polytope.linear_laws import enclosed_flow, linear_law
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.linear_flows import is_linear, linear_flow
from soter.certificate.reading.module_facts import bounded_topics
from soter.certificate.reading.problem import error_of
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.linear_enclosures import TINIEST, UNIT_ROUNDOFF, ZERO, exact
from soter.workers.solvers import new_highs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.cell_sets import Cells
    from soter.certificate.groups import Task
    from soter.certificate.polytope.certificate_tables import PolytopeTables, Rows, Triples, Weights
    from soter.certificate.polytope.linear_laws import CommandLaw
    from soter.certificate.terms.terms import Linear, Terms
    from soter.language.model import typed

    Kept = tuple[PolytopeTables, HoldImage]
    Floats = NDArray[np.float64]


INPUTS = ("state", "box")
"""Kinds of atoms that are affine in the states, and whose ranges are theirs."""


def all_published(model: CaseModel, groups: Sequence[Kept], topic: int) -> bool:
    """Whether a topic's set surely holds what is published of all states that SC keeps.

    `groups`: all polytopes, each with its K and a hold of SC that begins there. Not of leaves
    that read states of other groups alone; those are anywhere in their grids.
    `model.extents` of the polytopes are their boxes of C. False: it is not known.
    """
    terms, states = model.new_terms()
    limits = model.limits(terms, states, topic)
    if terms.obligations:
        return False
    atoms = [x.atom for x in states]
    own = {atoms[s] for tables, _ in groups for s in tables.states}
    elsewhere = {*atoms} - own
    for value, low, high in limits:
        if any(terms.atoms[atom].kind not in INPUTS for atom in value.terms):
            return False
        if own.isdisjoint(value.terms) and not elsewhere.isdisjoint(value.terms):
            continue
        for sign, limit in ((1, exact(high)), (-1, -exact(low))):
            if not _upper_bound(terms, value, sign, atoms, groups) <= limit:
                return False
    return True


def _upper_bound(
    terms: Terms, value: Linear, sign: int, atoms: Sequence[int], groups: Sequence[Kept]
) -> arb:
    """An upper bound of sign * value, of all states that SC keeps."""
    total = sign * value.const + value.radius
    left = {atom: sign * factor for atom, factor in value.terms.items()}
    for tables, hold in groups:
        row = [left.pop(atoms[s], ZERO) for s in tables.states]
        if not all(x.is_zero() for x in row):
            total += _hold_bound(tables.core, hold, row)
    for atom, factor in left.items():
        ends = terms.atoms[atom].low, terms.atoms[atom].high
        total += (factor * ends[0]).max(factor * ends[1])
    return total


def _hold_bound(kernel: HalfSpaces, hold: HoldImage, row: list[arb]) -> arb:
    """An upper bound of row x(t): in K, and while SC holds what it commanded there."""
    bound = kernel.upper_bound(row, _weights(kernel, row))
    for own, loss in chain.from_iterable(zip(*x, strict=True) for x in hold.at_all_times([row])):
        bound = bound.max(kernel.upper_bound(own, _weights(kernel, own)) + loss)
    return bound


def _weights(p: HalfSpaces, row: Sequence[arb]) -> Weights:
    """Multipliers by HiGHS, so that the bound of a row is small; none where it is not installed."""
    try:
        solver = new_highs()
    except ImportError:
        return []
    n, columns = len(p.low), np.arange(len(p.low), dtype=np.int32)
    solver.addVars(n, np.array(p.low), np.array(p.high))
    for face, limit in zip(p.rows, p.bounds, strict=True):
        solver.addRow(-np.inf, limit, n, columns, np.array(face, dtype=np.float64))
    solver.changeColsCost(n, columns, -np.array([float(x) for x in row]))
    solver.run()
    if solver.getModelStatus().name != "kOptimal":
        return []
    duals = list(solver.getSolution().row_dual)[: len(p.rows)]
    return [(k, -d) for k, d in enumerate(duals) if isfinite(d) and d < 0.0]


def starts_in_sets(model: CaseModel) -> None:
    """RejectedError where what is published of an initial state may lie outside of its set.

    K says so only of grids.
    """
    facts = model.facts
    ends = tuple((s.low, s.high) for s in facts.states)
    at_start, box = (
        CaseModel(facts, model.parameter, ends),
        Axes(tuple(range(len(ends))), Grid(ends)),
    )
    for topic in bounded_topics(facts):
        if not cells_published_in_set(at_start, [box], topic)[0].members.all():
            name = facts.system.topics[topic].name
            raise RejectedError(f"an initial state may be none of those that `{name}` holds")


WORK_MAX = 1_000_000
"""Half-spaces times pieces of time times states, of all claims on a group: a minute or so."""
BOXES_MAX = 200_000
SMALLEST = 2.0**-16
"""A box of this share of the group's box is not halved any more."""
ROUNDING = 1e-12
"""Far above the rounding of a sum of a dozen products of doubles, relative to their sizes."""


def require_affordable(tables: PolytopeTables) -> None:
    """NotRecheckedError where the sets and instants of a group are more work than is done.

    Every half-space is carried over every piece of time of each claim, and those of Q over as many
    holds as it takes to get there.
    """
    count = {name: len(tables.instants.get(name, ())) for name in INSTANTS}
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


class PolytopeCheck(GroupCheck):
    """One group in one case; `model.extents` of its states are the box of C."""

    law: CommandLaw
    flow: BallFlow

    def __init__(self, model: CaseModel, tables: PolytopeTables) -> None:
        self.model, self.tables = model, tables

    def note_safe_cells(self, cells: Cells) -> None:
        """RejectedError where `safe` is not certain on all of C; then the law and flow are read."""
        if not cells.members.all():
            raise RejectedError("`safe` is not certain on the box of a polytope group")
        self.prepare(set())

    def prepare(self, claims: set[str]) -> None:
        """Read SC's law and the flow; RejectedError, NotRecheckedError where they are not known."""
        del claims
        model, tables = self.model, self.tables
        if model.facts.kind != "flow":
            raise NotRecheckedError("a polytope group of a map")
        require_affordable(tables)
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
    def errors(self) -> list[arb]:
        """E: how far estimates of the group's states may be off, and their sum is rounded."""
        errors = []
        for state in self.tables.states:
            error = exact(error_of(self.model.facts, state))
            if not error.is_zero():
                largest = max((abs(exact(x)) for x in self.model.extents[state]), key=float)
                error += (largest + error) * (2 * UNIT_ROUNDOFF) + TINIEST
            errors.append(error)
        return errors

    # ------------------------------------------------------------ helpers

    @contextmanager
    def _multipliers(self, part: str) -> Iterator[Callable[[], Triples]]:
        """Hand out the multipliers of a part, claim by claim; RejectedError unless all are used."""
        if part not in self.tables.multipliers:
            raise RejectedError(f"there are no multipliers for {part}")
        left = self.tables.multipliers[part][::-1]

        def following() -> Triples:
            if not left:
                raise RejectedError(f"there are too few multipliers for {part}")
            return left.pop()

        yield following
        if left:
            raise RejectedError(f"there are too many multipliers for {part}")

    def _instants_until(self, name: str, until_ns: int) -> tuple[int, ...]:
        instants = self.tables.instants.get(name, (0,))
        if instants[-1] != until_ns:
            raise RejectedError(f"the instants of `{name}` do not end when they should")
        return instants

    def _hold_image(self, which: str) -> HoldImage:
        rate = self.tables.rates.get(which)
        if rate is None or rate.shape != (len(self.law.controls),):
            raise RejectedError("the rates of a polytope group are not one for each control")
        facts = self.model.facts
        if facts.late_commands:
            raise NotRecheckedError("half-spaces of an SC whose jitter exceeds half its period")
        instants = self._instants_until("hold", facts.times["delta_ns"])
        late = facts.delay_ns, facts.jitter_ns
        return HoldImage(self.flow, self.law, rate.tolist(), instants, late)

    def _require_box_in(self, what: str, inner: HalfSpaces, outer: HalfSpaces) -> None:
        if not inner.boxed_in(outer):
            raise RejectedError(f"{what}: its box is larger")

    # ------------------------------------------------------------ SC

    def _show_kept(
        self,
        what: str,
        hold: HoldImage,
        own: HalfSpaces,
        within_faces: HalfSpaces,
        given: Callable[[], Triples],
    ) -> None:
        """RejectedError where SC may not keep `own` and, on the way, C and `within_faces`."""
        self._require_box_in(f"{what} in C", own, self.tables.constraint)
        if within_faces.rows:
            own.require(f"{what} in what it keeps", *within_faces.own_faces, given())
        for rows, limits in hold.linearity_limits():
            own.require(f"{what}: SC is linear", rows, limits, given())
        faces, ends = within_faces.in_balls
        for row, loss in hold.at_all_times(faces):
            own.require(f"{what}: C during a period", row, minus_losses(ends, loss), given())
        faces, ends = own.in_balls
        row, loss = hold.at_end(faces)
        own.require(f"{what} after a period", row, minus_losses(ends, loss), given())

    @cached_property
    def hold_of_core(self) -> HoldImage:
        """A hold of SC that begins in K."""
        return self._hold_image("K")

    def stays_in_topic_set(self, topic: int, cells: Cells, checks: Sequence[GroupCheck]) -> bool:
        """Shown on all of C, or else on K and along what SC does from there.

        NotRecheckedError where neither is shown, but of an abstraction, where it is assumed.
        """
        certain = bool(cells.members.all()) or all_published(
            self.model,
            [(c.tables, c.hold_of_core) for c in checks if isinstance(c, PolytopeCheck)],
            topic,
        )
        if not certain and not self.model.facts.symbol.verify.abstracts:
            name = self.model.facts.system.topics[topic].name
            raise NotRecheckedError(
                f"it was not shown over the half-spaces of K that what a plant "
                f"publishes on `{name}` lies in its declared set: elsewhere it stops"
            )
        return certain

    @whole
    def show_core(self) -> None:
        """SC keeps K and, on the way, C."""
        with self._multipliers("K") as given:
            self._show_kept("K", self.hold_of_core, self.tables.core, self.tables.constraint, given)

    @property
    def holds_to_return(self) -> int:
        """At most how many holds of SC it takes to come from any state of K back to Q."""
        return self.tables.periods

    def show_return(self, calm: Cells | None) -> list[Task]:
        """Show P2b; without `calm` (all of the target's box) the DM's half-spaces are asked, too.

        RejectedError where `calm` is not all of that box.
        """
        if calm is None:
            return [*self._show_home(), *self._show_given_back()]
        if not calm.members.all():
            raise RejectedError("`safer` is not certain on the box of a polytope group")
        return self._show_home()

    @whole
    def _show_home(self) -> None:
        """Show that SC keeps Q, within the target, and leads from K to Q in `periods` holds."""
        tables = self.tables
        home, target = tables.home, tables.target
        if home is None or target is None:
            raise RejectedError("a claim needs Q and its target, which are not there")
        rows, bounds = target.faces
        box = tables.constraint
        inside = HalfSpaces(box.low, box.high, tuple(rows), tuple(bounds))
        row, ends = home.in_balls
        loss = [ZERO] * len(row)
        for _ in range(tables.periods):
            row, more = self.hold_of_core.at_end(row)
            loss = [a + b for a, b in zip(loss, more, strict=True)]
        with self._multipliers("Q") as given:
            self._show_kept("Q", self._hold_image("Q"), home, inside, given)
            tables.core.require("K returns to Q", row, minus_losses(ends, loss), given())

    @whole
    def _show_given_back(self) -> None:
        """Every estimate of a state in the target lies where the DM surely gives control back."""
        tables = self.tables
        assert tables.target is not None
        if tables.gives_back is None:
            raise RejectedError("a claim needs the half-spaces of the DM, which are not there")
        faces, limits = tables.target.faces
        known = least_limits(zip(faces, (exact(x) for x in limits), strict=True))
        for row, limit in tables.gives_back:
            if row not in known or not known[row] + self._error_effect([*map(exact, row)]) <= limit:
                raise RejectedError(
                    "the DM is not certain to give control back where P2b returns to"
                )

    # ------------------------------------------------------------ any command

    def _require_kept_by_any_command(
        self,
        what: str,
        start: HalfSpaces,
        inner: tuple[Rows, Sequence[arb]],
        instants: Sequence[int],
        given: Callable[[], Triples] | None,
    ) -> None:
        """RejectedError unless any command keeps states from `start` in `inner` all the time."""
        self._require_box_in(f"{what} in C", start, self.tables.constraint)
        faces, ends = inner
        for row, loss in FreeImage(self.flow, instants).at_all_times(faces):
            start.require(what, row, minus_losses(ends, loss), None if given is None else given())

    def _eroded(self, p: HalfSpaces) -> tuple[Rows, Sequence[arb]]:
        """All z with z + E in `p`: estimates of states in `p` only, or states of such estimates."""
        faces, ends = p.in_balls
        return faces, minus_losses(ends, [self._error_effect(row) for row in faces])

    def _error_effect(self, row: Sequence[arb]) -> arb:
        """The most that the errors of estimates change the value of a row."""
        return sum((abs(a) * e for a, e in zip(row, self.errors, strict=True)), ZERO)

    @whole
    def show_free(self, horizon_ns: int) -> None:
        """Show that from R(H) the state stays in K for the horizon, whatever is commanded."""
        instants = self._instants_until("R", horizon_ns)
        with self._multipliers("R") as given:
            self._require_kept_by_any_command(
                "R(H)", self.tables.free, self.tables.core.in_balls, instants, given
            )

    @whole
    def show_start(self, until_ns: int) -> None:
        """Show that initial states stay in K, and that what is published of them is in its set."""
        starts_in_sets(self.model)
        own = [self.model.facts.states[i] for i in self.tables.states]
        box = HalfSpaces(tuple(s.low for s in own), tuple(s.high for s in own), (), ())
        instants = self._instants_until("start", until_ns)
        self._require_kept_by_any_command(
            "an initial state", box, self.tables.core.in_balls, instants, None
        )

    @whole
    def show_predicate(self, name: str, expr: typed.TypedExpr, *, admits: bool) -> None:
        """Halve boxes until each lies in R(H), or AC surely gets or keeps no control on it.

        RejectedError where one can be halved no further, or they are too many.
        """
        tables = self.tables
        check = AdmitCheck(self.model, tables.as_cell(tables.constraint), expr, admits=admits)
        faces, limits = (np.array(x) for x in tables.free.faces)
        first = np.array([tables.constraint.low, tables.constraint.high])
        width = first[1] - first[0]
        todo, looked = [(first, 0)], 0
        while todo:
            box, depth = todo.pop()
            looked += 1
            excess = _box_excess(faces, limits, box)
            if (excess <= 0).all():
                continue
            ends = [(exact(a), exact(b)) for a, b in box.T.tolist()]
            if check.decision.holds_on_box(ends, 0):
                continue
            shares = (box[1] - box[0]) / width
            if looked > BOXES_MAX or shares.max() < SMALLEST:
                text = ", ".join(f"[{a:.6g}, {b:.6g}]" for a, b in box.T)
                raise RejectedError(f"`{name}` may leave AC in control outside R(H) in {text}")
            weight = np.abs(faces[int(np.argmax(excess))]) * (box[1] - box[0])
            weight = np.where(shares >= SMALLEST, weight if depth % 2 else shares, -1.0)
            k = int(np.argmax(weight))
            middle = box[0, k] / 2 + box[1, k] / 2
            for end in (1, 0):
                half = box.copy()
                half[end, k] = middle
                todo.append((half, depth + 1))

    @whole
    def show_levels(self, between_ns: int) -> None:
        """The sets S_0, S_1, ... of computed predicates; RejectedError where they are too few."""
        tables, count = self.tables, self.model.facts.levels - 1
        if len(tables.levels) != max(count, 1) or len(tables.carried) != len(tables.levels) - 1:
            raise RejectedError("the sets S are not as many as the levels ask for")
        instants = self._instants_until("window", between_ns)
        with self._multipliers("S") as given:
            self._estimates("S_0", tables.levels[0], tables.free, given())
            for k, carried in enumerate(tables.carried):
                before, after = tables.levels[k], tables.levels[k + 1]
                self._require_kept_by_any_command(
                    f"G_{k + 1}", carried, self._eroded(before), instants, given
                )
                self._estimates(f"S_{k + 1}", after, carried, given())
                self._require_box_in(f"S_{k + 1} in S_{k}", after, before)
                if before.rows:
                    after.require(f"S_{k + 1} in S_{k}", *before.own_faces, given())

    def _estimates(
        self, what: str, estimates: HalfSpaces, states: HalfSpaces, weights: Triples
    ) -> None:
        """Show that every state behind an estimate in `estimates` lies in `states`."""
        estimates.require(what, *self._eroded(states), weights)


def _box_excess(faces: Floats, limits: Floats, box: Floats) -> Floats:
    """The most by which a box exceeds each half-space, at a corner; up to 0: surely not."""
    reach = np.abs(faces) @ np.abs(box).max(axis=0) + np.abs(limits)
    corners = np.where(faces > 0, box[1], box[0])
    values = (faces * corners).sum(axis=1)
    excess: Floats = values - limits + ROUNDING * reach
    return excess


def least_limits(parts: Iterable[tuple[tuple[float, ...], arb]]) -> dict[tuple[float, ...], arb]:
    """For each row the smallest limit that it has."""
    limit_by_row: dict[tuple[float, ...], arb] = {}
    for row, limit in parts:
        known = limit_by_row.get(row)
        if known is None or limit < known:
            limit_by_row[row] = limit
    return limit_by_row

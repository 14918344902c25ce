"""Shows that SC leads every run from a box around rest back into it, by tubes.

Purpose: this is rule 1 of "Decisions by tubes" (proof-flight.md). `leads_back` asks the tube of
`rest.soter` whether every run of SC that begins in the box comes back into it: first from the whole
box, then, where that fails, from ever smaller halves of it. Where a part is not shown, its answer
says which one, and into how large a box SC does lead. `runs_from` first simulates runs in doubles,
which takes a moment: from corners of the box, under disturbances at their ends, with reads that are
true and new. Where no output of SC finds all runs from one start back in the box, no tube can show
that start, and the search ends at once.
Non-goals: finding the box (`rest_claims.py`), the tube itself (`rest.soter`), verdicts by runs:
that all simulated runs come back shows nothing.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.current_phase import announce, phase, share_done
from soter.diagnostics.diagnostic import SoterError
from soter.language.model.types import show_ns
from soter.verify.problem.problem import Interval
from soter.verify.tubes.expression_graph import in_order, middle
from soter.verify.tubes.generated_functions import Caller, TooLongError
from soter.verify.tubes.kinks import kinks_of
from soter.verify.tubes.problem import cut_to_farthest
from soter.verify.tubes.tube_check import CUTS, MOST, PLAIN

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from soter.verify.tubes.expression_graph import Node
    from soter.verify.tubes.tube_check import TubeCheck

    Values = NDArray[np.float64]
    Box = dict[int, Interval]
    Ends = tuple[list[float], list[float]]
    """The lower and the upper ends of a region, in the order of `TubeCheck.states`."""


CORNERS_MAX = 64
PLACES = 7
"""Runs start at this many places, and one, along each range of a state that need not come back."""
STEPS_MAX = 20_000
"""Runge-Kutta steps of one run, at most."""
STILL = 1e-9
"""As a share of the box's width: a state that moves less between two outputs of SC has settled."""
OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "over": np.divide,
    "neg": np.negative,
    "square": np.square,
    "inverse": np.reciprocal,
    "friction": lambda x, k: x / (np.abs(x) + k),
    "min": np.minimum,
    "max": np.maximum,
    "limit": lambda x, low, high: np.minimum(np.maximum(x, low), high),
    "select": np.where,
    "and": np.logical_and,
    "or": np.logical_or,
    "positive": lambda x: x > 0.0,
    "sign": lambda x: x > 0.0,
    "not negative": lambda x: x >= 0.0,
    "any_turn": np.positive,
    "wrap_angle": lambda x: np.arctan2(np.sin(x), np.cos(x)),
    "real_sin": np.sin,
    "real_cos": np.cos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "asin": np.arcsin,
    "acos": np.arccos,
    **{
        name: getattr(np, name)
        for name in ("abs", "sin", "cos", "exp", "log", "sqrt", "tan", "tanh")
    },
}


@dataclass(frozen=True)
class RunNotBack:
    """A simulated run that is not back: it began at `start` under `disturbed`, each by its number.

    After `after_s` seconds, where the simulation ended, `state` was at `value`. `calm`: without
    disturbances it is as far out, by more than the box is wide.
    """

    state: int
    value: float
    after_s: float
    start: dict[int, float]
    disturbed: dict[int, float]
    calm: bool


@dataclass(frozen=True)
class RestRuns:
    """`reached`: where all runs ended, by state; `astray`: one of a start that never came back."""

    reached: dict[int, Interval]
    astray: RunNotBack | None


def runs_from(check: TubeCheck, box: Mapping[int, Interval], own: Sequence[int]) -> RestRuns | None:
    """Simulates runs from `box`, which have to come back in the states `own`.

    A start is astray where at no output of SC all its runs, one for each disturbance, are back: no
    part of the box that holds it can be shown. None where an operation cannot be simulated.
    """
    if not (flow := _SimulatedRuns.of(check)):
        return None
    start_points, disturbances = _start_points(check, box, own), _disturbance_samples(check)
    states = np.repeat(start_points, len(disturbances), axis=0).T
    disturbance_by_run = np.tile(disturbances, (len(start_points), 1)).T
    rows = [check.states.index(s) for s in own]
    low, high = (np.array([[getattr(box[s], e)] for s in own]) for e in ("low", "high"))
    width = np.maximum(high - low, np.finfo(float).tiny)
    back = np.zeros(len(start_points), dtype=bool)
    outputs, settled = 0, False
    with np.errstate(all="ignore"):
        while outputs < check.times.switches and not (settled or back.all()):
            outputs += 1
            before, states = states, flow.states_after_hold(states, disturbance_by_run)
            distance = np.maximum(low - states[rows], states[rows] - high) / width
            distance = np.where(np.isfinite(distance), distance, np.inf).reshape(
                len(own), len(start_points), -1
            )
            back |= (distance <= 0.0).all(axis=(0, 2))
            settled = bool((np.abs(states - before)[rows] <= STILL * width).all())
        ends = states[rows]
        reached = {
            s: Interval(float(np.nanmin(of)), float(np.nanmax(of))) if np.isfinite(of).any()
            else Interval(-np.inf, np.inf)
            for s, of in zip(own, ends, strict=True)
        }  # fmt: skip
    if back.all():
        return RestRuns(reached, None)
    distance_if_astray = np.where(back[None, :, None], -np.inf, distance)
    state, start, wind = (
        int(k) for k in np.unravel_index(distance_if_astray.argmax(), distance_if_astray.shape)
    )
    run = start * len(disturbances) + wind
    return RestRuns(
        reached,
        RunNotBack(
            own[state],
            float(ends[state, run]),
            outputs * check.times.period * 1e-9,
            dict(zip(check.states, map(float, start_points[start]), strict=True)),
            dict(enumerate(map(float, disturbances[wind]))),
            bool(distance[state, start, 0] > 1.0),
        ),
    )


def _start_points(check: TubeCheck, box: Mapping[int, Interval], own: Sequence[int]) -> Values:
    """Starts, shape (n, states): each corner in the states `own`, with the others at each place."""
    corners = _box_corners([[box[s].low, box[s].high] for s in own])
    rest = [box.get(s, Interval(0.0, 0.0)) for s in check.states]
    rest = [r if np.isfinite(r.high - r.low) else Interval(0.0, 0.0) for r in rest]
    others = [[r.low + (r.high - r.low) * k / PLACES for r in rest] for k in range(PLACES + 1)]
    starts = np.array([other for _ in corners for other in others])
    starts[:, [check.states.index(s) for s in own]] = np.repeat(corners, len(others), axis=0)
    return starts


def _box_corners(sides: Sequence[list[float]]) -> list[list[float]]:
    """The corners of a box; if it has many sides, those with all sides but one at the same end."""
    if 2 ** len(sides) <= CORNERS_MAX:
        return [list(c) for c in product(*sides)]
    ends = [[side[0] for side in sides], [side[1] for side in sides]]
    corners = list(ends)
    for of, other in (ends, ends[::-1]):
        corners += [[*of[:k], other[k], *of[k + 1 :]] for k in range(len(sides))]
    return corners


def _disturbance_samples(check: TubeCheck) -> Values:
    """Disturbances, shape (n, disturbances): all in the middle, all at one end, one at an end."""
    ranges = check.problem.disturbances
    still = [middle(d) for d in ranges]
    every = [still, [d.low for d in ranges], [d.high for d in ranges]]
    every += [
        [*still[:k], e, *still[k + 1 :]] for k, d in enumerate(ranges) for e in (d.low, d.high)
    ]
    return np.array(every)


@dataclass(frozen=True)
class _SimulatedRuns:
    """Simulates many runs at once: arrays of states of shape (states, runs)."""

    check: TubeCheck
    steps: int

    @classmethod
    def of(cls, check: TubeCheck) -> _SimulatedRuns | None:
        """The simulation of a check; None where an operation is missing in `OPERATIONS`."""
        if not has_known_operations(check):
            return None
        fine = -(-check.times.period // max(1, check.problem.plant_period_ns))
        return cls(check, max(2, min(fine, STEPS_MAX // max(1, check.times.switches))))

    def states_after_hold(self, x: Values, w: Values) -> Values:
        """The states, one period of SC later, by Runge-Kutta; the command is held meanwhile."""
        check, runs = self.check, x.shape[1]
        step = check.times.period * 1e-9 / self.steps
        read = {("y", s): x[k] for k, s in enumerate(check.states)}
        read |= {("l", k): np.full(runs, middle(r)) for k, r in enumerate(check.kept)}
        inputs = {("u", k): u for k, u in enumerate(values_of_nodes(check.law, read, runs))}
        inputs |= {("w", k): wind for k, wind in enumerate(w)}
        rates = [check.rates[s] for s in check.states]

        def rate(at: Values) -> Values:
            states = {("x", s): at[k] for k, s in enumerate(check.states)}
            return np.array(values_of_nodes(rates, {**inputs, **states}, runs))

        for _ in range(self.steps):
            a = rate(x)
            b = rate(x + 0.5 * step * a)
            c = rate(x + 0.5 * step * b)
            d = rate(x + step * c)
            x = x + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        return x


def has_known_operations(check: TubeCheck) -> bool:
    """Whether `values_of_nodes` knows all operations of rates and of SC."""
    every = in_order([*(check.rates[s] for s in check.states), *check.law])
    return {e.op for e in every} <= {"number", "input", "known", *OPERATIONS}


def values_of_nodes(
    roots: Sequence[Node], inputs: Mapping[tuple[str, int], Values], runs: int
) -> list[Values]:
    """The values of some expressions for given inputs, each of shape (runs,)."""
    found: dict[Node, Any] = {}
    for e in in_order(roots):
        if e.op in ("number", "known"):
            found[e] = np.full(runs, e.of[0])
        elif e.op == "input":
            found[e] = inputs[e.of]
        else:
            found[e] = OPERATIONS[e.op](*(found[x] for x in e.of))
    return [found[e] for e in roots]


SPLITS = 8
"""How often a part of the box is halved, at most."""
OPERATIONS_MAX = 10**10
"""Operations for all parts that are tried, at most: some minutes."""
LARGER = (1.1, 1.6)
"""Factors by which the box that simulated runs end in is enlarged: does SC lead into that one?"""


@dataclass
class LeadBackResult:
    """What the search found. `why`: why SC is not shown to lead back, in words; "": it is shown.

    `ways`: Y of proof-flight.md, by state: the range that SC leads through on its way back.
    `astray`: a state in which a simulated run with exact, new reads is not back, so younger reads
    would not help.
    """

    ways: Box
    why: str = ""
    astray: int | None = None


def region_of(check: TubeCheck, by_state: Mapping[int, Interval]) -> Ends:
    """A box as the tube takes it; [0, 0] for a state without a range, which nobody reads there."""
    ranges = [by_state.get(s, Interval(0.0, 0.0)) for s in check.states]
    return [r.low for r in ranges], [r.high for r in ranges]


def box_in_words(check: TubeCheck, box: Mapping[int, Interval]) -> str:
    """A box in words."""
    names = check.problem.quantities.states
    return ", ".join(f"{names[s].name} in [{r.low:.4g}, {r.high:.4g}]" for s, r in box.items())


def leads_back(check: TubeCheck, caller: Caller, box: Box, own: Sequence[int]) -> LeadBackResult:
    """Whether SC leads from all of `box` back into it, as far as the states `own` are concerned."""
    return _LeadBackSearch(check, caller, box, own).result()


class _LeadBackSearch:
    """Asks the tube about one box and parts of it."""

    def __init__(self, check: TubeCheck, caller: Caller, box: Box, own: Sequence[int]) -> None:
        self._check, self._caller, self._box, self._own = check, caller, box, own
        self._cut = [*own, *check.turning]
        self._name = check.problem.name
        self._rooms = {s: cut_to_farthest(check.rooms[s]) for s in own}
        self._rests: tuple[int, Box] | None = None
        self._span: Box = {}
        """The ranges of all states on the way that was asked last, as far as it was followed."""

    def result(self) -> LeadBackResult:
        own, ways = self._own, {s: self._box[s] for s in self._own}
        into = box_in_words(self._check, ways)
        runs = runs_from(self._check, self._box, own) if own else None
        if runs is not None and runs.astray:
            why = f"SC does not lead back into {into}: {self._run_in_words(runs.astray)}"
            announce(lambda: f"{self._name}: {why}")
            why += self._larger_box_in_words(runs.reached)
            return LeadBackResult({}, why, astray=runs.astray.state)
        todo, shown, tried, parts_max = [(self._box, 0, 1.0)], 0.0, 0, 1
        while todo:
            part, depth, share = todo.pop()
            tried += 1
            way = self._way(part, self._box) if depth else self._way_from_whole_box()
            if way is not None:
                shown += share
                ways = {s: _hull(ways[s], way[s]) for s in own}
            elif depth == SPLITS or not own or tried > parts_max:
                return self._result_of_failure(part, into, shown, tried, runs)
            else:
                todo += [(half, depth + 1, 0.5 * share) for half in self._halves(part)]
                if not depth:
                    announce(lambda: f"{self._name}: SC is not shown to lead back into {into} from "
                             "all of it at once; asked of parts")  # fmt: skip
                    self._choose_cut_for_parts()
                    parts_max = max(2 * SPLITS, OPERATIONS_MAX // self._caller.operations("keeps"))
                    todo.append((self._smallest_last_part(), SPLITS, 0.0))  # counted with its whole
            phase(f"{self._name}: shown that SC leads back from {shown:.1%} of rest")
            share_done(shown)
        return LeadBackResult(ways)

    def _result_of_failure(
        self, part: Box, into: str, shown: float, tried: int, runs: RestRuns | None
    ) -> LeadBackResult:
        if self._rests is not None:
            self._check.cut, way = self._rests
            return LeadBackResult({s: _hull(self._box[s], way[s]) for s in self._own})
        reached = {} if runs is None else runs.reached
        return LeadBackResult({}, self._unshown_part_in_words(part, into, shown, tried, reached))

    def _smallest_last_part(self) -> Box:
        """The smallest part that would be asked last: if it fails, the search ends at once."""
        part = self._box
        for _ in range(SPLITS):
            part = self._halves(part)[-1]
        return part

    def _choose_cut_for_parts(self) -> None:
        """Take the most columns where they show of the smallest part what few do not."""
        part, fits = self._smallest_last_part(), False
        if self._check.answers_vary and self._way(part, self._box) is None:
            with suppress(TooLongError, SoterError):
                fits = self._way_with_cut(MOST, part) is not None
            if not fits:
                self._way_with_cut(PLAIN, part)

    def _way_from_whole_box(self) -> Box | None:
        """The way from all of the box, by the first of `CUTS` with which the start is shown, too.

        If there is none, by the first that shows rest and, where it collects, the start.

        `_rests` keeps the first cut that shows rest alone, with its way: it is the answer where
        parts fail, too, since a start may lie outside what a map calls free.
        """
        for cut in range(len(CUTS)) if self._check.answers_vary else ():
            with suppress(TooLongError, SoterError):  # it does not fit into a step, or into forms
                way = self._way_with_cut(cut, self._box)
                if way is not None and _is_start_shown(self._check, way):
                    return way
                self._rests = self._rests or (None if way is None else (cut, way))
        if self._rests is not None:
            self._check.cut, way = self._rests
            if is_start_collected(self._check, way):
                return way
        return self._way_with_cut(PLAIN, self._box)

    def _way_with_cut(self, cut: int, part: Box) -> Box | None:
        check = self._check
        check.cut = cut
        if cut != PLAIN:
            check.decision_cost()
        self._caller = Caller(check.offline_text({}))
        return self._way(part, self._box)

    def _way(self, part: Box, box: Box) -> Box | None:
        """The range of each state on the way from `part` back into `box`; None: it is not shown."""
        moving = {s: Interval(-inf, inf) for s in self._check.states if s not in self._own}
        way, end = ({**moving, **{s: of[s] for s in self._own}} for of in (self._rooms, box))
        led = self._caller.result("keeps", *(region_of(self._check, b) for b in (part, way, end)))
        if led is None:
            self._span = {}
            return None
        self._span = {s: Interval(*r) for s, *r in zip(self._check.states, *led[1], strict=True)}
        return self._span if led[0] else None

    def _halves(self, part: Box) -> list[Box]:
        """The two halves of a part, cut in the state whose side is longest against the box's."""
        sides = {s: self._box[s].high - self._box[s].low for s in self._own}
        sides |= dict.fromkeys(self._check.turning, 1.0)  # a sine is no line over much more
        longest = max(
            self._cut,
            key=lambda s: (part[s].high - part[s].low) / sides[s] if sides[s] else 0.0,
        )
        low, high = part[longest].low, part[longest].high
        at = middle(part[longest])
        return [{**part, longest: Interval(*ends)} for ends in ((low, at), (at, high))]

    # ------------------------------------------------------------ in words

    def _run_in_words(self, run: RunNotBack) -> str:
        states = self._check.problem.quantities.states
        winds = self._check.problem.quantities.disturbances
        start = ", ".join(f"{states[s].name} = {x:.3g}" for s, x in run.start.items())
        under = ", ".join(f"{winds[k].name} = {x:.3g}" for k, x in run.disturbed.items())
        if run.value != run.value:
            return f"on a run from {start} a rate is no number, as of a function beyond its domain"
        where = f"{states[run.state].name} = {run.value:.4g} after {run.after_s:.4g} s"
        far = "; without disturbances it goes as far: perhaps a sign of SC is wrong" * run.calm
        return f"a run from {start}{f' under {under}' if under else ''} is at {where}{far}"

    def _unshown_part_in_words(
        self, part: Box, into: str, shown: float, tried: int, reached: Box
    ) -> str:
        own = {s: part[s] for s in self._cut}
        text = f"SC does not certainly lead back into {into}"
        if not own:
            return text
        where = f"not from {box_in_words(self._check, own)} ({tried} part{'s' * (tried > 1)} asked)"
        where += self._unknown_past_in_words()
        where += f"; on the way there is {self._caller.fault}" if self._caller.fault else ""
        where += self._widest_in_words({s: part[s] for s in self._own})
        return f"{text}: shown of {shown:.1%} of it, {where}{self._larger_box_in_words(reached)}"

    def _unknown_past_in_words(self) -> str:
        """Words about reads whose states have no bound; "" where the tube was followed."""
        if all(r.low <= r.high for r in self._span.values()):
            return ""
        oldest = show_ns(self._check.times.delay)
        return f"; nothing bounds how states moved in the {oldest} before, of which SC may read"

    def _widest_in_words(self, own: Box) -> str:
        """Words about the state that the tube leaves farthest, counted in widths of its `rest`."""
        widths = {s: self._box[s].high - self._box[s].low for s in own if s in self._span}
        times = {
            s: (self._span[s].high - self._span[s].low) / w for s, w in widths.items() if w > 0.0
        }
        if not times or max(times.values()) <= 1.0:
            return ""
        widest = max(times, key=times.__getitem__)
        farthest = box_in_words(self._check, {widest: self._span[widest]})
        return f"; on the way there it may be {farthest}"

    def _larger_box_in_words(self, reached: Box) -> str:
        """Words about a larger box that SC leads back into; "" where no tried box is one."""
        if not all(abs(r.low) < inf and abs(r.high) < inf for r in reached.values()):
            return ""
        for factor in LARGER:
            phase(f"{self._name}: whether SC leads back into a larger rest")
            larger = {
                s: _intersection(_enlarged(_hull(self._box[s], r), factor), self._rooms[s])
                for s, r in reached.items()
            }
            if larger and self._way({**self._box, **larger}, {**self._box, **larger}) is not None:
                return f"; into {box_in_words(self._check, larger)} it is shown to lead"
        return ""


def _is_start_shown(check: TubeCheck, ways: Box) -> bool:
    initial = {s: check.problem.initial[s] for s in check.states}
    return Caller(check.offline_text(ways)).returns_true("starts", region_of(check, initial))


def is_start_collected(check: TubeCheck, ways: Box) -> bool:
    """Whether a check that collects leads the start to rest; `kink` is then the first such one."""
    for kink in kinks_of(check.law):
        check.kink = kink
        with suppress(TooLongError):
            if _is_start_shown(check, ways):
                return True
    check.kink = None
    return False


def _hull(a: Interval, b: Interval) -> Interval:
    return Interval(min(a.low, b.low), max(a.high, b.high))


def _enlarged(a: Interval, factor: float) -> Interval:
    m, half = middle(a), 0.5 * (a.high - a.low) * factor
    return Interval(m - half, m + half)


def _intersection(a: Interval, room: Interval) -> Interval:
    return Interval(max(a.low, room.low), min(a.high, room.high))

"""Whether SC leads back into a box around rest: rule 1 of "Decisions by tubes" (docs/proof.md).

Purpose: `led_back`: on which way, from parts of the box where it does not from all of it at once;
where that is not shown a text with figures: a run that is not back, or which part is not led back,
and into how large a box SC leads instead.
Non-goals: the box (`rest_claims.py`), the tube (`rest.soter`).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import announce, phase
from soter.diagnostics.diagnostic import SoterError
from soter.verify.problem.problem import Interval
from soter.verify.tubes.generated_functions import Caller, TooLongError
from soter.verify.tubes.module_expressions import middle
from soter.verify.tubes.problem import reached
from soter.verify.tubes.rest_runs import runs_from
from soter.verify.tubes.tube_check import CUTS, PLAIN

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.verify.tubes.rest_runs import Astray
    from soter.verify.tubes.tube_check import TubeCheck

    Box = dict[int, Interval]
    Ends = tuple[list[float], list[float]]
    """Of a region: low and high, in the order of `TubeCheck.states`."""

SPLITS = 8
"""How often the box is halved at most, where SC does not lead back from all of it at once."""
OPERATIONS_MAX = 10**10
"""Of all parts that are tried: some minutes."""
LARGER = (1.1, 1.6)
"""How much larger a box than the one that runs end in is tried."""


@dataclass
class Led:
    """Y, by state, all that SC leads through from the box; `why` it is not shown, "": it is.

    `astray`: a run that reads what is true and new is not back, so that younger reads are no help.
    """

    ways: Box
    why: str = ""
    astray: bool = False


def ends(check: TubeCheck, by_state: Mapping[int, Interval]) -> Ends:
    """A region; 0 for a state that has no range, which nothing asked then reads."""
    ranges = [by_state.get(s, Interval(0.0, 0.0)) for s in check.states]
    return [r.low for r in ranges], [r.high for r in ranges]


def told(check: TubeCheck, box: Mapping[int, Interval]) -> str:
    """A box in words."""
    names = check.problem.quantities.states
    return ", ".join(f"{names[s].name} in [{r.low:.4g}, {r.high:.4g}]" for s, r in box.items())


def led_back(
    check: TubeCheck,
    caller: Caller,
    box: Box,
    own: Sequence[int],
    progress: Callable[[float], None] | None = None,
) -> Led:
    """From `box`, into the sides `own` of it; `progress` is told the share that is done."""
    return _Search(check, caller, box, own).all_of_it(progress)


class _Search:
    """Of one box."""

    def __init__(self, check: TubeCheck, caller: Caller, box: Box, own: Sequence[int]) -> None:
        self._check, self._caller, self._box, self._own = check, caller, box, own
        self._name = check.problem.name
        self._rooms = {s: reached(check.rooms[s]) for s in own}
        self._rests: tuple[int, Box] | None = None

    def all_of_it(self, progress: Callable[[float], None] | None) -> Led:
        own, ways = self._own, {s: self._box[s] for s in self._own}
        into = told(self._check, ways)
        runs = runs_from(self._check, self._box, own) if own else None
        if runs is not None and runs.astray:
            why = f"SC does not lead back into {into}: {self._run(runs.astray)}"
            announce(lambda: f"{self._name}: {why}")
            return Led({}, why + self._instead(runs.reached), astray=True)
        todo, shown, tried = [(self._box, 0, 1.0)], 0.0, 0
        parts_max = max(2 * SPLITS, OPERATIONS_MAX // self._caller.operations("keeps"))
        while todo:
            part, depth, share = todo.pop()
            tried += 1
            way = self._way(part, self._box) if depth else self._whole()
            if way is not None:
                shown += share
                ways = {s: _hull(ways[s], way[s]) for s in own}
            elif depth == SPLITS or not own or tried >= parts_max:
                if self._rests is not None:
                    self._check.cut, way = self._rests
                    return Led({s: _hull(self._box[s], way[s]) for s in own})
                reached = {} if runs is None else runs.reached
                return Led({}, self._not_from(part, into, shown, tried, reached))
            else:
                if not depth:
                    announce(lambda: f"{self._name}: SC is not shown to lead back into {into} from "
                             "all of it at once; asked of parts")  # fmt: skip
                halves = self._halves(part)
                todo += [(half, depth + 1, 0.5 * share) for half in halves]
                if not depth:  # what ends the search soonest: the last part of those to come
                    for _ in range(1, SPLITS):
                        halves = self._halves(halves[-1])
                    todo.append((halves[-1], SPLITS, 0.0))  # counted with what it is of
            phase(f"{self._name}: shown that SC leads back from {shown:.1%} of rest")
            if progress is not None:
                progress(shown)
        return Led(ways)

    def _whole(self) -> Box | None:
        """`_way` of all of the box, by the first of `CUTS` that shows the start, too.

        `_rests`: the first that shows rest, with its way. It is what there is where parts show
        nothing, either: a start may be beyond what a map calls free.
        """
        for cut in range(len(CUTS)) if self._check.read_by_law else ():
            with suppress(TooLongError, SoterError):  # it does not fit into a step, or into forms
                way = self._way_by(cut)
                if way is not None and self._starts(way):
                    return way
                self._rests = self._rests or (None if way is None else (cut, way))
        return self._way_by(PLAIN)

    def _way_by(self, cut: int) -> Box | None:
        check = self._check
        check.cut = cut
        if cut != PLAIN:
            check.cost()
        self._caller = Caller(check.offline({}))
        return self._way(self._box, self._box)

    def _starts(self, way: Box) -> bool:
        initial = {s: self._check.problem.initial[s] for s in self._check.states}
        return Caller(self._check.offline(way)).holds("starts", ends(self._check, initial))

    def _way(self, part: Box, box: Box) -> Box | None:
        """Where SC leads through from a part back into a box; None: it is not shown to."""
        moving = {s: Interval(-inf, inf) for s in self._check.states if s not in self._own}
        way, end = ({**moving, **{s: of[s] for s in self._own}} for of in (self._rooms, box))
        led = self._caller.value("keeps", *(ends(self._check, b) for b in (part, way, end)))
        if led is None or not led[0]:
            return None
        return {s: Interval(*r) for s, *r in zip(self._check.states, *led[1], strict=True)}

    def _halves(self, part: Box) -> list[Box]:
        """A part, halved where it is the longest part of the box's side."""
        sides = {s: self._box[s].high - self._box[s].low for s in self._own}
        longest = max(
            self._own,
            key=lambda s: (part[s].high - part[s].low) / sides[s] if sides[s] else 0.0,
        )
        low, high = part[longest].low, part[longest].high
        at = middle(part[longest])
        return [{**part, longest: Interval(*ends)} for ends in ((low, at), (at, high))]

    # ------------------------------------------------------------ in words

    def _run(self, run: Astray) -> str:
        states = self._check.problem.quantities.states
        winds = self._check.problem.quantities.disturbances
        start = ", ".join(f"{states[s].name} = {x:.3g}" for s, x in run.start.items())
        under = ", ".join(f"{winds[k].name} = {x:.3g}" for k, x in run.disturbed.items())
        where = f"{states[run.state].name} = {run.value:.4g} after {run.after_s:.4g} s"
        return f"a run from {start}{f' under {under}' if under else ''} is at {where}"

    def _not_from(self, part: Box, into: str, shown: float, tried: int, reached: Box) -> str:
        own = {s: part[s] for s in self._own}
        what = f"SC does not certainly lead back into {into}"
        if not own:
            return what
        where = f"not from {told(self._check, own)} ({tried} part{'s' * (tried > 1)} asked)"
        return f"{what}: shown of {shown:.1%} of it, {where}{self._instead(reached)}"

    def _instead(self, reached: Box) -> str:
        """A larger box that SC leads back into, if one of those that are tried is."""
        if not all(abs(r.low) < inf and abs(r.high) < inf for r in reached.values()):
            return ""
        for factor in LARGER:
            phase(f"{self._name}: whether SC leads back into a larger rest")
            larger = {
                s: _within(_scaled(_hull(self._box[s], r), factor), self._rooms[s])
                for s, r in reached.items()
            }
            if larger and self._way({**self._box, **larger}, {**self._box, **larger}) is not None:
                return f"; into {told(self._check, larger)} it is shown to lead"
        return ""


def _hull(a: Interval, b: Interval) -> Interval:
    return Interval(min(a.low, b.low), max(a.high, b.high))


def _scaled(a: Interval, factor: float) -> Interval:
    m, half = middle(a), 0.5 * (a.high - a.low) * factor
    return Interval(m - half, m + half)


def _within(a: Interval, room: Interval) -> Interval:
    return Interval(max(a.low, room.low), min(a.high, room.high))

"""The proof by tubes that SC leads every run from a box around rest back into the box.

Purpose: this is rule 1 of "Decisions by tubes" (proof-flight.md). `way_back` asks the tube of
`rest.soter` whether every run of SC that begins in the box comes back into it: first for the whole
box, then, where that fails, for ever smaller halves of it. Where a part is not shown the result
names it, and another box into which SC does lead. Simulated runs (`simulated_runs.py`) end the
search at once where no tube can show a start. Behind it the start is asked, and how precisely the
DM has to follow SC so that AC has control there.
Non-goals: finding the box (`rest_claims.py`), the tube itself (`rest.soter`).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from math import inf
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import announce, phase, share_done
from soter.diagnostics.diagnostic import SoterError
from soter.language.model.types import show_ns
from soter.verify.problem.problem import Interval
from soter.verify.tubes.compiled_calls import CompiledCaller
from soter.verify.tubes.expression_graph import middle
from soter.verify.tubes.generated_functions import TooLongError
from soter.verify.tubes.kinks import kinks_of
from soter.verify.tubes.noise_estimate import boxes_back_soon, moves_quickly
from soter.verify.tubes.problem import cut_to_farthest
from soter.verify.tubes.simulated_runs import runs_from
from soter.verify.tubes.tube_precision import FINE, PLAIN, PRECISIONS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.verify.tubes.generated_functions import Caller
    from soter.verify.tubes.simulated_runs import RestRuns, RunNotBack
    from soter.verify.tubes.tube_check import TubeCheck

    Box = dict[int, Interval]
    Ends = tuple[list[float], list[float]]
    """The lower ends and the upper ends of a region, in the order of `TubeCheck.states`."""


SPLITS = 12
"""A part of the box is halved this many times at most."""
LARGER = (1.1, 1.6)
"""Factors by which the box in which simulated runs end is enlarged, for another box to try."""
ESTIMATED = 2
"""The most boxes of the linear estimate that are tried."""


@dataclass
class LeadBackResult:
    """The result of a search; `why` says why SC is not shown to lead back, "" if it is shown.

    `ways` is Y of proof-flight.md, the range of each state on the way back. `astray` is a state in
    which a simulated run with exact, new reads is not back, so younger reads would not help.
    `other` is another box into which SC is shown to lead; it is empty if none was found.
    """

    ways: Box
    why: str = ""
    astray: int | None = None
    other: Box = field(default_factory=dict)


def box_ends(check: TubeCheck, by_state: Mapping[int, Interval]) -> Ends:
    """The ends of a box, as the tube takes them; [0, 0] for a state that nothing reads there."""
    ranges = [by_state.get(s, Interval(0.0, 0.0)) for s in check.states]
    return [r.low for r in ranges], [r.high for r in ranges]


def box_in_words(check: TubeCheck, box: Mapping[int, Interval]) -> str:
    """The names of a box's states with the range of each, in words."""
    names = check.problem.quantities.states
    return ", ".join(f"{names[s].name} in [{r.low:.4g}, {r.high:.4g}]" for s, r in box.items())


def way_back(check: TubeCheck, caller: Caller, box: Box, asked: Sequence[int]) -> LeadBackResult:
    """Finds out whether SC leads from `box` back into it in the states `asked`."""
    return _LeadBackSearch(check, caller, box, asked).search_result()


class _LeadBackSearch:
    """A search that asks the tube about one box and about parts of this box."""

    def __init__(self, check: TubeCheck, caller: Caller, box: Box, asked: Sequence[int]) -> None:
        self._check, self._caller, self._box, self._asked = check, caller, box, asked
        self._cut = [*asked, *check.turning]
        self._name = check.problem.name
        self._rooms = {s: cut_to_farthest(check.rooms[s]) for s in asked}
        self._rests: tuple[int, Box] | None = None
        self._span: Box = {}
        """The ranges of all states on the last way that was tried, as far as it was followed."""

    def search_result(self) -> LeadBackResult:
        asked, ways = self._asked, {s: self._box[s] for s in self._asked}
        into = box_in_words(self._check, ways)
        runs = runs_from(self._check, self._box, asked) if asked else None
        if runs is not None and runs.astray:
            why = f"SC does not lead back into {into}: {self._run_in_words(runs.astray)}"
            announce(lambda: f"{self._name}: {why}")
            return self._result_with_other_box(why, runs.reached, runs.astray.state)
        todo, shown, tried, parts_max = [(self._box, 0, 1.0)], 0.0, 0, 1
        while todo:
            part, depth, share = todo.pop()
            tried += 1
            way = self._way(part, self._box) if depth else self.whole_way()
            if way is not None:
                shown += share
                ways = {s: _hull(ways[s], way[s]) for s in asked}
            elif depth == SPLITS or not asked or tried > parts_max:
                return self._result_of_failure(part, into, shown, tried, runs)
            else:
                todo += [(half, depth + 1, 0.5 * share) for half in self._halves(part)]
                if not depth:
                    announce(lambda: f"{self._name}: SC is not shown to lead back into {into} from "
                             "all of it at once; asked of parts")  # fmt: skip
                    self._choose_precision_for_parts()
                    affordable = self._caller.affordable // self._caller.operations("keeps")
                    parts_max = max(2 * SPLITS, affordable)
                    todo.append((self._smallest_last_part(), SPLITS, 0.0))  # counted with its whole
            phase(f"{self._name}: shown that SC leads back from {shown:.1%} of rest")
            share_done(shown)
        return LeadBackResult(ways)

    def _result_of_failure(
        self, part: Box, into: str, shown: float, tried: int, runs: RestRuns | None
    ) -> LeadBackResult:
        if self._rests is not None:
            self._check.precision, way = self._rests
            return LeadBackResult({s: _hull(self._box[s], way[s]) for s in self._asked})
        why = self._unshown_part_in_words(part, into, shown, tried)
        return self._result_with_other_box(why, {} if runs is None else runs.reached)

    def _result_with_other_box(
        self, why: str, reached: Box, astray: int | None = None
    ) -> LeadBackResult:
        """The result of a failed search, with another box that SC is shown to lead into, if any."""
        if other := self._other_box(reached):
            why += f"; into {box_in_words(self._check, other)} it is shown to lead"
        return LeadBackResult({}, why, astray, other)

    def _other_box(self, reached: Box) -> Box:
        """Another box that SC is shown to lead back into, from an estimate or from ends of runs."""
        phase(f"{self._name}: whether SC leads back into another rest")
        around = {s: self._box[s] for s in self._asked}
        for other in islice(boxes_back_soon(self._check, around), ESTIMATED):
            search = _LeadBackSearch(self._check, self._caller, other, self._asked)
            inside = all(
                _cut_to_room(other[s], room) == other[s] for s, room in self._rooms.items()
            )
            with suppress(TooLongError, SoterError):
                if inside and search.whole_way() is not None:
                    return other
        if not reached or not all(abs(r.low) < inf > abs(r.high) for r in reached.values()):
            return {}
        for factor in LARGER:
            larger = {
                s: _cut_to_room(_enlarged_interval(_hull(self._box[s], r), factor), self._rooms[s])
                for s, r in reached.items()
            }
            if self._way({**self._box, **larger}, {**self._box, **larger}) is not None:
                return larger
        return {}

    def _smallest_last_part(self) -> Box:
        """The smallest part that would come last; the search ends at once if that one fails."""
        part = self._box
        for _ in range(SPLITS):
            part = self._halves(part)[-1]
        return part

    def _choose_precision_for_parts(self) -> None:
        """Chooses the first precision that shows the smallest last part, `PLAIN` if none does."""
        part = self._smallest_last_part()
        for precision in range(PLAIN, len(PRECISIONS)) if self._check.answers_vary else ():
            with suppress(TooLongError, SoterError):
                if self._way_with_precision(precision, part) is not None:
                    return
        self._way_with_precision(PLAIN, part)

    def whole_way(self) -> Box | None:
        """The way from the whole box by the first precision that shows both rest and the start.

        If none does, it is by the first that shows rest and, if runs are collected, the start.
        `_rests` keeps the first that shows only rest, with its way: it is the result if parts
        fail, too, as a start may lie outside the area that a map calls free. Several steps a
        command are tried only if one shows no rest, and where states are quick.
        """
        for precision in range(len(PRECISIONS)) if self._check.answers_vary else ():
            if precision == FINE and (self._rests or not moves_quickly(self._check)):
                break
            with suppress(TooLongError, SoterError):  # it does not fit into a step, or into forms
                way = self._way_with_precision(precision, self._box)
                if way is not None and _is_start_shown(self._check, way):
                    return way
                self._rests = self._rests or (None if way is None else (precision, way))
        if self._rests is not None:
            self._check.precision, way = self._rests
            if is_start_collected(self._check, way):
                return way
        return self._way_with_precision(PLAIN, self._box)

    def _way_with_precision(self, precision: int, part: Box) -> Box | None:
        check = self._check
        check.precision = precision
        if precision != PLAIN:
            check.decision_cost()
        self._caller = CompiledCaller(check.offline_text({}))
        return self._way(part, self._box)

    def _way(self, part: Box, box: Box) -> Box | None:
        """The range of each state on the way from `part` back into `box`; None if not shown."""
        moving = {s: Interval(-inf, inf) for s in self._check.states if s not in self._asked}
        way, end = ({**moving, **{s: of[s] for s in self._asked}} for of in (self._rooms, box))
        led = self._caller.result("keeps", *(box_ends(self._check, b) for b in (part, way, end)))
        if led is None:
            self._span = {}
            return None
        self._span = {s: Interval(*r) for s, *r in zip(self._check.states, *led[1], strict=True)}
        return self._span if led[0] else None

    def _halves(self, part: Box) -> list[Box]:
        """The two halves of a part, cut in the state with the longest side relative to the box."""
        sides = {s: self._box[s].high - self._box[s].low for s in self._asked}
        sides |= dict.fromkeys(self._check.turning, 1.0)  # a sine is no line over much more
        longest = max(
            self._cut, key=lambda s: (part[s].high - part[s].low) / sides[s] if sides[s] else 0.0
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

    def _unshown_part_in_words(self, part: Box, into: str, shown: float, tried: int) -> str:
        sides = {s: part[s] for s in self._cut}
        text = f"SC does not certainly lead back into {into}"
        if not sides:
            return text
        from_ = box_in_words(self._check, sides)
        where = f"not from {from_} ({tried} part{'s' * (tried > 1)} asked)"
        where += self._unknown_past_in_words()
        where += f"; on the way there is {self._caller.fault}" if self._caller.fault else ""
        where += self._widest_in_words({s: part[s] for s in self._asked})
        return f"{text}: shown of {shown:.1%} of it, {where}"

    def _unknown_past_in_words(self) -> str:
        """Words about reads of states without a bound; "" where the tube had bounds."""
        if all(r.low <= r.high for r in self._span.values()):
            return ""
        oldest = show_ns(self._check.times.delay)
        return f"; nothing bounds how states moved in the {oldest} before, of which SC may read"

    def _widest_in_words(self, part: Box) -> str:
        """Words on the state with the widest range on the way, relative to the box."""
        widths = {s: self._box[s].high - self._box[s].low for s in part if s in self._span}
        times = {
            s: (self._span[s].high - self._span[s].low) / w for s, w in widths.items() if w > 0.0
        }
        if not times or max(times.values()) <= 1.0:
            return ""
        widest = max(times, key=times.__getitem__)
        farthest = box_in_words(self._check, {widest: self._span[widest]})
        return f"; on the way there it may be {farthest}"


def _is_start_shown(check: TubeCheck, ways: Box) -> bool:
    initial = {s: check.problem.initial[s] for s in check.states}
    return CompiledCaller(check.offline_text(ways)).returns_true("starts", box_ends(check, initial))


def is_control_given(check: TubeCheck, ways: Box) -> bool:
    """Whether the check of the DM lets AC have control in the middle of where a run may start."""
    first_map = check.problem.first_map
    estimate = [middle(check.problem.initial[s]) for s in check.states]
    caller = CompiledCaller(check.offline_text(ways))
    return caller.returns_true("good", estimate, *[first_map] * bool(first_map))


def choose_precision_that_gives_control(check: TubeCheck, ways: Box) -> bool:
    """Whether AC has control at the start by a higher precision; chooses the first such.

    What is shown of SC does not depend on how precisely the DM follows SC afterwards.
    """
    shown_by = check.precision
    for precision in range(shown_by + 1, len(PRECISIONS)):
        check.precision = precision
        with suppress(TooLongError, SoterError):
            check.decision_cost()
            if _is_start_shown(check, ways) and is_control_given(check, ways):
                return True
    check.precision = shown_by
    return False


def is_start_collected(check: TubeCheck, ways: Box) -> bool:
    """Whether the start is shown with runs collected at a kink; sets `kink` to the first such."""
    for kink in kinks_of(check.law):
        check.kink = kink
        with suppress(TooLongError):
            if _is_start_shown(check, ways):
                return True
    check.kink = None
    return False


def _hull(a: Interval, b: Interval) -> Interval:
    return Interval(min(a.low, b.low), max(a.high, b.high))


def _enlarged_interval(a: Interval, factor: float) -> Interval:
    m, half = middle(a), 0.5 * (a.high - a.low) * factor
    return Interval(m - half, m + half)


def _cut_to_room(a: Interval, room: Interval) -> Interval:
    return Interval(max(a.low, room.low), min(a.high, room.high))

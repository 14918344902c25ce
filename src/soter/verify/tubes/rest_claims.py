"""What is shown of a module with `rest` before anything flies.

Purpose: `shown`: a box around where `rest` holds that SC keeps (rule 1 of "Decisions by tubes" in
docs/proof.md), what SC answers on all that it may read, what `moves` says, and the start; each by
the tube of `rest.soter`.
Non-goals: verdicts (`verify.py`), the check in flight.
"""

from __future__ import annotations

import contextlib
import json
from dataclasses import asdict, dataclass, field
from math import isfinite
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import phase
from soter.language.check.step_cost import MAX_OPERATIONS
from soter.language.model.durations import show_ns
from soter.verify.problem.problem import Interval
from soter.verify.tubes.generated_functions import Caller, TooLongError
from soter.verify.tubes.leading_back import ends, led_back, told
from soter.verify.tubes.problem import FARTHEST, is_far, reached, refused
from soter.verify.tubes.rest_drift import undrifted
from soter.verify.tubes.tube_check import PLAIN

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from soter.diagnostics.diagnostic import SoterError
    from soter.verify.tubes.tube_check import TubeCheck

    Progress = Callable[[float], None]

HALVINGS = 12


@dataclass
class RestClaims:
    """What was found; a text where something is not shown, "" where it is.

    `ways`: Y, by state, of those that `moves` does not name. `box`: B. `cut`: that of the tubes
    that show it, and of the check that flies. `astray`: no younger read helps.
    """

    box: dict[int, Interval] = field(default_factory=dict)
    ways: dict[int, Interval] = field(default_factory=dict)
    answers: str = ""
    kept: str = ""
    astray: bool = False
    moves: str = ""
    start: str = ""
    cut: int = PLAIN

    def write(self, path: Path) -> None:
        """As JSON; the ends of ranges as they are."""
        path.write_text(json.dumps(asdict(self)), encoding="utf-8")

    @classmethod
    def read(cls, path: Path) -> RestClaims:
        """What was written."""
        told = json.loads(path.read_text(encoding="utf-8"))
        for name in ("box", "ways"):
            told[name] = {int(s): Interval(**r) for s, r in told[name].items()}
        return cls(**told)


def shown(check: TubeCheck, progress: Progress | None = None) -> RestClaims:
    """All of it, in turn: what is not shown leaves out what rests on it.

    `SoterError` R007 where the check takes more operations than a step may.
    """
    claims = RestClaims()
    if check.times.switches < 1:
        claims.kept = claims.start = "`within` of `rest` is shorter than a period of SC"
        return claims
    try:
        caller = Caller(check.offline({}))
    except TooLongError:
        raise too_long(check) from None
    claims.answers = _answers(check, caller)
    claims.kept = claims.answers or _kept(check, caller, claims, progress)
    claims.cut = check.cut
    if not claims.kept:
        phase(f"{check.problem.name}: how far SC moves what `moves` names")
        at = {s: claims.ways.get(s, check.rooms[s]) for s in check.states}
        unread = Interval(0.0, 0.0)  # without a set: `_kept` has seen that nothing reads it
        at = {s: r if isfinite(r.high - r.low) else unread for s, r in at.items()}
        claims.moves = undrifted(check, caller, at, claims.box)
    phase(f"{check.problem.name}: whether SC leads to rest from the start")
    claims.start = claims.kept or _starts(check, Caller(check.offline(claims.ways)))
    return claims


def too_long(check: TubeCheck) -> SoterError:
    """R007 with what would fit: operations grow by as many with each step of SC that is followed.

    Of three, as there is more in a text of more than one.
    """
    times = check.times
    needs, fits = "", 0
    with contextlib.suppress(TooLongError):
        two, three = (check.operations(n) for n in (2, 3))
        needs = f" takes {two + (times.switches - 2) * (three - two):.2g} operations, which"
        fits = max((MAX_OPERATIONS - two) // (three - two) + 2, 0)
    why = (
        f"to follow {times.switches} steps of SC{needs} is more than a step of the DM can do: "
        f"{MAX_OPERATIONS:.2g} operations"
    )
    longest = show_ns(fits * times.period + times.jitter).replace(" ", "")
    fewer = "a longer period of SC, of which there are fewer steps then"
    within = f"`within {longest}` at most, {fits} steps of SC"
    return refused(check.problem, why, (within, fewer) if fits else (fewer, "fewer states"))


def _name(check: TubeCheck, state: int) -> str:
    return check.problem.quantities.states[state].name


def _without_set(check: TubeCheck, states: Sequence[int]) -> str:
    """A state without a set among these; "": all have one."""
    rooms = check.rooms
    return next((_name(check, s) for s in states if not isfinite(rooms[s].high - rooms[s].low)), "")


def _answers(check: TubeCheck, caller: Caller) -> str:
    """SC faults on nothing that it may read, and publishes what its topics may hold."""
    sets = {s: reached(check.read_sets[s]) for s in check.read_by_law}
    if caller.holds("answers", ends(check, sets)):
        return ""
    return "on something in the sets of what it reads SC may fault, or publish what is outside"


def _kept(check: TubeCheck, caller: Caller, claims: RestClaims, progress: Progress | None) -> str:
    """Rule 1."""
    problem = check.problem
    own = [s for s in check.states if s not in problem.drifts]
    moving = [s for s in check.states if s in problem.drifts]
    read = check.read_by_law | check.read_by_rates | check.read_by_rest
    if name := _without_set(check, [s for s in moving if s in read]):
        return f"{name} moves, is read, and nothing bounds it (a set of its topic would)"
    sets = {s: reached(check.rooms[s]) for s in check.states if s in read or s in own}
    box = _around_rest(check, caller, sets, own)
    if box is None:
        return "`rest` holds nowhere in the sets of what it reads"
    claims.box = {s: box[s] for s in own}
    led = led_back(check, caller, box, own, progress)
    claims.ways, claims.astray = led.ways, led.astray
    return led.why


def _around_rest(
    check: TubeCheck, caller: Caller, sets: dict[int, Interval], own: Sequence[int]
) -> dict[int, Interval] | None:
    """A box outside of which `rest` certainly does not hold; None where it holds nowhere."""
    box = dict(sets)
    if caller.holds("never_rests", ends(check, box)):
        return None
    for s in own:
        box[s] = _nearer(check, caller, box, s)
        for upper in (False, True):
            box[s] = _shaved(check, caller, box, s, upper=upper)
    return box


def _nearer(check: TubeCheck, caller: Caller, box: dict[int, Interval], s: int) -> Interval:
    """A side without a set, moved in by powers of ten as far as that shows."""
    low, high = box[s].low, box[s].high
    if not is_far(check.rooms[s]):
        return box[s]
    for end in (10.0**k for k in range(99, -10, -1)):
        beyond = (Interval(low, -end), Interval(end, high))
        if not all(caller.holds("never_rests", ends(check, {**box, s: r})) for r in beyond):
            break
        low, high = -end, end
    return Interval(low, high)


def _shaved(
    check: TubeCheck, caller: Caller, box: dict[int, Interval], s: int, *, upper: bool
) -> Interval:
    """One end of a side moved in as far as bisection shows."""
    low, high = box[s].low, box[s].high
    outer, inner = (high, low) if upper else (low, high)
    for _ in range(HALVINGS):
        middle = 0.5 * (outer + inner)
        off = Interval(middle, high) if upper else Interval(low, middle)
        if caller.holds("never_rests", ends(check, {**box, s: off})):
            outer = middle
        else:
            inner = middle
    return Interval(low, outer) if upper else Interval(outer, high)


def _starts(check: TubeCheck, caller: Caller) -> str:
    """Condition 6, of all states in which the plants may start."""
    initial = {s: check.problem.initial[s] for s in check.states}
    if any(map(is_far, initial.values())):
        return f"it is beyond {FARTHEST:g}"
    if caller.holds("starts", ends(check, initial)):
        return ""
    return f"from {told(check, initial)} SC is not certainly led to rest"

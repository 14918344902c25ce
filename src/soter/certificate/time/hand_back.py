"""How long after the state behind a hand-back SC keeps control again, from the definitions.

Purpose: `handed_back`: of a module below another one, from the state on which that one gives
control back to the instant from which all that acts is SC's, on states that are no older.
Non-goals: where that state is (`handover.py`).

The module above said "SC" before: what SC publishes is dropped until the verdict is in force. It is
released at r, on a state of r - A or later, and in force `slow` later at most; in one instant SC
may come first. Of the states before that one nothing is known, and a command of SC answers a state
that is d old: so SC's run begins with the first output that acts d or more after that state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.time.derived_times import Clock, releases

if TYPE_CHECKING:
    from soter.certificate.time.derived_times import DerivedTimes, TimingSetting


def handed_back(setting: TimingSetting, own: DerivedTimes, above: Clock, age: int) -> int:
    """In ns, the greatest over all schedules.

    `above`: the DM of the module above; `age`: A of it, in ns. NotRecheckedError where there are
    too many releases to go through.
    """
    worst = own.start
    settled = setting.settled + above.phase + 2 * above.period
    for r in releases(above, setting.periods, after=settled):
        passes = setting.sc.next_at(r + above.slow + 1)
        worst = max(worst, age + setting.acts_by(passes) - r)
    for t in setting.steady():
        before = min(effect.first(t) for effect in setting.effects)
        worst = max(worst, own.delay + setting.acts_by(t + setting.sc.period) - before)
    return worst

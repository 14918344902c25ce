"""The picture of where SC would lead, of each module with `rest` of a traced run.

Purpose: which looks are drawn, and each as the page's record.
Non-goals: boxes (`led_looks.py`), drawing (`report/run/led_picture.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.report.run.led_picture import LedLook, LedPicture
from soter.report.run.result_wording import prose
from soter.simulate.decided_instants import decided_at
from soter.simulate.outputs.led_looks import looks_of

if TYPE_CHECKING:
    from soter.language.model.system import Module
    from soter.simulate.outputs.led_looks import LedLooks
    from soter.simulate.result import Run

LOOKS_MAX = 120
"""Of a module on one page; those that took control are among them."""
JUDGED = " (after the commands that might act at this look)"


def led_of_run(run: Run) -> tuple[LedPicture, ...]:
    """Of each module; none where steps are in any order, or no compiler of C is there."""
    looks = None if run.system.shuffled else looks_of(run.system)
    if looks is None:
        return ()
    pictures = (_picture(run, looks, m) for m in looks.modules)
    return tuple(p for p in pictures if p.looks)


def _picture(run: Run, looks: LedLooks, m: Module) -> LedPicture:
    trace = run.require_trace()
    mode, stale = (trace["modules"][name][:, m.index] for name in ("mode", "stale"))
    rows = np.flatnonzero(decided_at(run.system, trace)[:, m.index] & (stale == 0))
    rows = rows[rows > 0]  # what was read is of two states
    lost = rows[(mode[rows - 1] == 1) & (mode[rows] == 0)][:LOOKS_MAX]
    even = np.linspace(0, len(rows) - 1, min(LOOKS_MAX, len(rows)) - len(lost)).astype(np.intp)
    drawn = []
    for row in np.union1d(rows[even], lost):
        states = trace[row - 1].tobytes(), trace[row].tobytes()
        led = looks.of(m.index, *states, judged=bool(mode[row - 1]))
        of = JUDGED if m.shield is not None and mode[row - 1] else ""
        if len(led.boxes):
            time_s = float(trace["header"]["ct"][row]) / 1e9
            drawn.append(LedLook(time_s, led.boxes, prose(looks.told(m, led) + of)))
    return LedPicture(m.name, looks.names[m.index], looks.units[m.index], tuple(drawn), len(rows))

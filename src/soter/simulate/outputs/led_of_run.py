"""The picture of where SC would lead, of each module with `rest` of a traced run.

Purpose: which looks are drawn, and each as the page's record.
Non-goals: boxes (`simulate/led_looks.py`), drawing (`report/run/led_picture.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.diagnostic import SoterError
from soter.report.run.led_picture import BY_SC, FAILED, FREE, LedLook, LedPicture
from soter.simulate.decided_instants import decided_at
from soter.simulate.led_looks import LedLooks, followed

if TYPE_CHECKING:
    from soter.language.model.system import Module
    from soter.simulate.led_looks import Led
    from soter.simulate.result import Run

LOOKS_MAX = 120
"""Of a module on one page; those that took control come first."""


def led_of_run(run: Run) -> tuple[LedPicture, ...]:
    """Of each module; none where steps are in any order, or no compiler of C is there."""
    if run.system.shuffled or not followed(run.system):
        return ()
    try:
        looks = LedLooks(run.system)
    except SoterError:
        return ()
    pictures = (_picture(run, looks, m) for m in looks.modules)
    return tuple(p for p in pictures if p.looks)


def _picture(run: Run, looks: LedLooks, m: Module) -> LedPicture:
    trace = run.require_trace()
    own = trace["modules"][:, m.index]
    rows = np.flatnonzero(decided_at(run.system, trace)[:, m.index] & (own["stale"] == 0))
    rows = rows[rows > 0]  # what was read is of two states
    lost = rows[(own["mode"][rows - 1] == 1) & (own["mode"][rows] == 0)][:LOOKS_MAX]
    even = np.linspace(0, len(rows) - 1, min(LOOKS_MAX, len(rows)) - len(lost)).astype(np.intp)
    drawn = []
    for row in np.union1d(rows[even], lost):
        before, at = trace[row - 1].tobytes(), trace[row].tobytes()
        in_ac = bool(own["mode"][row - 1])
        led = looks.of(m.index, before, at, judged=in_ac)
        boxes = [(FREE + b.by_sc * BY_SC, b) for b in led.boxes]
        if led.at is not None:
            boxes.append((FAILED, led.at))
        if boxes:
            told = looks.why_not(m, led) or _rests(led)
            each = [
                [kind, b.from_s, b.to_s, *(x for ends in zip(b.low, b.high, strict=True) for x in ends)]
                for kind, b in boxes
            ]
            drawn.append(LedLook(float(trace["header"]["ct"][row]) / 1e9, np.array(each), told))
    units = tuple(looks.units[m.index])
    return LedPicture(m.name, tuple(looks.names[m.index]), units, tuple(drawn), len(rows))


def _rests(led: Led) -> str:
    until = max(b.to_s for b in led.boxes)
    return f"SC would be at rest {until:.3g} s after the estimate at the latest"

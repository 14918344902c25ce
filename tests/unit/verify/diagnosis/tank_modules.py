"""A tank whose level SC holds, and ways to spoil it; what is found about them.

x = level, x' = pump - leak: solutions are straight lines between commands, so every claim can be
computed again here without the engine.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING
from unittest.mock import patch

import numpy as np

from soter.language.front_end import check_file
from soter.verify.chosen_modules import modules_of, problems_of
from soter.verify.diagnosis import open_claims
from soter.verify.diagnosis.tried_remedies import mark_untried
from soter.verify.verify_module import verify_module

if TYPE_CHECKING:
    from soter.verify.claims.results import Cause, LeavingRun, ModuleResult

TANK = """soter 1;
topic level: float max_age 100ms;
topic pump: float in [-0.1, 0.1] = 0.0;
plant Tank period 50ms {
  reads pump;
  drives level = h;
  state h: float = 1.0;
  disturbance leak: float in [0.0, 0.02];
  der h = pump - leak;
  measured level within 0.01;
}
node Learned period 100ms { subscribes level; publishes pump; step { publish pump = 0.1; } }
node Hold period 100ms {
  subscribes level;
  publishes pump;
  step { publish pump = clamp(0.5 * (1.0 - level), -0.1, 0.1); }
}
rta SafeTank {
  ac Learned; sc Hold; period 100ms;
  safe level > 0.2 && level < 1.8;
  ttf level < 0.25 || level > 1.75;
  safer level > 0.4 && level < 1.6;
  verify { grid level in [0.2, 1.8] / 320; }
}
system Plant { t: Tank; module SafeTank; until 60s; }
"""
STEP, DELAY = 0.1, 0.1
"""delta, and d: the age of what SC reads."""
LOW, HIGH = 0.2, 1.8


def changed(*pairs: tuple[str, str], text: str = TANK) -> str:
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text


def explained(text: str) -> ModuleResult:
    """Verified without a search for counterexamples, with causes, however busy the machine is."""
    checked = check_file("tank.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    (problem,) = problems_of(modules_of(checked, None, None, {}))
    with patch.multiple(open_claims, BACK_S=60.0, RUNS_S=60.0, HABIT_S=60.0, CHANGED_S=60.0):
        return mark_untried(verify_module(problem, refute=False, explain=True))


def kinds(module_result: ModuleResult, claim: str) -> list[str]:
    return [c.kind for c in module_result.findings[claim].causes]


def cause(module_result: ModuleResult, claim: str, kind: str) -> Cause:
    (one,) = [c for c in module_result.findings[claim].causes if c.kind == kind]
    return one


def law(level: float, target: float = 1.0) -> float:
    return min(max(0.5 * (target - level), -0.1), 0.1)


def check_run(run: LeavingRun, leaks: tuple[float, float], error: float, target: float) -> None:
    """Every slope is a command on an estimate not older than declared, less a leak."""
    times, levels = run.time_s.tolist(), run.states[:, 0].tolist()
    assert times[0] == 0.0
    for k in range(1, len(times)):
        span = times[k] - times[k - 1]
        slope = (levels[k] - levels[k - 1]) / span
        oldest = times[k - 1] - STEP - DELAY - 1e-6
        read = [x for t, x in zip(times, levels, strict=True) if oldest <= t <= times[k]]
        read.append(float(np.interp(oldest, times, levels)))  # not every state is shown
        low = min(law(x + error, target) for x in read) - leaks[1]
        high = max(law(x - error, target) for x in read) - leaks[0]
        assert low - 1e-6 <= slope <= high + 1e-6, (k, slope, low, high)


def soonest(start: float, leak: float, error: float, target: float = 1.0) -> float:
    """When a tank with these leaves (LOW, HIGH), SC answering at once; brute force."""
    x, t = start, 0.0
    while LOW <= x <= HIGH and t < 1000.0:
        rate = law(x + error, target) - leak
        x, t = x + STEP * rate, t + STEP
    return t if t < 1000.0 else math.inf

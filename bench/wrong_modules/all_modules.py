"""All wrong modules.

Purpose: `WRONG`, kind by kind.
Non-goals: what they are (`timing.py` and its neighbours).
"""

from __future__ import annotations

from bench.wrong_modules.actuators import ACTUATORS, STALE
from bench.wrong_modules.controllers import CONTROLLERS
from bench.wrong_modules.faults import FAULTY
from bench.wrong_modules.order import ORDER
from bench.wrong_modules.paths import ESTIMATORS
from bench.wrong_modules.ranges import SETS
from bench.wrong_modules.systems import SYSTEMS
from bench.wrong_modules.timing import TIMING
from bench.wrong_modules.ways import WAYS

WRONG = (
    *TIMING,
    *CONTROLLERS,
    *FAULTY,
    *ORDER,
    *ESTIMATORS,
    *ACTUATORS,
    *STALE,
    *WAYS,
    *SYSTEMS,
    *SETS,
)

"""All wrong modules.

Purpose: `WRONG`, kind by kind.
Non-goals: what they are (`wrong_timing.py` and its neighbours).
"""

from __future__ import annotations

from bench.wrong_actuators import ACTUATORS, STALE
from bench.wrong_controllers import CONTROLLERS
from bench.wrong_faults import FAULTY
from bench.wrong_order import ORDER
from bench.wrong_paths import ESTIMATORS
from bench.wrong_ranges import SETS
from bench.wrong_systems import SYSTEMS
from bench.wrong_timing import TIMING
from bench.wrong_ways import WAYS

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

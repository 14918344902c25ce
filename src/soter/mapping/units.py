"""The units that a mapping may say, and what makes SI of each.

Purpose: one table.
Non-goals: which quantity of a message is in which unit (`standard_units.py`); units of a program,
which are any text.
"""

from __future__ import annotations

import math

TIME_UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
UNITS = {
    "m": 1.0,
    "km": 1000.0,
    "cm": 0.01,
    "mm": 0.001,
    "ft": 0.3048,
    "m/s": 1.0,
    "km/h": 1.0 / 3.6,
    "cm/s": 0.01,
    "mm/s": 0.001,
    "kn": 1852.0 / 3600.0,
    "ft/s": 0.3048,
    "m/s^2": 1.0,
    "g": 9.80665,
    "rad": 1.0,
    "deg": math.pi / 180.0,
    "rad/s": 1.0,
    "deg/s": math.pi / 180.0,
    "%": 0.01,
    "1": 1.0,
}
"""What a column may be in, and what makes SI of it."""

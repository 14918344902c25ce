"""The units that a mapping or a program may say, and what makes SI of each.

Purpose: one table: a factor, and the dimension, so that no length is taken for a speed.
Non-goals: which quantity of a message is in which unit (`standard_units.py`).
"""

from __future__ import annotations

import math

TIME_UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}

NUMBER, LENGTH, ANGLE = "a number", "a length", "an angle"
SPEED, TURN, ACCELERATION = "a speed", "an angular speed", "an acceleration"
_BY_DIMENSION = {
    LENGTH: {"m": 1.0, "km": 1000.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "ft": 0.3048},
    SPEED: {
        "m/s": 1.0,
        "km/h": 1.0 / 3.6,
        "dm/s": 0.1,
        "cm/s": 0.01,
        "mm/s": 0.001,
        "kn": 1852.0 / 3600.0,
        "ft/s": 0.3048,
    },
    ACCELERATION: {"m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3},
    ANGLE: {
        "rad": 1.0,
        "deg": math.pi / 180.0,
        "cdeg": math.pi / 18000.0,
        "degE5": math.pi / 180.0e5,
        "degE7": math.pi / 180.0e7,
    },
    TURN: {
        "rad/s": 1.0,
        "mrad/s": 1e-3,
        "deg/s": math.pi / 180.0,
        "ddeg/s": math.pi / 1800.0,
    },
    NUMBER: {"%": 0.01, "d%": 0.001, "c%": 0.0001, "1": 1.0},
    "a length of time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "an angular acceleration": {"rad/s^2": 1.0, "deg/s^2": math.pi / 180.0},
    "a force": {"N": 1.0},
    "a torque": {"Nm": 1.0},
    "a mass": {"kg": 1.0},
    "a voltage": {"V": 1.0, "mV": 1e-3},
    "a current": {"A": 1.0, "cA": 0.01, "mA": 1e-3},
    "a pressure": {"Pa": 1.0, "hPa": 100.0, "kPa": 1000.0},
    "a field strength": {"T": 1.0},
}
UNITS = {unit: factor for units in _BY_DIMENSION.values() for unit, factor in units.items()}
"""What a column may be in, and what makes SI of it."""
DIMENSIONS = {unit: name for name, units in _BY_DIMENSION.items() for unit in units}
"""What is measured in a unit, in words."""
RATES = {LENGTH: SPEED, SPEED: ACCELERATION, ANGLE: TURN, TURN: "an angular acceleration"}
"""How fast something changes, as far as it has a unit here."""


def factor_between(given: str, declared: str) -> float | None:
    """What turns a number in the unit `given` into one in `declared`; None where nothing does.

    A program without a unit ("") counts in SI. What is not in UNITS (`m^2`, `Ah`) is not turned: it
    goes into the same unit, or, as it is, into none.
    """
    if declared == given:
        return 1.0
    if not declared:
        return UNITS.get(given, 1.0)
    if given not in UNITS or DIMENSIONS.get(declared) != DIMENSIONS[given]:
        return None
    return UNITS[given] / UNITS[declared]

"""From one frame of axes into another: which component becomes which, and its sign.

Purpose: north-east-down and east-north-up of the world, forward-right-down and forward-left-up of a
body (REP 103), for vectors.
Non-goals: turning quaternions and covariances; transforms between places.
"""

from __future__ import annotations

WORLD, BODY = ("ENU", "NED"), ("FLU", "FRD")
FRAMES = (*WORLD, *BODY)
BODY_OF = {"ENU": "FLU", "NED": "FRD"}
"""The frame of a body that goes with one of the world."""

Turn = tuple[tuple[int, float], tuple[int, float], tuple[int, float]]
"""Of each axis: which component of the other frame it is, and its sign."""

SAME: Turn = ((0, 1.0), (1, 1.0), (2, 1.0))
_WORLD_TURN: Turn = ((1, 1.0), (0, 1.0), (2, -1.0))
_BODY_TURN: Turn = ((0, 1.0), (1, -1.0), (2, -1.0))


def turn_between(given: str, program: str) -> Turn:
    """From a frame of FRAMES into the program's, one of WORLD; both ways it is the same."""
    if given in WORLD:
        return SAME if given == program else _WORLD_TURN
    return SAME if given == BODY_OF[program] else _BODY_TURN

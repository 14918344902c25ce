"""All wrong modules.

Purpose: `WRONG`, kind by kind.
Non-goals: what they are (`wrong_timing.py` and its neighbours).
"""

from __future__ import annotations

from bench.wrong_controllers import CONTROLLERS

WRONG = (*CONTROLLERS,)

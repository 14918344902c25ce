"""Reinforcement learning behind a runtime-assurance module: Gymnasium environments.

Purpose: `Protected` and `make_protected` put the module of any Soter program between an agent
and its environment (docs/gym.md).
Non-goals: learning; anything that Gymnasium has already. Needs the extra `soter[gym]`.
"""

from __future__ import annotations

from soter.gym.protected import Protected, make_protected

__all__ = ["Protected", "make_protected"]

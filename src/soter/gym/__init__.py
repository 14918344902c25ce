"""Reinforcement learning behind a runtime-assurance module: Gymnasium environments.

Purpose: `Protected` and `make_protected` put the module of any Soter program between an agent
and its environment (docs/gym.md).
Non-goals: learning; anything that Gymnasium has already. Needs the extra `soter[gym]`.
"""

from __future__ import annotations

try:
    import gymnasium as _gymnasium  # noqa: F401 - asked for here, so that the message says what to do
except ImportError as error:
    raise ImportError("soter.gym needs gymnasium: pip install 'soter[gym]'") from error

from soter.gym.protected import Protected, make_protected

__all__ = ["Protected", "make_protected"]

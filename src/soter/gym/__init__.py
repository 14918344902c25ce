"""Reinforcement learning behind a runtime-assurance module: Gymnasium environments.

Purpose: `Protected`, `SafetyWrapper` and `make_protected` put the module of any Soter program
between an agent and its environment; `ProtectedVector` and `make_vec` step thousands of worlds of a
program in one call, `make_sb3_vec` for Stable-Baselines3; `conformance` compares an environment
with the plant of a proof (docs/gym.md).
Non-goals: learning; anything that Gymnasium has already. Needs the extra `learn`.

In reading order:
- `environment_choices.py` finds the module, plant and topics that an environment is about.
- `compiled_system.py` compiles the system once for all environments; a `Session` of `session.py`
  steps that C, and stops where agent or plant has to answer.
- `array_mapping.py` turns arrays of Gymnasium into values of the program, and back.
- `guard.py` carries actions and observations between agent, module and environment; `step_info.py`
  says in `info` what the module did.
- `protected.py` has the environments that agents step, `vector.py` those of thousands of worlds.
- `plant_model.py` finds steps that the plant of the proof cannot explain; `safety_warnings.py`
  warns of runs about which a proof says nothing; `plant_conformance.py` measures an environment.
"""

from __future__ import annotations

from soter.version import pip_command

try:
    import gymnasium as _gymnasium  # noqa: F401 - asked for here, so that the message says what to do
except ImportError as error:
    raise ImportError(f"soter.gym needs gymnasium: {pip_command('learn')}") from error

from soter.gym.plant_conformance import Conformance, conformance
from soter.gym.protected import Protected, SafetyWrapper, make_protected, make_sb3_vec
from soter.gym.safety_warnings import SafetyWarning
from soter.gym.vector import ProtectedVector, make_vec

__all__ = [
    "Conformance",
    "Protected",
    "ProtectedVector",
    "SafetyWarning",
    "SafetyWrapper",
    "conformance",
    "make_protected",
    "make_sb3_vec",
    "make_vec",
]

"""The learned advanced controller: a small network whose weights train.py wrote.

Purpose: the extern `Learned` of cliff.soter, and the same policy for training: 2-8-1, tanh.
Non-goals: being safe. It is never asked for anything but a good score.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from types import SimpleNamespace

    from numpy.typing import NDArray

WEIGHTS = Path(__file__).with_name("policy.json")
HIDDEN = 8
SIZE = 4 * HIDDEN + 1
"""Weights of x, of v and biases of the hidden layer, weights and bias of the output."""
X_MID, X_UNIT, V_UNIT = -0.3, 0.9, 0.07
"""Centre of the track and half its length; the greatest speed."""


class Policy:
    """force = tanh(w . tanh(a x + b v + c) + d), in [-1, 1]."""

    def __init__(self, weights: NDArray[np.float64] | None = None) -> None:
        flat = read_weights() if weights is None else weights
        rows = np.asarray(flat[: 4 * HIDDEN]).reshape(4, HIDDEN).tolist()
        self._neurons = list(zip(*rows, strict=True))
        self._bias = float(flat[-1])

    def force(self, x: float, v: float) -> float:
        """The throttle at a position (m) and speed (m a step)."""
        p, q = (x - X_MID) / X_UNIT, v / V_UNIT
        total = self._bias
        for a, b, c, w in self._neurons:
            total += w * math.tanh(a * p + b * q + c)
        return math.tanh(total)

    def step(self, inputs: SimpleNamespace) -> float:
        """The extern's step."""
        return self.force(inputs.car.x, inputs.car.v)

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The same for Gymnasium."""
        force = self.force(float(observation[0]), float(observation[1]))
        return np.array([force], dtype=np.float32)


def read_weights(path: Path = WEIGHTS) -> NDArray[np.float64]:
    """The weights in a file."""
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return np.array(document["weights"])


def write_weights(weights: NDArray[np.float64], facts: dict[str, Any], path: Path) -> None:
    """Write weights with what is known about them; numbers in the shortest exact form."""
    document = {**facts, "weights": [float(w) for w in weights]}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")

"""The types of arrays of numpy that annotations name, of any shape.

Purpose: one name for each, to be imported where types are checked.
Non-goals: arrays of the re-checker, which has names of its own.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Bools: TypeAlias = NDArray[np.bool_]
Bytes: TypeAlias = NDArray[np.uint8]
Floats: TypeAlias = NDArray[np.float64]
Words: TypeAlias = NDArray[np.uint64]

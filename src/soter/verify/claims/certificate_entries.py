"""What the entries of all groups in a certificate are made of.

Purpose: arrays and axes as files.
Non-goals: a group's own sets (`verify/grid/certificate_entry.py`,
`verify/polytope/certificate_entry.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.verify.problem.problem import Group, Problem


def matrix(path: str, values: NDArray[Any], files: dict[str, bytes]) -> dict[str, object]:
    """Doubles, with their shape."""
    files[path] = np.ascontiguousarray(values, dtype="<f8").tobytes()
    return {"file": path, "shape": list(values.shape)}


def axes(problem: Problem, group: Group, stem: str, files: dict[str, bytes]) -> dict[str, Any]:
    """What kind of group it is, and its breakpoints."""
    entry: dict[str, Any] = {"kind": group.representation, "axes": []}
    for k, axis in enumerate(group.axes):
        name = f"{stem}_axis{k}.bin"
        files[name] = np.array(axis.edges, dtype="<f8").tobytes()
        entry["axes"].append({"state": problem.quantities.states[axis.state].name, "edges": name})
    return entry

"""A polytope group in a certificate.

Purpose: its sets as half-spaces, and the multipliers of every claim.
Non-goals: checking them (`soter recheck`).
"""

from __future__ import annotations

from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.verify.claims.certificate_entries import axes, matrix
from soter.verify.polytope.half_spaces import Polytope
from soter.verify.polytope.linear_group import free_instants, hold_instants

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from soter.certificate.format.folder import Certificate
    from soter.verify.claims.results import PolytopePart
    from soter.verify.problem.problem import Problem


def half_spaces(stem: str, p: Polytope, files: dict[str, bytes]) -> dict[str, object]:
    """A box, and half-spaces with their thresholds last."""
    faces = np.concatenate([p.rows, p.bounds[:, None]], axis=1)
    box = np.stack([p.low, p.high])
    return {
        "box": matrix(f"{stem}_box.bin", box, files),
        "faces": matrix(f"{stem}_faces.bin", faces, files),
    }


def polytope_of(certificate: Certificate, given: Mapping[str, Any]) -> Polytope:
    """What `half_spaces` wrote; ValueError where a file is not of its shape."""
    box, faces = (
        np.frombuffer(certificate.plain(given[k]["file"]), "<f8").reshape(given[k]["shape"]).copy()
        for k in ("box", "faces")
    )
    return Polytope(box[0], box[1], faces[:, :-1].copy(), faces[:, -1].copy())


def entry(
    problem: Problem, part: PolytopePart, stem: str, files: dict[str, bytes]
) -> dict[str, object]:
    """Boxes (2, n), half-spaces (N, n + 1) with their thresholds last, and multipliers.

    Multipliers are triples (row, half-space, value) of a matrix of shape `of`: few are not zero.
    `law` and `instants` are what the multipliers presuppose; so is `flow`, where it is not linear.
    """
    made = axes(problem, part.group, stem, files)

    def array(name: str, values: NDArray[Any]) -> dict[str, object]:
        return matrix(f"{stem}_{name}.bin", values, files)

    def sparse(name: str, values: NDArray[Any]) -> dict[str, object]:
        at = np.nonzero(values)
        return {"of": list(values.shape), **array(name, np.stack([*at, values[at]], axis=1))}

    sets = part.sets
    if sets is None or part.model is None:  # nothing is claimed: a grid on which K is empty
        name = f"{stem}_K.bin"
        files[name] = bytes(prod(len(a.edges) - 1 for a in part.group.axes))
        return {**made, "kind": "grid", "K": name}
    law, times = part.model.law, problem.times
    made["C"] = array("C", np.array(part.limits).T)
    made["law"] = {
        "controls": [problem.quantities.controls[a].name for a in part.model.commands],
        "gain": array("law_gain", law.gain),
        "offset": array("law_offset", law.offset),
        "limits": array("law_limits", np.stack([law.low, law.high])),
    }
    linear = part.model.group
    if not part.model.covers_scheme:
        made["flow"] = {
            "A": array("flow_A", linear.state),
            "B": array("flow_B", linear.control),
            "c": array("flow_c", linear.drift[0]),
        }
    polytope_by_name = {"K": sets.core, "R": sets.free, "Q": sets.kept, "target": sets.target}
    made.update({k: half_spaces(f"{stem}_{k}", p, files) for k, p in polytope_by_name.items() if p})
    made["S"] = [half_spaces(f"{stem}_S{j}", p, files) for j, p in enumerate(sets.allowed)]
    made["G"] = [half_spaces(f"{stem}_G{j + 1}", p, files) for j, p in enumerate(sets.carried)]
    made["rates"] = {"K": array("K_rate", sets.rate), "Q": array("Q_rate", sets.kept_rate)}
    made["periods"] = sets.periods
    made["instants"] = {
        "hold": list(hold_instants(times.delta_sc)),
        "R": list(free_instants(times.horizon_ns)),
        "window": list(free_instants(times.decision)),
        "start": list(free_instants(times.start)),
    }
    made["multipliers"] = {
        name: [sparse(f"{name}_m{i}", m) for i, m in enumerate(record)]
        for name, record in part.multipliers.items()
    }
    return made

"""Entries of modules with `rest`, as a certificate has them, written by hand.

Purpose: `entry`: every constant that the re-checker derives of a program, B, Y and claims.
Non-goals: what `soter verify` writes (`verify/tubes/verify.py`).
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

from soter.certificate.reading.module_times import TIME_KEYS
from soter.certificate.tubes.rest_problem import read_rest_problem, shield_constants
from soter.language.front_end import check_file, system_to_prove

if TYPE_CHECKING:
    from soter.language.model.system import System

CLAIMS = {
    "P1a": "proved", "P1b": "proved", "P1c": "assumed", "P2a": "proved", "P2b": "assumed",
    "P3": "assumed", "ttf": "assumed", "safer": "assumed", "start": "proved",
}  # fmt: skip


def flat_of(text: str) -> System:
    """The only system of a program."""
    checked = check_file("module.soter", text)
    assert checked.program is not None, checked.diagnostics.items
    return system_to_prove(checked, next(iter(checked.systems)), {}, exact=False)


def entry(
    flat: System,
    box: dict[str, Any],
    ways: dict[str, Any],
    keeps: dict[str, list[str]] | None = None,
) -> dict[str, Any]:
    """Of its only module, with B and Y by names of states; `keeps`: ranges of what SC keeps."""
    problem = read_rest_problem(flat, flat.modules[0].name, keeps or {})
    facts, names = problem.facts, [s.name for s in problem.facts.states]
    judged = shield_constants(problem)
    inputs = (*facts.controls, *facts.disturbances, *facts.errors, *facts.others)
    return {
        "system": flat.name,
        "module": flat.modules[0].name,
        "plants": [c.name for c in facts.plants],
        "claims": dict(CLAIMS),
        "recover_ns": None,
        "times": {k: facts.times[k] for k in TIME_KEYS},
        "inputs": [
            {"name": x.name, "kind": x.kind, "low": x.low.hex(), "high": x.high.hex()}
            for x in inputs
        ],
        "rest": {
            "within_ns": problem.within_ns,
            "alpha_ns": problem.times.alpha,
            "switches": problem.times.switches,
            "reads": {
                problem.field_read(s): {"state": names[s], "within": problem.max_error(s).hex()}
                for s in problem.followed
            },
            "moves": {
                names[s]: [x.hex() if isfinite(x) else None for x in problem.drifts[s]]
                for s in problem.moving_states
            },
            "box": {n: [x.hex() for x in ends] for n, ends in box.items()},
            "ways": {n: [x.hex() for x in ends] for n, ends in ways.items()},
            **({"keeps": keeps} if keeps else {}),
            **({} if judged is None else {"shield": judged}),
        },
    }

"""A module that is followed by tubes, in a certificate.

Purpose: what is claimed of it, what of rest, and every constant that its check is made of.
Non-goals: checking it (`certificate/tubes/`).
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from soter.verify.claims.results import UNCLAIMED
from soter.verify.sets_certificate_entry import inputs_of, times_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.verify.problem.problem import Interval
    from soter.verify.tubes.verify import TubeResult


def entry(result: TubeResult, system: str, stem: str, files: dict[str, bytes]) -> dict[str, object]:
    """The module in a manifest; it has no files."""
    del stem, files
    problem, claims, check = result.problem, result.claims, result.check
    said = {n: f.verdict for n, f in result.findings.items() if n not in UNCLAIMED}
    said.pop("failsafe", None)  # none is declared: there is nothing to be claimed
    q, times = problem.quantities, check.times
    names = [s.name for s in q.states]
    errors = dict(zip(check.states, check.errors(), strict=True))
    return {
        "system": system,
        "module": problem.name,
        "plants": [c.name for c in problem.system.components if c.role == "plant"],
        "claims": said,
        "recover_ns": None,
        "times": times_of(problem.times),
        "inputs": [
            *inputs_of("control", q.controls, problem.controls),
            *inputs_of("disturbance", q.disturbances, problem.disturbances),
            *inputs_of("error", q.errors, problem.errors),
            *inputs_of("other", q.others, problem.others),
        ],
        "rest": {
            "within_ns": problem.within_ns,
            "alpha_ns": times.earliest,
            "switches": times.switches,
            "reads": {
                problem.leaf(s): {"state": names[s], "within": errors[s].hex()}
                for s in check.states
            },
            "moves": {
                names[s]: [_hex(d.below), _hex(d.above)]
                for s, d in problem.drifts.items()
                if s in check.states
            },
            "box": _ends(names, claims.box),
            "ways": _ends(names, claims.ways),
            **_shield(result),
        },
    }


def _shield(result: TubeResult) -> dict[str, object]:
    """How commands are judged, where they are."""
    problem, shield = result.problem, result.problem.module.shield
    if shield is None:
        return {}
    acted, any_command = problem.times.acted, result.check.times.any_command
    ns = {"acted_ns": acted, "any_command_ns": any_command}
    return {"shield": {"cells": shield.cells, **ns}}


def _ends(names: list[str], ranges: Mapping[int, Interval]) -> dict[str, list[str]]:
    return {names[s]: [r.low.hex(), r.high.hex()] for s, r in ranges.items()}


def _hex(length: float) -> str | None:
    """None: without end."""
    return length.hex() if isfinite(length) else None

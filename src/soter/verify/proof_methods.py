"""Writes the certificate entry of a module that is proved over sets of states.

Purpose: `module_entry` writes times, ranges, cases, claims and computed predicates of a module
proved over sets of states (docs/verification.md, section 4).
Non-goals: a group's own sets (`grid/claims.py`); methods that prove whole modules
(`verify_module.py`).
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from soter.certificate.proof_methods import parts_without_claim
from soter.certificate.reading.folder import OF_SETS
from soter.language.model.system import LEVELS_DEFAULT
from soter.verify.claims.results import PROVED, UNCLAIMED
from soter.verify.deploy.level_tables import pairs_of, tables_of_groups
from soter.verify.problem.problem import TUBES

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.verify.claims.results import CaseSets, ModuleResult
    from soter.verify.deploy.level_tables import LevelTable
    from soter.verify.problem.problem import Interval, Leaf, Problem


def module_entry(
    result: ModuleResult, system: str, stem: str, files: dict[str, bytes]
) -> dict[str, object]:
    """The module's entry in a manifest; the files that it names are added to `files`."""
    problem = result.problem
    plants = [c.name for c in problem.system.components if c.role == "plant"]
    claims = _claims_entry(result)
    recover = problem.recover_ns if claims.get("P2b") == PROVED else None
    proved = {n for n, v in claims.items() if v == PROVED}
    entry: dict[str, object] = {
        "system": system,
        "module": problem.name.removesuffix(f" as {problem.view}"),
        "plants": plants,
        "parameters": [{"name": p.name, "values": list(p.values)} for p in problem.parameters],
        **figures_entry(problem),
        "cases": _case_entries(problem, result.cases, f"{stem}_", files, proved),
        "claims": claims,
        "recover_ns": recover,
    }
    if problem.view:
        entry["view"] = problem.view
    if result.laws:
        entry["law"] = _case_entries(problem, result.laws, f"{stem}_law", files, {"P2a"})
    if problem.computed:
        entry["tables"] = _table_entries(result, stem, files)
    return entry


def _claims_entry(result: ModuleResult) -> dict[str, str]:
    """The verdict of each claim; the claim of a fail-safe law only if the module declares a law."""
    law = bool(result.problem.module.law)
    unclaimed = UNCLAIMED if law else (*UNCLAIMED, "failsafe")
    return {n: f.verdict for n, f in result.findings.items() if n not in unclaimed}


def figures_entry(problem: Problem) -> dict[str, object]:
    """The part of a module's entry that has times, ranges of inputs and the chosen levels.

    A proof by tubes has no grid, and then the states have no ranges.
    """
    q = problem.quantities
    states = [] if problem.kind == TUBES else inputs_entries("state", q.states, problem.states)
    entry: dict[str, object] = {
        "times": _times_entry(problem),
        "inputs": [
            *states,
            *inputs_entries("control", q.controls, problem.controls),
            *inputs_entries("disturbance", q.disturbances, problem.disturbances),
            *inputs_entries("error", q.errors, problem.errors),
            *inputs_entries("other", q.others, problem.others),
        ],
    }
    if around := sorted(q.turning):
        entry["wraps"] = [q.states[s].name for s in around]
    if problem.levels_open and problem.levels != LEVELS_DEFAULT:
        entry["levels"] = problem.levels
    return entry


def built_entry(
    problem: Problem, built: Sequence[LevelTable], files: dict[str, bytes]
) -> dict[str, object]:
    """Gives the part of a proof's entry from which a DM is built; adds its files to `files`."""
    names = [s.name for s in problem.quantities.states]
    made = [table.entry(names, f"sets/{k}", files) for k, table in enumerate(built)]
    if problem.kind == TUBES:
        return figures_entry(problem) | (made[0] if made else {"rest": None})
    return figures_entry(problem) | {"tables": made}


def _table_entries(
    result: ModuleResult, stem: str, files: dict[str, bytes]
) -> list[dict[str, object]]:
    """The entries for the tables of the DM, with the levels of every group as in the DM's C."""
    cases = [pairs_of(case) for case in result.cases]
    if not cases or any(len(case) != len(result.problem.groups) for case in cases):
        return []  # some set was not computed: there is no table, and no claim
    names = [s.name for s in result.problem.quantities.states]
    numbered_tables = enumerate(tables_of_groups(result.problem, cases))
    return [each.entry(names, f"{stem}_dm{k}", files) for k, each in numbered_tables]


def inputs_entries(
    kind: str, leaves: Sequence[Leaf], ranges: Sequence[Interval]
) -> Iterator[dict[str, str]]:
    """The entries of the inputs of one kind, each with its range."""
    for leaf, r in zip(leaves, ranges, strict=True):
        low, high = float(r.low).hex(), float(r.high).hex()
        yield {"name": leaf.name, "kind": kind, "low": low, "high": high}


def _times_entry(problem: Problem) -> dict[str, int]:
    """The times of a module in ns, by name; W only if its shield remembers commands."""
    times = problem.times
    remembers = problem.module.shield is not None and problem.kind == "flow"
    return {
        **({"W_ns": times.replaced_window} if remembers else {}),
        "Delta_ns": times.delta_dm,
        "delta_ns": times.delta_sc,
        "A_ns": times.age_dm,
        "A_sc_ns": times.age_sc,
        "J_dm_ns": times.late_dm,
        "J_sc_ns": times.late_sc,
        "R_dm_ns": times.response_dm,
        "R_sc_ns": times.response_sc,
        "L_ns": times.acts,
        "H_ns": times.horizon_ns,
        "H_star_ns": times.h_star,
        "d_ns": times.delay_sc,
        "j_ns": times.jitter_sc,
        "h0_ns": times.start,
    }


def _case_entries(
    problem: Problem, cases: list[CaseSets], stem: str, files: dict[str, bytes], claims: set[str]
) -> list[dict[str, object]]:
    return [_case_entry(problem, case, f"{stem}{k}", files, claims) for k, case in enumerate(cases)]


def _case_entry(
    problem: Problem, case: CaseSets, stem: str, files: dict[str, bytes], claims: set[str]
) -> dict[str, object]:
    groups = []
    for k, proof in enumerate(case.proofs):
        group_files: dict[str, bytes] = {}
        group = proof.certificate_entry(problem, f"{stem}_{k}", group_files)
        _drop_unclaimed_sets(group, group_files, claims, computed=problem.computed)
        files.update(group_files)
        groups.append(group)
    return {"parameter": list(case.parameter), "groups": groups}


def _drop_unclaimed_sets(
    group: dict[str, Any], files: dict[str, bytes], claims: set[str], *, computed: bool
) -> None:
    """Removes sets that no proved claim needs, with their files; an unneeded K becomes empty."""
    for name in parts_without_claim(group, claims, computed=computed):
        del group[name]
    if not OF_SETS & claims:
        files[group["K"]] = bytes(len(files[group["K"]]))
    named = json.dumps(group)
    for name in [n for n in files if json.dumps(n) not in named]:
        del files[name]

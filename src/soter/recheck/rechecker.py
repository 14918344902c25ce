"""Check a certificate: hashes, then the problem, then every claim.

Purpose: `recheck(folder)`: from the bytes of a certificate to a `Report`: accepted, or the reason
why not. Whatever this room does not know how to confirm is rejected, never accepted.
Non-goals: finding sets or witnesses: there is no search and no fixpoint here, one pass only.
"""

from __future__ import annotations

import os
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.diagnostic import SoterError
from soter.program.build import system_of
from soter.recheck.case import Case
from soter.recheck.claims import CLAIMS, claimed_of, missing_of
from soter.recheck.deployed import compare_tables
from soter.recheck.folder import Certificate, read_certificate
from soter.recheck.inclusion import GroupTables, RejectedError
from soter.recheck.model import Model
from soter.recheck.polytope_deployed import compare_half_spaces
from soter.recheck.polytope_predicates import narrowed
from soter.recheck.polytope_tables import PolytopeTables, read_polytope
from soter.recheck.problem import DiffersError, Facts, read_facts
from soter.recheck.source import hexadecimal, program_of
from soter.recheck.tables import Grid
from soter.recheck.terms import NotRecheckedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from soter.program.build import Checked

TIME_KEYS = (
    "Delta_ns",
    "delta_ns",
    "A_ns",
    "A_sc_ns",
    "J_dm_ns",
    "J_sc_ns",
    "R_dm_ns",
    "R_sc_ns",
    "L_ns",
    "H_ns",
    "H_star_ns",
)


MODULE_KEYS = (
    "system",
    "module",
    "plants",
    "parameters",
    "times",
    "inputs",
    "cases",
    "claims",
    "assumptions",
    "recover_ns",
)


@dataclass
class ModuleReport:
    """What was confirmed about a module."""

    name: str
    claims: dict[str, str]
    cells: int = 0
    half_spaces: int = 0
    """Of K, of all polytope groups."""
    confirmed: list[str] = field(default_factory=list)

    @property
    def other(self) -> list[str]:
        """Properties that are not confirmed here, with what the certificate says."""
        return [f"{n} ({v})" for n, v in self.claims.items() if n not in self.confirmed]

    @property
    def missing(self) -> list[str]:
        """What safety needs and is not established; empty: the module is safe."""
        return missing_of(self.claims, self.confirmed)

    @property
    def returns(self) -> bool:
        """Whether P2b is confirmed: SC gives control back."""
        return "P2b" in self.confirmed


@dataclass
class Report:
    """`accepted`, or why not; `seconds` and cells for people.

    Accepted says that what is claimed holds: whether that is safety, see `safe`.
    """

    accepted: bool
    reason: str = ""
    modules: list[ModuleReport] = field(default_factory=list)
    assumptions: list[str] = field(default_factory=list)
    program_sha256: str = ""
    seconds: float = 0.0

    @property
    def safe(self) -> bool:
        """Whether safety is established, for every module."""
        return self.accepted and all(not m.missing for m in self.modules)

    @property
    def returns(self) -> bool:
        """Whether P2b is, too."""
        return self.accepted and all(m.returns for m in self.modules)


def recheck(
    folder: Path, progress: Callable[[float], None] | None = None, workers: int | None = None
) -> Report:
    """Check the certificate in a folder; `NotACertificateError` where there is none.

    `progress` is called with the share that is done; `workers`: processes, by default one for
    each processor.
    """
    started = time.perf_counter()
    report = Report(accepted=False)
    try:
        certificate = read_certificate(folder)
        _check(certificate, report, progress or (lambda _: None), workers or os.cpu_count() or 1)
        report.accepted = True
    except (RejectedError, DiffersError) as error:
        report.reason = str(error)
    except NotRecheckedError as error:
        report.reason = f"not rechecked: {error}"
    except SoterError as error:
        report.reason = f"the program of the certificate: {error}"
    report.seconds = time.perf_counter() - started
    return report


def _check(
    certificate: Certificate, report: Report, progress: Callable[[float], None], workers: int
) -> None:
    manifest = certificate.manifest
    _keys(
        manifest,
        ("schema", "soter", "files", "main", "params", "modules", "program_sha256"),
        "the manifest",
    )
    checked, overrides = program_of(certificate)
    assert checked.program is not None
    report.program_sha256 = checked.program.sha256
    modules = manifest["modules"]
    if not isinstance(modules, list) or not modules:
        raise RejectedError("the manifest has no modules")
    for k, entry in enumerate(modules):
        share = partial(_share, progress, k, len(modules))
        report.modules.append(_module(certificate, checked, overrides, entry, share, workers))
        report.assumptions += [a for a in entry["assumptions"] if a not in report.assumptions]
    unused = {n for n in certificate.contents if n.startswith("sets/")} - certificate.used
    for name in sorted(unused):
        raise RejectedError(f"no claim rests on `{name}`")


def _share(progress: Callable[[float], None], k: int, count: int, done: float) -> None:
    progress((k + done) / count)


@contextmanager
def _understood(what: str) -> Iterator[None]:
    """What is no list, text or number where one belongs is the fault of the manifest."""
    try:
        yield
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise RejectedError(f"{what} of the manifest is not as it should be: {error}") from None


def _keys(entry: object, names: tuple[str, ...], what: str) -> None:
    if not isinstance(entry, dict):
        raise RejectedError(f"{what} is not as it should be")
    for name in sorted(entry.keys() ^ set(names)):
        raise RejectedError(f"{what} has {'no' if name in names else 'an unknown'} `{name}`")


# ---------------------------------------------------------------- a module


def _module(
    certificate: Certificate,
    checked: Checked,
    overrides: dict[str, Any],
    entry: dict[str, Any],
    progress: Callable[[float], None],
    workers: int,
) -> ModuleReport:
    given_tables = isinstance(entry, dict) and "tables" in entry
    _keys(entry, (*MODULE_KEYS, *(("tables",) if given_tables else ())), "a module")
    claims = claimed_of(entry["claims"])
    with _understood("a module"):
        if entry["system"] not in checked.systems:
            raise RejectedError(f"the program has no system `{entry['system']}`")
        facts = read_facts(system_of(checked, entry["system"], overrides), entry["module"])
        extents = _compare(facts, entry)
        given = [c["parameter"] for c in entry["cases"]]
    report = ModuleReport(entry["module"], entry["claims"])
    cases = list(facts.cases())
    if given != [list(c) for c in cases]:
        raise RejectedError("the cases are not all combinations of the parameters' values")
    tables, polytopes = [], []
    for case in entry["cases"]:
        _keys(case, ("parameter", "groups"), "a case")
        with _understood("a group"):
            grids, others = _groups(certificate, facts, extents, case["groups"])
        tables.append(grids)
        polytopes.append(others)
    if given_tables != facts.computed:
        raise RejectedError("a module has tables of its DM where its predicates are computed")
    if facts.computed:
        with _understood("a table of the DM"):
            count = len(tables[0])
            compare_tables(certificate, facts, tables, entry["tables"][:count])
            compare_half_spaces(certificate, facts, polytopes, entry["tables"][count:])
    for k, (values, groups, others) in enumerate(zip(cases, tables, polytopes, strict=True)):
        model = Model(facts, values, narrowed(extents, others))
        report.cells += sum(int(np.prod(g.grid.shape)) for g in groups)
        report.half_spaces += sum(len(p.core.bounds) for p in others)
        share = partial(_share, progress, k, len(cases))
        Case(model, groups, claims, entry, share, workers, others).check()
    report.confirmed = [c for c in CLAIMS if c in claims]
    return report


def _compare(facts: Facts, entry: dict[str, Any]) -> tuple[tuple[float, float], ...]:
    """Every figure of the manifest against the program; gives back the extents of the grid."""
    if entry["plants"] != [c.name for c in facts.plants]:
        raise RejectedError("the verification plants are others in the program")
    parameters = [{"name": p.name, "values": list(p.values)} for p in facts.parameters]
    if entry["parameters"] != parameters:
        raise RejectedError("the parameters are others in the program")
    _keys(entry["times"], TIME_KEYS, "`times`")
    for key in TIME_KEYS:
        if entry["times"][key] != facts.times[key] or isinstance(entry["times"][key], bool):
            raise RejectedError(
                f"{key} is {entry['times'][key]} in the manifest, {facts.times[key]} by the program"
            )
    inputs = entry["inputs"]
    if not isinstance(inputs, list):
        raise RejectedError("`inputs` is not as it should be")
    others = [*facts.controls, *facts.disturbances, *facts.errors, *facts.others]
    if len(inputs) != len(facts.states) + len(others):
        raise RejectedError("the inputs are others in the program")
    extents = []
    for i, (given, known) in enumerate(zip(inputs, [*facts.states, *others], strict=True)):
        _keys(given, ("name", "kind", "low", "high"), "an input")
        if (given["name"], given["kind"]) != (known.name, known.kind):
            raise RejectedError(f"input {given['name']} is {known.name} by the program")
        low, high = (hexadecimal(given[k], known.name) for k in ("low", "high"))
        if i < len(facts.states):
            if facts.axes.get(i, (low, high)) != (low, high):
                raise RejectedError(f"the grid of {known.name} is another one in the program")
            extents.append((low, high))
        elif (low, high) != (known.low, known.high):
            raise RejectedError(f"the range of {known.name} is another one in the program")
    return tuple(extents)


def _groups(
    certificate: Certificate,
    facts: Facts,
    extents: tuple[tuple[float, float], ...],
    entries: list[dict[str, Any]],
) -> tuple[list[GroupTables], list[PolytopeTables]]:
    names = {s.name: i for i, s in enumerate(facts.states)}
    found, polytopes, seen = [], [], []
    inputs = [facts.controls, facts.disturbances, facts.errors, facts.others]
    for entry in entries:
        if entry.get("kind") not in ("grid", "polytope"):
            raise NotRecheckedError(f"`{entry.get('kind')}` groups are not rechecked yet")
        grid = entry["kind"] == "grid"
        if grid:
            _keys(entry, (*REQUIRED, *(k for k in OPTIONAL if k in entry)), "a group")
        states, edges = [], []
        for axis in entry["axes"]:
            _keys(axis, ("state", "edges"), "an axis")
            if axis["state"] not in names:
                raise RejectedError(f"there is no state `{axis['state']}`")
            state = names[axis["state"]]
            states.append(state)
            edges.append(certificate.edges(axis["edges"]))
            if (edges[-1][0], edges[-1][-1]) != extents[state]:
                raise RejectedError(f"the edges of {axis['state']} do not span its range")
        seen += states
        if grid:
            found.append(_tables(certificate, entry, tuple(states), Grid(tuple(edges))))
            continue
        own, count = [extents[s] for s in states], len(extents) + sum(len(x) for x in inputs)
        polytopes.append(read_polytope(certificate, entry, tuple(states), own, count))
    if sorted(seen) != list(range(len(facts.states))):
        raise RejectedError("the groups do not hold every state exactly once")
    return found, polytopes


REQUIRED = ("kind", "axes", "K")
OPTIONAL = ("R", "Q", "W", "W_N", "S")


def _tables(
    certificate: Certificate, entry: dict[str, Any], states: tuple[int, ...], grid: Grid
) -> GroupTables:
    shape = grid.shape
    found = GroupTables(states, grid, certificate.numbers(entry["K"], shape, "<u1"))
    if "R" in entry:
        found.free = certificate.bits(entry["R"], shape)
    if "Q" in entry:
        found.home = certificate.numbers(entry["Q"], shape, "<u1")
    if "W" in entry:
        found.rank = certificate.numbers(entry["W"], shape, "<u2")
        found.rank_holds = certificate.numbers(entry.get("W_N"), shape, "<u1")
    found.levels = [certificate.bits(path, shape) for path in entry.get("S", [])]
    return found

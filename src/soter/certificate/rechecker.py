"""Check a certificate: hashes, then the problem, then every claim.

Purpose: `recheck(folder)`: from the bytes of a certificate to a `Report`: accepted, or the reason
why not. What is false is rejected; whatever this room does not know how to confirm is not
re-checked, and never accepted.
Non-goals: finding sets or witnesses: there is no search and no fixpoint here, one pass only.
"""

from __future__ import annotations

import math
import os
import time
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from soter.certificate.allowed_claims import CLAIMS, claimed_of, missing_of, static_claims
from soter.certificate.assumptions import assumptions_of, confirmed_of
from soter.certificate.case_check import CaseCheck, narrowed
from soter.certificate.cells.cell_sets import Axes, Grid
from soter.certificate.format.certificate_program import hexadecimal, program_of
from soter.certificate.format.claimed_parts import OF_SETS, refuse_cells, refuse_unclaimed
from soter.certificate.format.errors import REJECTED, NotRecheckedError, RejectedError
from soter.certificate.format.folder import Certificate, read_certificate
from soter.certificate.handover import jumps_of
from soter.certificate.proof_methods import GROUPS, MODULES
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.failsafe_law import law_of
from soter.certificate.reading.module_facts import DiffersError, Facts
from soter.certificate.reading.view_predicates import left_out
from soter.certificate.report import (
    GIVING_UP,
    RecheckedModule,
    Report,
    gave_up,
    in_words,
    of_those_above,
)
from soter.certificate.scope import otherwise_in_program, parameters_of, uncovered
from soter.certificate.understood import facts_of
from soter.certificate.vacuous_proofs import vacuous
from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import system_to_prove
from soter.report.printable_text import visible

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from soter.certificate.groups import Extents, Group
    from soter.certificate.scope import Covered
    from soter.language.front_end import CheckResult
    from soter.language.model.system import System

DECLARED_KEYS = ("Delta_ns", "delta_ns", "J_dm_ns", "J_sc_ns", "R_dm_ns", "R_sc_ns", "L_ns")
"""Times that stand in the program, and in the manifest as they are there."""
DERIVED_KEYS = ("A_ns", "A_sc_ns", "H_star_ns", "d_ns", "j_ns", "h0_ns")
"""Times that follow: a manifest may claim more schedules than there are, never fewer."""
TIME_KEYS = (*DECLARED_KEYS, *DERIVED_KEYS, "H_ns")
BEYOND, BEYOND_NS = 4, 1_000_000_000
"""More than so many times a time, all times together and so much: a way to keep this busy."""
BEGINS = ("P1c", "P2a", "P3", "start")
"""What says that the fail-safe law begins in K; P1c may rest on assumed times, as it may for SC."""
CASES_MAX = 4096
"""Combinations of parameter values."""
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

__all__ = ["TIME_KEYS", "RecheckedModule", "Report", "recheck"]


def recheck(
    folder: Path, progress: Callable[[float], None] | None = None, workers: int | None = None
) -> Report:
    """Check the certificate in a folder; `NotACertificateError` where there is none.

    `progress` is called with the share that is done; `workers`: processes, else one a processor.
    """
    started = time.perf_counter()
    report = Report()
    try:
        certificate = read_certificate(folder)
        report.seal = certificate.seal
        _check(certificate, report, progress or (lambda _: None), workers or os.cpu_count() or 1)
        report.conclude()
    except (RejectedError, DiffersError) as error:
        report.verdict, report.reason = REJECTED, str(error)
    except SoterError as error:
        if any(d.code == "D007" for d in error.diagnostics):
            raise  # nothing is known of the certificate
        report.verdict, report.reason = REJECTED, f"the program of the certificate: {error}"
    except GIVING_UP as error:
        report.reason = in_words(error)
    report.reason = visible(report.reason)
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
    report.program = visible(str(manifest["main"]))
    modules = manifest["modules"]
    if not isinstance(modules, list) or not modules:
        raise RejectedError("the manifest has no modules")
    checked, overrides = program_of(certificate)
    assert checked.program is not None
    report.program_sha256 = checked.program.sha256
    covered: list[Covered] = []
    for k, entry in enumerate(modules):
        share = partial(_share, progress, k, len(modules))
        phase(f"checking module {k + 1} of {len(modules)}")
        facts: Covered
        whole = [of for key, of in MODULES.items() if isinstance(entry, dict) and key in entry]
        try:
            if whole:
                with _understood("a module"):
                    facts, module_report = whole[0].check(_system(checked, overrides, entry), entry)
            else:
                facts = _facts(checked, overrides, entry)
            if any(_key(f) == _key(facts) for f in covered):
                raise RejectedError(f"module `{facts.flying_module.name}` stands there twice")
            covered.append(facts)
            if isinstance(facts, Facts):
                module_report = _module(certificate, facts, entry, share, workers)
        except GIVING_UP as error:
            gave_up(report, entry, error)
            continue
        module_report.parameters = parameters_of(facts.flying)
        module_report.otherwise, module_report.contradicted = otherwise_in_program(
            checked, facts.flying
        )
        report.enter(module_report)
    of_those_above(report.modules)
    report.not_covered = uncovered(checked, overrides, covered)
    if any(m.not_rechecked for m in report.modules):
        return  # some tables were not read, and some views not looked at
    for facts in covered:
        _in_all_views(facts, covered)
    for name in certificate.unused:
        raise RejectedError(f"no claim rests on `{name}`")


def _key(facts: Covered) -> tuple[str, str, str]:
    view = facts.view if isinstance(facts, Facts) else ""
    return facts.flying.name, facts.flying_module.name, view


def _in_all_views(facts: Covered, covered: list[Covered]) -> None:
    """A module that is proved in views is proved in all of them, or not at all."""
    if not isinstance(facts, Facts) or not facts.view:
        return
    views = [f.view for f in covered if isinstance(f, Facts) and _key(f)[:2] == _key(facts)[:2]]
    assert facts.whole is not None
    why = left_out(facts.whole, views)
    if why:
        raise RejectedError(why)


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


def _facts(checked: CheckResult, overrides: dict[str, Any], entry: dict[str, Any]) -> Facts:
    """The problem of a module, which is the whole of what is understood of it."""
    given = [k for k in ("tables", "view", "law") if isinstance(entry, dict) and k in entry]
    _keys(entry, (*MODULE_KEYS, *given), "a module")
    with _understood("a module"):
        return facts_of(_system(checked, overrides, entry), entry)


def _system(checked: CheckResult, overrides: dict[str, Any], entry: dict[str, Any]) -> System:
    if entry["system"] not in checked.systems:
        raise RejectedError(f"the program has no system `{entry['system']}`")
    return system_to_prove(checked, entry["system"], overrides, exact=False)


def _module(
    certificate: Certificate,
    facts: Facts,
    entry: dict[str, Any],
    progress: Callable[[float], None],
    workers: int,
) -> RecheckedModule:
    claims = claimed_of(entry["claims"])
    with _understood("a module"):
        extents = compare(facts, entry)
        given = [c["parameter"] for c in entry["cases"]]
    said = static_claims(facts, entry["claims"])
    name = f"{entry['module']} as {facts.view}" if facts.view else entry["module"]
    report = RecheckedModule(name, said, system=entry["system"])
    report.stays, report.above = bool(facts.symbol.stays), getattr(facts.above, "name", "")
    report.safe = " ".join(facts.symbol.safe.span.text.split())
    if math.prod(len(p.values) for p in facts.parameters) > CASES_MAX:
        raise NotRecheckedError(f"more than {CASES_MAX:,} combinations of parameter values")
    if given != [list(c) for c in facts.cases()]:
        raise RejectedError("the cases are not all combinations of the parameters' values")
    groups = []
    for case in entry["cases"]:
        _keys(case, ("parameter", "groups"), "a case")
        with _understood("a group"):
            refuse_unclaimed(case["groups"], claims, computed=facts.computed)
            groups.append(groups_of(certificate, facts, extents, case["groups"]))
    if ("tables" in entry) != facts.computed:
        raise RejectedError("a module has tables of its DM where its predicates are computed")
    if facts.computed and (entry["tables"] or claims & OF_SETS):  # else K is empty: no table
        with _understood("a table of the DM"):
            compare_tables(certificate, facts, groups, entry["tables"])
    cells = [core for of_case in groups for g in of_case for core in g.cells]
    refuse_cells(cells, claims, entry["recover_ns"])
    if ("law" in entry) != ("failsafe" in claims):
        raise RejectedError("a module has sets of its law where `failsafe` is claimed")
    if "failsafe" in claims and {*BEGINS} & {*missing_of(entry["claims"], [*claims])}:
        raise RejectedError("failsafe: nothing says that the law begins where it keeps `safe`")
    law = _law(certificate, facts, extents, entry) if "law" in entry else None
    asked = partial(partial(_cases, facts, groups, extents, entry), claims, progress, workers, law)
    try:  # where there is a choice, with reads that are older than any
        asked()
    except (RejectedError, NotRecheckedError):
        if facts.times["d_ns"] == facts.own.delay:
            raise
        facts.times["d_ns"] = facts.own.delay  # older ones may be too much for our bounds
        phase(f"{name}: again, with reads as old as there are", anew=True)
        asked()
    jumps = jumps_of(facts, groups, extents, claims)
    report.assumptions, report.shown = assumptions_of(facts, jumps), confirmed_of(facts, jumps)
    report.vacuous, report.unseen = vacuous(facts, groups, extents)
    report.times = {**facts.times, "h0_ns": facts.start_ns, "start_ns": facts.start_ns}
    for g in (g for of_case in groups for g in of_case):
        g.tell(report)
    report.confirmed = [c for c in CLAIMS if said.get(c) == "proved"]
    return report


def _cases(
    facts: Facts,
    groups: list[list[Group]],
    extents: Extents,
    entry: dict[str, Any],
    claims: set[str],
    progress: Callable[[float], None],
    workers: int,
    law: Law | None,
) -> None:
    """Every claim, for every combination of parameter values; of the law that it keeps K_fs."""
    cases = list(facts.cases())
    for k, (values, own) in enumerate(zip(cases, groups, strict=True)):
        ranges = narrowed(extents, [g.part(errors=False) for g in own])
        share = partial(_share, progress, k, len(cases))
        case = CaseCheck(CaseModel(facts, values, ranges), own, claims, entry, share, workers)
        if law is not None:
            of_law, kept = law[0], law[1][k]
            ruled = CaseModel(of_law, values, ranges)
            CaseCheck(ruled, kept, {"P2a"}, entry, lambda _: None, workers).check()
            case.lawful = [g.kept_by(kept) for g in own]
        case.check()


Law = tuple[Facts, list[list["Group"]]]
"""The problem of the fail-safe law, and the groups with their K_fs, for every case."""


def _law(
    certificate: Certificate,
    facts: Facts,
    extents: Extents,
    entry: dict[str, Any],
) -> Law:
    """What a certificate says of the fail-safe law."""
    with _understood("a law"):
        if [c["parameter"] for c in entry["law"]] != [list(c) for c in facts.cases()]:
            raise RejectedError("the cases of the law are not those of the module")
        groups = []
        for case in entry["law"]:
            _keys(case, ("parameter", "groups"), "a case of the law")
            refuse_unclaimed(case["groups"], {"P2a"}, computed=False)
            groups.append(groups_of(certificate, facts, extents, case["groups"]))
            for g in groups[-1]:
                g.kept_by(groups[-1])
    return law_of(facts), groups


def compare_tables(
    certificate: Certificate,
    facts: Facts,
    cases: list[list[Group]],
    entries: list[dict[str, Any]],
) -> None:
    """What the DM holds of each group against the sets of all cases, or RejectedError."""
    if len(entries) != len(cases[0]):
        raise RejectedError("the tables of the DM are not one for each group")
    if any([g.kind for g in case] != [g.kind for g in cases[0]] for case in cases):
        raise RejectedError("the cases have other groups, and the DM has one table for all")
    for same, entry in zip(zip(*cases, strict=True), entries, strict=True):
        same[0].compare(certificate, facts, same, entry)


def compare(facts: Facts, entry: dict[str, Any]) -> Extents:
    """Every figure of the manifest against the program, or RejectedError; the grid's extents."""
    if entry["plants"] != [c.name for c in facts.plants]:
        raise RejectedError("the verification plants are others in the program")
    parameters = [{"name": p.name, "values": list(p.values)} for p in facts.parameters]
    if entry["parameters"] != parameters:
        raise RejectedError("the parameters are others in the program")
    _compare_times(facts, entry["times"])
    if not isinstance(inputs := entry["inputs"], list):
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


def _compare_times(facts: Facts, given: dict[str, Any]) -> None:
    """Declared times are those of the program, derived ones no shorter; the longer ones count.

    Older reads, wider windows, a longer horizon: a claim about more schedules implies ours.
    """
    _keys(given, TIME_KEYS, "`times`")
    ages = [r.max_age for r in (*facts.setting.by_dm, *facts.setting.by_sc)]
    together = sum(facts.times[k] for k in TIME_KEYS) + sum(ages)
    for key in TIME_KEYS:
        value, own = given[key], facts.times[key]
        if not isinstance(value, int) or isinstance(value, bool):
            raise RejectedError(f"{key} is no time in the manifest")
        fixed = key in DECLARED_KEYS or (key == "H_ns" and facts.symbol.verify.horizon is not None)
        if value < own or (fixed and value != own):
            raise RejectedError(f"{key} is {value} in the manifest, {own} by the program")
        if value > BEYOND * own + together + BEYOND_NS:
            raise NotRecheckedError(f"{key} is {value} in the manifest, which no program needs")
        facts.times[key] = value


def groups_of(
    certificate: Certificate,
    facts: Facts,
    extents: Extents,
    entries: list[dict[str, Any]],
) -> list[Group]:
    """The groups of a case, in the order of the methods.

    RejectedError where they do not fit the program, NotRecheckedError of another kind.
    """
    names = {s.name: i for i, s in enumerate(facts.states)}
    groups: list[Group] = []
    for entry in entries:
        if entry.get("kind") not in list(GROUPS):
            raise NotRecheckedError(f"`{entry.get('kind')}` groups are not rechecked yet")
        method = GROUPS[entry["kind"]]
        given = [k for k in method.optional if k in entry]
        _keys(entry, (*method.required, *given), "a group")
        states, edges = [], []
        for axis in entry["axes"]:
            _keys(axis, ("state", "edges"), "an axis")
            if axis["state"] not in names:
                raise RejectedError(f"there is no state `{axis['state']}`")
            states.append(names[axis["state"]])
            edges.append(certificate.edges(axis["edges"]))
            if (edges[-1][0], edges[-1][-1]) != extents[states[-1]]:
                raise RejectedError(f"the edges of {axis['state']} do not span its range")
        unbounded = tuple(s in facts.unbounded for s in states)
        grid = Grid(tuple(edges), unbounded if any(unbounded) else ())
        groups.append(method.read(certificate, facts, entry, Axes(tuple(states), grid)))
    if sorted(s for g in groups for s in g.states) != list(range(len(facts.states))):
        raise RejectedError("the groups do not hold every state exactly once")
    return sorted(groups, key=lambda g: list(GROUPS).index(g.kind))

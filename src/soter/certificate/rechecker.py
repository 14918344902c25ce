"""Check a certificate: hashes, then the problem, then every claim.

Purpose: `recheck(folder)` goes from the bytes of a certificate to a `Report`: accepted, or the
reason why not. What is false is rejected; whatever this room does not know how to confirm is not
re-checked, and never accepted.
Non-goals: finding sets or witnesses: there is no search and no fixpoint here, one pass only.

The argument: of each module that a manifest names, the problem is read off the program that lies
beside it (`read_problem`); each figure of the manifest is that of the problem, or a time that is no
shorter (`compare_numbers`); there is one case for every combination of parameter values, the groups
of a case hold each state once (`read_groups`), and every claim is asked of every group
(`case_check.py`). A claim that is not asked is not confirmed, and whatever raises is not accepted.
"""

from __future__ import annotations

import math
import os
import time
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from soter.certificate.case_check import (
    CLAIMS,
    CaseCheck,
    check_static_claims,
    narrowed_extents,
    proved_claims,
)
from soter.certificate.cell_sets import Axes, Grid
from soter.certificate.extras import extras
from soter.certificate.proof_methods import (
    MODULES,
    import_grid_group,
    refuse_parts_without_claim,
)
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.folder import (
    MANIFEST_KEYS,
    OF_SETS,
    Certificate,
    NotACertificateError,
    number_from_hexadecimal,
    read_certificate,
    read_program,
    refuse_cells,
    require_keys,
    stated_assumptions,
)
from soter.certificate.reading.module_facts import Facts, Input
from soter.certificate.reading.module_times import compare_times
from soter.certificate.reading.problem import read_facts
from soter.certificate.reading.supported_constructs import require_supported
from soter.certificate.report import (
    ACCEPTED,
    NOT_RECHECKED,
    REJECTED,
    NotRecheckedError,
    RecheckedModule,
    RejectedError,
    Report,
)
from soter.certificate.scope import (
    assumptions_of,
    confirmed_facts,
    open_questions,
    other_values_in_program,
    param_values,
)
from soter.certificate.vacuous_proofs import why_vacuous
from soter.diagnostics.current_phase import between, phase
from soter.diagnostics.diagnostic import SoterError
from soter.language.evaluate.arithmetic import StepFault
from soter.language.front_end import system_to_prove
from soter.report.wording import visible

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from soter.certificate.extras.failsafe_law import FailsafeLaw
    from soter.certificate.grid.grid_group import GridGroup
    from soter.certificate.scope import Covered
    from soter.language.front_end import CheckResult
    from soter.language.model.system import System


CASES_MAX, LEVELS_MIN = 4096, 2
"""Combinations of parameter values at most; levels of computed predicates at least."""
MODULE_KEYS = "system module plants parameters times inputs cases claims recover_ns"


def recheck(folder: Path, workers: int | None = None) -> Report:
    """Checks the certificate in a folder; raises NotACertificateError if the folder has none.

    `workers`: the number of processes, by default one for each processor.
    """
    started = time.perf_counter()
    report = Report()
    try:
        certificate = read_certificate(folder)
        report.seal = certificate.seal
        _check_certificate(certificate, report, workers or os.cpu_count() or 1)
        _set_verdict(report)
    except NotACertificateError:
        raise
    except RejectedError as error:
        report.verdict, report.reason = REJECTED, str(error)
    except SoterError as error:
        if any(d.code == "D007" for d in error.diagnostics):
            raise  # nothing is known of the certificate
        report.verdict, report.reason = REJECTED, f"the program of the certificate: {error}"
    except Exception as error:  # noqa: BLE001 - whatever it is, nothing is accepted
        report.reason = reason_in_words(error)
    report.reason = visible(report.reason)
    report.seconds = time.perf_counter() - started
    return report


def _set_verdict(report: Report) -> None:
    left = [f"{m.name}: {m.not_rechecked}" for m in report.modules if m.not_rechecked]
    report.verdict, report.reason = (NOT_RECHECKED if left else ACCEPTED), "; ".join(left)


def reason_in_words(error: Exception) -> str:
    """The reason why something was not re-checked, as text, from the error that was raised."""
    if isinstance(error, NotRecheckedError):
        return str(error)
    if isinstance(error, StepFault):
        return f"a step that faults whatever it reads ({error})"
    if isinstance(error, (BrokenExecutor, OSError)):
        return f"the system ended a part of it: {error}"
    name = type(error).__name__
    if isinstance(error, (RecursionError, MemoryError)):
        return f"{name.lower()}: {error}"
    return f"the re-checker itself failed ({name}: {error})"


def _check_certificate(certificate: Certificate, report: Report, workers: int) -> None:
    if not __debug__:
        raise NotRecheckedError("`python -O` leaves out what it asserts")
    manifest = certificate.manifest
    require_keys(manifest, MANIFEST_KEYS, "the manifest", "assumptions")
    report.stated = stated_assumptions(manifest)
    report.program = visible(str(manifest["main"]))
    modules = manifest["modules"]
    if not isinstance(modules, list) or not modules:
        raise RejectedError("the manifest has no modules")
    checked, overrides = read_program(certificate)
    assert checked.program is not None
    report.program_sha256 = checked.program.sha256
    covered: list[Covered] = []
    for k, entry in enumerate(modules):
        phase(f"checking module {k + 1} of {len(modules)}")
        try:
            with between(k / len(modules), (k + 1) / len(modules)):
                module = _check_entry(certificate, checked, overrides, covered, entry, workers)
        except (RejectedError, SoterError):
            raise
        except Exception as error:  # noqa: BLE001 - the others are checked all the same
            view = f" as {entry['view']}" if entry.get("view") else ""
            name, system = f"{entry.get('module')}{view}", str(entry.get("system"))
            if any((m.system, m.name) == (system, name) for m in report.modules):
                raise RejectedError(f"module `{name}` stands there twice") from None
            module = RecheckedModule(name, {}, system=system, not_rechecked=reason_in_words(error))
        if all((m.system, m.name) != (module.system, module.name) for m in report.modules):
            report.modules.append(module)
    report.not_covered = open_questions(checked, overrides, covered)
    if any(m.not_rechecked for m in report.modules):
        return  # some tables were not read, and some views not looked at
    for facts in covered:
        _require_all_views(facts, covered)
    for name in certificate.unused_tables:
        raise RejectedError(f"no claim rests on `{name}`")


def _check_entry(
    certificate: Certificate,
    checked: CheckResult,
    overrides: dict[str, Any],
    covered: list[Covered],
    entry: dict[str, Any],
    workers: int,
) -> RecheckedModule:
    """Checks the entry of one module, and appends what was read of the program to `covered`."""
    facts: Covered
    methods = [m for key, m in MODULES.items() if isinstance(entry, dict) and key in entry]
    if methods:
        with _rejecting_malformed("a module"):
            system = _system_of_entry(checked, overrides, entry)
            facts, report = methods[0]().check(system, entry)
    else:
        require_keys(entry, MODULE_KEYS, "a module", "levels tables view law wraps")
        with _rejecting_malformed("a module"):
            facts = read_problem(_system_of_entry(checked, overrides, entry), entry)
    if any(_module_key(f) == _module_key(facts) for f in covered):
        raise RejectedError(f"module `{facts.flying_module.name}` stands there twice")
    covered.append(facts)
    if not methods:
        assert isinstance(facts, Facts)
        report = _check_module(certificate, facts, entry, workers)
    report.parameters = param_values(facts.flying)
    report.otherwise, report.contradicted = other_values_in_program(checked, facts.flying)
    return report


def _module_key(facts: Covered) -> tuple[str, str, str]:
    view = facts.view if isinstance(facts, Facts) else ""
    return facts.flying.name, facts.flying_module.name, view


def _require_all_views(facts: Covered, covered: list[Covered]) -> None:
    """Raises RejectedError if a module is proved in some of its views, but not in all."""
    if isinstance(facts, Facts) and facts.view:
        key = _module_key(facts)[:2]
        views = [f for f in covered if isinstance(f, Facts) and _module_key(f)[:2] == key]
        assert facts.whole is not None
        if why := extras.views.why_views_leave_out(facts.whole, [f.view for f in views]):
            raise RejectedError(why)


@contextmanager
def _rejecting_malformed(part: str) -> Iterator[None]:
    """Turns errors that a value of the wrong kind in the manifest causes into a RejectedError."""
    try:
        yield
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise RejectedError(f"{part} of the manifest is not as it should be: {error}") from None


def _system_of_entry(
    checked: CheckResult, overrides: dict[str, Any], entry: dict[str, Any]
) -> System:
    if entry["system"] not in checked.systems:
        raise RejectedError(f"the program has no system `{entry['system']}`")
    return system_to_prove(checked, entry["system"], overrides, exact=False)


# ---------------------------------------------------------------- a module


def read_problem(flat: System, entry: dict[str, Any]) -> Facts:
    """Reads the problem of the module in an entry, and checks that all of it is understood.

    Raises RejectedError if the module does not exist, NotRecheckedError if a part is unknown.
    """
    facts = read_facts(flat, entry["module"], str(entry.get("view", "")))
    _read_levels(facts, entry.get("levels", facts.levels))
    require_supported(facts)
    setting = facts.setting
    if setting.release_with_state(0, setting.by_sc) != setting.sc.phase:
        extras.sc_locals_and_modes.check_start_answers(facts)  # else every read of SC shows a state
    return facts


def _read_levels(facts: Facts, levels: object) -> None:
    """Enters the number of levels; raises RejectedError if manifest and program differ."""
    if not isinstance(levels, int) or isinstance(levels, bool) or levels < LEVELS_MIN:
        raise RejectedError("`levels` is not as it should be")
    if levels != facts.levels and (facts.symbol.verify.levels is not None or not facts.is_computed):
        raise RejectedError("the number of levels is another one in the program")
    facts.levels = levels


@dataclass(eq=False)
class Claimed:
    """The claims of a module's entry, the groups of each case, and the module's fail-safe law."""

    claims: set[str]
    groups: list[list[GridGroup]]
    law: FailsafeLaw | None


def read_claims(certificate: Certificate, facts: Facts, entry: dict[str, Any]) -> Claimed:
    """Reads the claims, figures and groups of an entry, and compares them with the program.

    RejectedError where they differ, NotRecheckedError where there are too many cases.
    """
    claims = proved_claims(entry["claims"])
    with _rejecting_malformed("a module"):
        compare_numbers(facts, entry)
        parameters = [c["parameter"] for c in entry["cases"]]
    check_static_claims(facts, entry["claims"])
    if math.prod(len(p.values) for p in facts.parameters) > CASES_MAX:
        raise NotRecheckedError(f"more than {CASES_MAX:,} combinations of parameter values")
    if parameters != [*map(list, facts.parameter_combinations())]:
        raise RejectedError("the cases are not all combinations of the parameters' values")

    def read_case(case: dict[str, Any], claimed: set[str], *, computed: bool) -> list[GridGroup]:
        require_keys(case, "parameter groups", "a case")
        if not (case["groups"] or claimed & OF_SETS):
            raise NotRecheckedError("no sets were found: P2a, P3 and the start were not proved")
        with _rejecting_malformed("a group"):
            refuse_parts_without_claim(case["groups"], claimed, computed=computed)
            return read_groups(certificate, facts, case["groups"])

    groups = [read_case(case, claims, computed=facts.is_computed) for case in entry["cases"]]
    if ("tables" in entry) != facts.is_computed:
        raise RejectedError("a module has tables of its DM where its predicates are computed")
    if facts.is_computed and (entry["tables"] or claims & OF_SETS):  # else K is empty: no table
        with _rejecting_malformed("a table of the DM"):
            extras.estimates_and_shield.compare_tables(certificate, facts, groups, entry["tables"])
    cells = [g.tables.core for of_case in groups for g in of_case]
    refuse_cells(cells, claims, entry["recover_ns"])
    if ("law" in entry) != ("failsafe" in claims):
        raise RejectedError("a module has sets of its law where `failsafe` is claimed")
    law = None
    if "law" in entry:
        with _rejecting_malformed("a law"):
            law = extras.failsafe_law.read_law(
                facts, entry, claims, partial(read_case, claimed={"P2a"}, computed=False)
            )
    return Claimed(claims, groups, law)


def _check_module(
    certificate: Certificate, facts: Facts, entry: dict[str, Any], workers: int
) -> RecheckedModule:
    """Shows every claim of a module, and makes its part of the report."""
    claimed = read_claims(certificate, facts, entry)
    groups, name = claimed.groups, f"{entry['module']}{f' as {facts.view}' * bool(facts.view)}"
    check_cases = partial(_check_cases, facts, claimed, entry, workers)
    try:  # where there is a choice, with reads that are older than any
        check_cases()
    except (RejectedError, NotRecheckedError):
        if facts.times["d_ns"] == facts.derived.delay:
            raise
        facts.times["d_ns"] = facts.derived.delay  # older ones may be too much for our bounds
        phase(f"{name}: again, with reads as old as there are", anew=True)
        check_cases()
    report = RecheckedModule(name, dict(entry["claims"]), system=entry["system"])
    report.confirmed = [c for c in CLAIMS if c in claimed.claims]
    jumps = extras.handovers.jumps_by_plant(facts, groups, claimed.claims) if facts.view else {}
    report.assumptions, report.shown = (assumptions_of(facts, jumps), confirmed_facts(facts, jumps))
    report.stays = bool(facts.symbol.stay_clause)
    report.safe = facts.symbol.safe.span.text_on_one_line
    report.vacuous, report.unseen = why_vacuous(facts, groups)
    report.times = {**facts.times, "h0_ns": facts.start_ns, "start_ns": facts.start_ns}
    for g in (g for of_case in groups for g in of_case):
        g.add_size_to(report)
    return report


def _check_cases(facts: Facts, claimed: Claimed, entry: dict[str, Any], workers: int) -> None:
    """Shows every claim for each combination of parameter values, and that the law keeps K_fs."""
    cases = list(facts.parameter_combinations())
    for k, (values, groups) in enumerate(zip(cases, claimed.groups, strict=True)):
        model = CaseModel(
            facts,
            values,
            narrowed_extents(facts.extents, [g.tables for g in groups]),
        )
        if facts.left_out:
            extras.left_out_states.refuse_reads_of_left_out_states(model)
        if facts.turning:
            extras.left_out_states.refuse_turns_read(model)
        case = CaseCheck(model, groups, claimed.claims, entry, workers)
        if claimed.law is not None:
            case.lawful = extras.failsafe_law.check_law(claimed.law, k, case)
        with between(k / len(cases), (k + 1) / len(cases)):
            case.show_claims()


def compare_numbers(facts: Facts, entry: dict[str, Any]) -> None:
    """Enters the ranges of the states; RejectedError where a figure of the manifest differs."""
    parameters = [{"name": p.name, "values": list(p.values)} for p in facts.parameters]
    if entry["plants"] != [c.name for c in facts.plants]:
        raise RejectedError("the verification plants are others in the program")
    if entry["parameters"] != parameters:
        raise RejectedError("the parameters are others in the program")
    compare_times(facts, entry["times"])
    if not isinstance(inputs := entry["inputs"], list):
        raise RejectedError("`inputs` is not as it should be")
    others = [*facts.controls, *facts.disturbances, *facts.errors, *facts.others]
    if len(inputs) < len(facts.states) + len(others):
        names = [entry_input["name"] for entry_input in inputs if entry_input["kind"] == "state"]
        extras.left_out_states.leave_out_states(
            facts, [s.name for s in facts.states if s.name not in names]
        )
    if len(inputs) != len(facts.states) + len(others):
        raise RejectedError("the inputs are others in the program")
    facts.extents = tuple(_state_extents(facts, zip(inputs, [*facts.states, *others], strict=True)))
    if "wraps" in entry:
        extras.left_out_states.read_turning(facts, entry["wraps"])


def _state_extents(
    facts: Facts, pairs: Iterable[tuple[Any, Input]]
) -> Iterator[tuple[float, float]]:
    """Yields each state's range in the manifest; raises RejectedError if an input differs."""
    for i, (entry, known) in enumerate(pairs):
        require_keys(entry, "name kind low high", "an input")
        if (entry["name"], entry["kind"]) != (known.name, known.kind):
            raise RejectedError(f"input {entry['name']} is {known.name} by the program")
        low, high = (number_from_hexadecimal(entry[k], known.name) for k in ("low", "high"))
        if i < len(facts.states):
            if facts.axes.get(i, (low, high)) != (low, high):
                raise RejectedError(f"the grid of {known.name} is another one in the program")
            yield low, high
        elif (low, high) != (known.low, known.high):
            raise RejectedError(f"the range of {known.name} is another one in the program")


def read_groups(
    certificate: Certificate, facts: Facts, entries: list[dict[str, Any]]
) -> list[GridGroup]:
    """Reads the groups of a case; RejectedError for wrong ones, NotRecheckedError for new kinds."""
    names = {s.name: i for i, s in enumerate(facts.states)}
    groups: list[GridGroup] = []
    for entry in entries:
        if entry.get("kind") != "grid":
            raise NotRecheckedError(f"`{entry.get('kind')}` groups are not rechecked yet")
        method = import_grid_group()
        require_keys(entry, " ".join(method.required), "a group", " ".join(method.optional))
        states, edges = [], []
        for axis in entry["axes"]:
            require_keys(axis, "state edges", "an axis")
            if axis["state"] not in names:
                raise RejectedError(f"there is no state `{axis['state']}`")
            states.append(names[axis["state"]])
            edges.append(certificate.breakpoints(axis["edges"]))
            if (edges[-1][0], edges[-1][-1]) != facts.extents[states[-1]]:
                raise RejectedError(f"the edges of {axis['state']} do not span its range")
        grid = Grid(tuple(edges))
        if (facts.unbounded | facts.turning) & {*states}:
            beyond = (tuple(s in of for s in states) for of in (facts.unbounded, facts.turning))
            grid = extras.left_out_states.GridBeyondEnds(grid.edges, *beyond)
        groups.append(method.read(certificate, facts, entry, Axes(tuple(states), grid)))
    if sorted(s for g in groups for s in g.states) != list(range(len(facts.states))):
        raise RejectedError("the groups do not hold every state exactly once")
    return groups

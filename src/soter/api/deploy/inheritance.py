"""Says which proof a deployed system inherits.

Purpose: `inheritance_report` checks the certificate again, compares it with the program and the
parameters, and reports its verdicts for the modules of the deployed system that it covers.
Non-goals: what is covered (`verify/deploy/proof_transfer.py`), the checker (`soter.recheck`).
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from soter.api.rechecking import recheck
from soter.certificate.reading.folder import MANIFEST_MAX, PROGRAM_MAX, read_certificate
from soter.certificate.report import REJECTED, RecheckedModule, Report
from soter.diagnostics.diagnostic import Diagnostics, SoterError, mistake
from soter.language.load.loader import LoadedFile, load
from soter.language.load.named_files import read_bytes
from soter.targets.package import PackageFile

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from soter.certificate.reading.folder import Certificate
    from soter.language.model.system import System
    from soter.verify.deploy.level_tables import LevelTable, Pairs
    from soter.verify.deploy.missing_predicates import Known
    from soter.verify.deploy.proof_transfer import TransferredProof
    from soter.verify.problem.problem import Problem

FILE = "inherited.json"
SCHEMA = 1
SETS_CONFIRMED = ("P2a", "P3", "ttf", "safer")
"""The claims that confirm the sets of computed predicates; P2b besides confirms the number of
levels that is chosen."""


@dataclass
class DeploymentReport:
    """What a system inherits. `lines`: for people; `document`: for programs and the package."""

    certificate: str = ""
    lines: list[str] = field(default_factory=list)
    document: dict[str, object] = field(default_factory=dict)
    sets: Known | None = None
    """The certificate's sets for computed predicates of the deployed modules; None: without."""

    @property
    def files(self) -> list[PackageFile]:
        """The additional files for the package; [] if the system deploys no other system."""
        if not self.document:
            return []
        return [PackageFile(FILE, json.dumps(self.document, indent=1) + "\n")]


def inheritance_report(here: System, cert: str | Path | None) -> DeploymentReport:
    """Reports which proof a fresh flat system inherits; empty if it deploys no other.

    Raises SoterError D019 if something from outside is not covered; D020 if the certificate is
    rejected, not re-checked or about another program; D009 and D007 as `recheck` does; U001 for a
    certificate if `here` deploys no other.
    """
    target_system = here.proved
    if target_system is None:
        if cert is not None:
            from soter.verify.deploy.proof_transfer import advice_to_deploy  # noqa: PLC0415 - the same

            message = f"system `{here.name}` deploys no other: there is nothing to inherit"
            raise mistake("U001", message, *advice_to_deploy(here, str(cert)))
        return DeploymentReport()
    from soter.verify.deploy.proof_transfer import transferred_proofs  # noqa: PLC0415 - needs NumPy

    modules = transferred_proofs(here, target_system)
    seal, confirmed, sets = "", {}, None
    if cert is not None:
        report = recheck(cert)
        seal = _seal_of_same_program(Path(cert), report, target_system)
        confirmed = _confirmed_modules(report, target_system)
        sets = _CertifiedTables(Path(cert), seal, confirmed)
        for m in modules:
            if m.problem is not None:
                sets.check_build(m.problem, None)
    entries = [_inheritance_entry(m, confirmed.get(m.module), seal) for m in modules]
    proved = dict.fromkeys(confirmed, f"`{target_system.name}`")
    lines = [x for e in entries for x in _entry_lines(e, proved.get(e["module"], ""), seal)]
    document: dict[str, object] = {
        "schema": SCHEMA,
        "system": here.name,
        "deploys": target_system.name,
        "certificate": seal or None,
        "modules": entries,
    }
    return DeploymentReport(seal, lines, document, sets)


@dataclass(eq=False)
class _CertifiedTables:
    """The confirmed sets and tables of a certificate, as a `missing_predicates.Known`."""

    folder: Path
    seal: str
    confirmed: Mapping[str, list[RecheckedModule]]

    @cached_property
    def _certificate(self) -> Certificate:
        certificate = read_certificate(self.folder)
        if certificate.seal != self.seal:
            raise _other_certificate_error(self.folder, "it was changed while it was checked")
        return certificate

    def sets(self, problem: Problem) -> list[Pairs] | None:
        """The certificate's sets for a problem if the re-checker confirmed all, else None."""
        from soter.verify.deploy.proof_transfer import certified_sets  # noqa: PLC0415 - NumPy

        reports = self.confirmed.get(problem.name, [])
        needed = {*SETS_CONFIRMED, *(["P2b"] if problem.levels_open and not problem.stays else [])}
        if not reports or not all(needed <= set(r.confirmed) for r in reports):
            return None
        return certified_sets(self._certificate, reports[0].system, problem.name, problem)

    def check_build(self, problem: Problem, level_tables: Sequence[LevelTable] | None) -> None:
        """Raises SoterError D020 if the module is built with figures that are not certified."""
        from soter.verify.deploy.proof_transfer import difference_from_certificate  # noqa: PLC0415 - needs NumPy

        reports, name = self.confirmed.get(problem.name, []), problem.name
        if not reports:
            return
        compared = self._certificate, reports[0].system, name, problem, level_tables
        if differing := difference_from_certificate(*compared):
            why = f"`{name}` is built with other {differing} than it has"
            raise _other_certificate_error(self.folder, why)
        oldest, plan = problem.times.delay_sc, problem.module.symbol.sc.name
        held = [r.plan_times.get(plan, r.times) for r in reports]
        if any(times.get("d_ns", oldest) < oldest for times in held):
            why = (
                f"`{name}` was checked again for reads that are no older than its plants make them"
            )
            raise _other_certificate_error(self.folder, why)


def _inheritance_entry(
    m: TransferredProof, report: list[RecheckedModule] | None, seal: str
) -> dict[str, Any]:
    why = m.why_not
    if not why and not seal:
        why = "no certificate was given (--cert DIR)"
    elif not why and report is None:
        why = "the certificate is not about it"
    confirmed: list[str] = []
    missing: list[str] = []
    if not why and report is not None:
        every = [set(r.confirmed) for r in report]
        confirmed = [c for c in report[0].confirmed if all(c in e for e in every)]
        missing = list(dict.fromkeys(x for r in report for x in r.missing))
    return {
        "module": m.module,
        "inherited": not why,
        "why_not": why,
        "confirmed": confirmed,
        "missing": missing,
        "covered": m.covered,
        "assumptions": m.assumptions if not why else [],
    }


def _entry_lines(entry: dict[str, Any], name_of_proved: str, seal: str) -> list[str]:
    name = entry["module"]
    if not entry["inherited"]:
        lines = [f"{name}: nothing proved: {entry['why_not']}"]
    else:
        confirmed, missing = entry["confirmed"], entry["missing"]
        safe = f"; safety is not established: {', '.join(missing)}" if missing else ""
        if "P1c" not in confirmed and "P1c" not in missing:
            safe += "; P1c is assumed, not proved: not all of its times are declared"
        words = " ".join(confirmed)
        lines = [
            f"{name}: {words} of {name_of_proved}, certificate {seal[:12]}, checked again{safe}"
        ]
    return [*lines, *(f"{name}: {line}" for line in entry["covered"])]


def _seal_of_same_program(folder: Path, report: Report, proved: System) -> str:
    """The seal of an accepted certificate about this program. Raises SoterError D020."""
    if not report.accepted:
        outcome = "is rejected" if report.verdict == REJECTED else "was not re-checked"
        raise _other_certificate_error(folder, f"it {outcome}: {report.reason}")
    raw = read_bytes(folder / "manifest.json", MANIFEST_MAX)
    if hashlib.sha256(raw).hexdigest() != report.seal:
        raise _other_certificate_error(folder, "it was changed while it was checked")
    manifest = json.loads(raw)
    home = _declaring_file(proved)
    main = Path(str(manifest["main"]))
    for name, digest in manifest["files"].items():
        if not name.startswith("program/"):
            continue
        file_name = name.removeprefix("program/")
        beside = (
            Path(os.path.relpath(file_name, main.parent)) if file_name != main.as_posix() else None
        )
        local = home if beside is None else home.parent / beside
        try:
            same = hashlib.sha256(read_bytes(local, PROGRAM_MAX)).hexdigest() == digest
        except OSError:
            same = False
        if not same:
            raise _other_certificate_error(
                folder, f"its `{file_name}` is not the one that is built"
            )
    return report.seal


def _prefix_of(name: str) -> str:
    """The prefix that an imported file gives to a name, e.g. `cart.` or ""."""
    return name[: len(name) - len(name.rpartition(".")[2])]


def _declaring_file(proved: System) -> Path:
    """The path of the file that declares the proved system."""
    prefix = _prefix_of(proved.name)
    return next(f.path for f in _program_files(proved.program.path) if f.prefix == prefix).resolve()


def _program_files(path: str) -> list[LoadedFile]:
    diagnostics = Diagnostics()
    loaded = load(path, diagnostics)
    if loaded is None:
        raise SoterError(diagnostics.items)
    return loaded.files


def _local_names(proved: System, home: Path) -> dict[str, str]:
    """Maps the full name of a parameter in the certificate to its full name in this program.

    An imported file is called by the first name that an import gives it. This name differs if the
    main file is the one that declares the proved system.
    """
    here = {f.path.resolve(): f.prefix for f in _program_files(proved.program.path)}
    alone = {here[f.path.resolve()]: f.prefix for f in _program_files(str(home))}
    return {
        alone[_prefix_of(name)] + name.rpartition(".")[2]: name
        for name in proved.program.params
        if _prefix_of(name) in alone
    }


def _confirmed_modules(report: Report, proved: System) -> dict[str, list[RecheckedModule]]:
    """Maps each module of the proved system to the reports on its views. Raises D020."""
    from soter.certificate.scope import param_values  # noqa: PLC0415 - an extra

    short = proved.name.removeprefix(_prefix_of(proved.name))
    names = _local_names(proved, _declaring_file(proved))
    ours = set(names.values())
    values = {n: v for n, v in param_values(proved).items() if _declared_name(proved, n) in ours}
    reports_by_module: dict[str, list[RecheckedModule]] = {}
    for m in report.modules:
        if m.system != short:
            continue
        checked = {_local_name(n, names): v for n, v in m.parameters.items()}
        if checked != values:
            differ = sorted(set(checked.items()) ^ set(values.items()))
            listed = ", ".join(dict.fromkeys(f"`{n}`" for n, _ in differ))
            raise _other_certificate_error(None, f"it is about other values of {listed}")
        reports_by_module.setdefault(m.name.partition(" as ")[0], []).append(m)
    return reports_by_module


def _local_name(name: str, names: dict[str, str]) -> str:
    """The name in this program for a parameter of the certificate, also an instance's one."""
    declared = name
    while declared not in names and "." in declared:
        declared = declared.partition(".")[2]
    return name[: len(name) - len(declared)] + names.get(declared, declared)


def _declared_name(proved: System, name: str) -> str:
    param = proved.program.param(name)
    return name if param is None else param.name


def _other_certificate_error(folder: Path | None, why: str) -> SoterError:
    subject = f"the certificate `{folder}`" if folder is not None else "the certificate"
    hint = "`soter verify FILE --system NAME --cert DIR` of the file that declares what is deployed"
    return mistake("D020", f"{subject} is not about what is deployed: {why}", hint)

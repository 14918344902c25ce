"""Checks the certificate of a safety case, and records with which tools the case was made.

Purpose: `certified_proof` first rejects a certificate of another program, system, module or
parameters, or with a broken seal, and only rechecks one that may support something.
`case_provenance` and `compiler_used` give versions, hashes, flags and the command, so that somebody
can make the case again, and each printed page says which tools and which certificate it is about.
Non-goals: checking claims (`soter.recheck`); goals (`safety_case.py`); the time and the machine,
which would make equal cases differ.
"""

from __future__ import annotations

import hashlib
import platform
import shlex
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.rechecking import no_certificate_error, recheck
from soter.certificate.report import (
    REJECTED,
    NotRecheckedError,
    RecheckedModule,
    RejectedError,
    Report,
)
from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import SoterError, mistake
from soter.diagnostics.system_texts import reason
from soter.language.front_end import system_to_prove
from soter.language.load.named_files import open_finite_file
from soter.native.cache import SOTER, files_below, soter_sha256
from soter.native.compiler import compiler_version, find_compiler
from soter.native.shared_library import library_flags
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.api.arguments import Progress, Tell
    from soter.certificate.reading.folder import Certificate
    from soter.language.front_end import CheckResult
    from soter.language.model.system import Module, System


OTHER_PROGRAM = "the certificate is of another program: the hashes differ"
OTHER_PARAMETERS = "the certificate is about other values of the parameters"
OTHER_MODULE = "the certificate is not about this module of this system"


@dataclass(frozen=True, eq=False)
class CertifiedProof:
    """What a certificate may support.

    `rejected`: why it is rejected, or ""; `not_rechecked`: why the re-checker neither accepts nor
    rejects it, or ""; `why`: what else keeps it from supporting any goal, or "". `report`: the
    re-checker's, if it accepted it.
    """

    path: str = ""
    sha256: str = ""
    rejected: str = ""
    not_rechecked: str = ""
    why: str = ""
    report: Report | None = None
    certificate: Certificate | None = None
    entries: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    """Name of a module of the system -> its entries in the manifest, one for each view."""

    def confirmed_reports(
        self, flat: System, module: Module, params: dict[str, str]
    ) -> tuple[list[RecheckedModule], str]:
        """The re-checker's reports on exactly this module, one a view, or why there are none."""
        if module.forced is not None:
            forced = module.forced.upper()
            return [], f"the module is forced to {forced}: its switch does not switch"
        if self.rejected:
            return [], f"the certificate is rejected: {self.rejected}"
        if self.not_rechecked:
            return [], f"the certificate was not re-checked: {self.not_rechecked}"
        if self.why:
            return [], self.why
        if self.report is None or module.name not in self.entries:
            return [], OTHER_MODULE
        mine = [
            m
            for m in self.report.modules
            if m.system == flat.name and m.name.partition(" as ")[0] == module.name
        ]
        if not mine:
            return [], OTHER_MODULE
        if any(m.parameters != params for m in mine):
            return [], OTHER_PARAMETERS
        return mine, ""


def certified_proof(
    cert: str | Path | None,
    flat: System,
    params: dict[str, str],
    progress: Progress | None,
    tell: Tell,
) -> CertifiedProof:
    """What a certificate supports of a system; `tell` gets misfits. Raises D006, D007, D009."""
    if cert is None:
        return CertifiedProof(why="no certificate was given (--cert DIR)")
    known = _compared_certificate(Path(cert), flat, params)
    if known.rejected or known.why:
        tell(known.why or f"the certificate is rejected: {known.rejected}")
        return known
    phase("checking the certificate again")
    report = recheck(cert, progress)
    if report.verdict == REJECTED:
        return CertifiedProof(known.path, known.sha256, rejected=report.reason)
    if not report.accepted:
        return CertifiedProof(known.path, known.sha256, not_rechecked=report.reason)
    if file_hash(Path(cert) / "manifest.json") != known.sha256:
        return CertifiedProof(known.path, known.sha256, "it was changed while it was checked")
    if report.program_sha256 != flat.program.sha256:
        return CertifiedProof(known.path, known.sha256, why=OTHER_PROGRAM)
    return replace(known, report=report)


def _compared_certificate(folder: Path, flat: System, params: dict[str, str]) -> CertifiedProof:
    """Reads a certificate, with fast tests of its seal, hashes and the manifest's subject."""
    from soter.certificate.reading.folder import (  # noqa: PLC0415 - needs NumPy
        NotACertificateError,
        read_certificate,
        read_program,
    )

    path = str(folder)
    try:
        certificate = read_certificate(folder)
        sha256 = file_hash(folder / "manifest.json")
        checked, overrides = read_program(certificate)
    except NotACertificateError as error:
        raise no_certificate_error(error) from None
    except RejectedError as error:
        return CertifiedProof(path, rejected=str(error))
    except (NotRecheckedError, RecursionError) as error:
        return CertifiedProof(path, not_rechecked=str(error))
    except SoterError as error:
        return CertifiedProof(path, rejected=f"the program of the certificate: {error}")
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        return CertifiedProof(path, rejected=f"the manifest is not as it should be: {error}")
    assert checked.program is not None
    if checked.program.sha256 != flat.program.sha256:
        return CertifiedProof(path, sha256, why=_other_program_note(flat, checked, overrides))
    entries = _manifest_entries(certificate, flat)
    if not entries:
        return CertifiedProof(path, sha256, why=OTHER_MODULE)
    if _certified_parameters(checked, flat.name, overrides) != params:
        return CertifiedProof(path, sha256, why=OTHER_PARAMETERS)
    return CertifiedProof(path, sha256, certificate=certificate, entries=entries)


def _other_program_note(flat: System, certified: CheckResult, overrides: dict[str, Any]) -> str:
    """Says that a certificate is of another program, and which modules pose the same problem."""
    from soter.verify.posed_problems import posed_problems_in  # noqa: PLC0415 - needs the prover

    try:
        before = posed_problems_in(system_to_prove(certified, flat.name, overrides, exact=False))
    except SoterError:
        return OTHER_PROGRAM
    same = {name: before.get(name) == problem for name, problem in posed_problems_in(flat).items()}
    words = [f"{name} poses {'the same' if s else 'another'} problem" for name, s in same.items()]
    return "; ".join([OTHER_PROGRAM, *words])


def _certified_parameters(checked: Any, system: str, overrides: dict[str, Any]) -> dict[str, str]:  # noqa: ANN401
    """The parameter values in the certificate, or {"": ""}, which matches no system, on errors."""
    from soter.certificate.scope import param_values  # noqa: PLC0415 - needs NumPy

    try:
        return param_values(system_to_prove(checked, system, overrides, exact=False))
    except SoterError:
        return {"": ""}


def _manifest_entries(certificate: Certificate, flat: System) -> dict[str, list[dict[str, Any]]]:
    """Maps each module that is not forced to its entries in the manifest of the certificate."""
    listed = certificate.manifest.get("modules")
    entries_by_module: dict[str, list[dict[str, Any]]] = {}
    switching = {m.name for m in flat.modules if m.forced is None}
    for entry in listed if isinstance(listed, list) else []:
        if isinstance(entry, dict) and entry.get("system") == flat.name:
            name = entry.get("module")
            if isinstance(name, str) and name in switching:
                entries_by_module.setdefault(name, []).append(entry)
    return entries_by_module


def file_hash(path: Path) -> str:
    """The SHA-256 hash of a file. Raises SoterError D006 if the file cannot be read."""
    try:
        digest = hashlib.sha256()
        with open_finite_file(path, pipes=False) as file:
            while part := file.read(2**20):
                digest.update(part)
        return digest.hexdigest()
    except OSError as error:
        raise mistake("D006", f"cannot read `{path}`: {reason(error)}") from error


RECHECKER = ("certificate", "language")
"""The packages that a re-check rests on: its own, and the front end that it shares."""
UNUSED = "none: no decision module was compiled for this case"


@cache
def rechecker_sha256() -> str:
    """The SHA-256 hash over all files of the re-checker."""
    hashed = hashlib.sha256()
    for room in RECHECKER:
        for path in files_below(SOTER / room, "*.py", "*.soter"):
            hashed.update(path.relative_to(SOTER).as_posix().encode())
            hashed.update(hashlib.sha256(path.read_bytes()).digest())
    return hashed.hexdigest()


def compiler_used() -> str:
    """This machine's compiler for decision modules, with its flags. Raises SoterError X005."""
    compiler = find_compiler()
    return f"{compiler_version(compiler)}; {' '.join((*compiler.flags, *library_flags()))}"


def case_provenance(proof: CertifiedProof, command: str) -> dict[str, str]:
    """The tools and files that the case comes from, by label on its page, without the compiler."""
    certificate = f"SHA-256 {proof.sha256}" if proof.sha256 else ""
    why = f"rejected: {proof.rejected}" if proof.rejected else proof.why
    why = f"not re-checked: {proof.not_rechecked}" if proof.not_rechecked else why
    return {
        "Soter": f"{VERSION}, SHA-256 {soter_sha256()}",
        "re-checker": f"of Soter {VERSION}, SHA-256 {rechecker_sha256()}",
        "certificate": "; ".join(filter(None, (certificate, why))),
        "C compiler": UNUSED,
        "Python": f"{platform.python_version()}, NumPy {version('numpy')}",
        "command": command,
    }


def command_line(path: str, options: Mapping[str, object], params: Mapping[str, object]) -> str:
    """The command line `soter assure ...`; leaves out options whose value is None or False."""
    words = ["soter", "assure", path]
    for name, value in params.items():
        words += ["--set", f"{name}={str(value).lower() if isinstance(value, bool) else value}"]
    for name, value in options.items():
        if value is None or value is False:
            continue
        words += [name] if value is True else [name, str(value)]
    return shlex.join(words)

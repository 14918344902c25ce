"""With what a safety case was made: versions, hashes, flags, the command.

Purpose: `provenance_of`, `compiler_used`: enough to make the case again, and to see on each printed
page which tools and which certificate it is about.
Non-goals: the time and the machine, which would make equal cases differ.
"""

from __future__ import annotations

import hashlib
import platform
import shlex
from functools import cache
from importlib.metadata import version
from typing import TYPE_CHECKING

from soter.native.build import library_flags
from soter.native.compiler import find, told_version
from soter.native.package_sources import SOTER, files_below, soter_sha256
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.api.assurance.certificate_check import CertifiedProof

RECHECKER = ("certificate", "language")
"""The rooms that a re-check rests on: its own, and the front end that it shares."""
UNUSED = "none: no decision module was compiled for this case"


@cache
def rechecker_sha256() -> str:
    """A hash of the files of the re-checker."""
    told = hashlib.sha256()
    for room in RECHECKER:
        for path in files_below(SOTER / room, "*.py", "*.soter"):
            told.update(path.relative_to(SOTER).as_posix().encode())
            told.update(hashlib.sha256(path.read_bytes()).digest())
    return told.hexdigest()


def compiler_used() -> str:
    """The compiler that compiles decision modules here, and its flags; SoterError X005."""
    compiler = find()
    return f"{told_version(compiler)}; {' '.join((*compiler.flags, *library_flags()))}"


def provenance_of(proof: CertifiedProof, command: str) -> dict[str, str]:
    """What made the case, by the names that a page has for it; the compiler is entered later."""
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
    """`soter assure` with these options: None and False are left out, True has no value."""
    words = ["soter", "assure", path]
    for name, value in params.items():
        words += ["--set", f"{name}={str(value).lower() if isinstance(value, bool) else value}"]
    for name, value in options.items():
        if value is None or value is False:
            continue
        words += [name] if value is True else [name, str(value)]
    return shlex.join(words)

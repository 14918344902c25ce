"""Makes diagnostics of what is wrong with the file of a policy.

Purpose: X003, X014 and D007 with the file's name in them.
Non-goals: where in a program the file is named; `simulate/externs/` adds that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.load.named_files import ReadError, read_bytes
from soter.version import pip_command

if TYPE_CHECKING:
    from pathlib import Path

FILE_MAX = 256 * 2**20
"""Bytes of a policy's file; larger ones are refused."""


def bad_policy_error(path: Path | str, why: str, *helps: str) -> SoterError:
    """The error X014 for a file that is no policy, or no policy that can be run."""
    return SoterError((Diagnostic("X014", f"the policy `{path}`: {why}", helps=helps),))


def missing_package_error(package: str, purpose: str) -> SoterError:
    """The error D007 that a package is not installed."""
    help_ = f"install it: {pip_command('learn')}"
    return SoterError(
        (Diagnostic("D007", f"{purpose} needs the package `{package}`", helps=(help_,)),)
    )


def read_policy_bytes(path: Path) -> bytes:
    """The bytes of a policy's file; raises SoterError X003 if it cannot be read."""
    try:
        return read_bytes(path, FILE_MAX)
    except ReadError as error:
        message = f"cannot read the policy `{path}`: {error}"
        raise SoterError((Diagnostic("X003", message),)) from error

"""Certificates of `soter verify --cert`, checked again, and flights of what they are about.

Purpose: `recheck`: a report, or a diagnostic where there is nothing to check, or nothing to check
it with.
Non-goals: the checker (`soter.certificate`).
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import telling_shares
from soter.diagnostics.diagnostic import SoterError, mistake
from soter.language.evaluate.floating_point_mode import require_plain
from soter.version import pip_install

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.api.arguments import Progress
    from soter.certificate.report import Report as RecheckReport


def recheck(
    folder: str | Path, progress: Progress | None = None, logs: Sequence[str | Path] = ()
) -> RecheckReport:
    """Check the certificate in a folder, independently of what wrote it.

    `logs`: of `soter run --log`, of flights of its program. Every verdict "AC" of a module with
    `rest` is then done again, by the tube of the re-checker; the report's `flights` says of how
    many that was confirmed, and names the others; Ctrl-C then ends it with a report in which the
    flight is `interrupted`. They are looked at where nothing in the
    certificate is false, and rest on its claims.

    The report's `verdict` is `accepted`, `rejected` (something in it is false) or `not re-checked`
    (it may be right, but is beyond the re-checker); of the last two `reason` says why.
    `SoterError` D009 where there is no certificate, D007 where python-flint, or for logs `mcap`, is
    not installed, X012 where the process does not compute as programs mean it; D006 of what is no
    log, D023 of a log that the certificate is not about.
    """
    require_flint()
    require_plain()
    from soter.certificate.flight_check import flights_of  # noqa: PLC0415 - an extra
    from soter.certificate.format.folder import NotACertificateError  # noqa: PLC0415 - an extra
    from soter.certificate.rechecker import recheck as check  # noqa: PLC0415 - an extra

    with telling_shares(progress):
        try:
            flights = flights_of(Path(folder), list(map(str, logs))) if logs else None
            report = check(Path(folder))
        except NotACertificateError as error:
            raise no_certificate(error) from None
        if flights is not None:
            flights.add_to(report)
    return report


def require_flint() -> None:
    """SoterError D007 where the arithmetic of the re-checker is not installed."""
    if find_spec("flint") is None:
        raise mistake(
            "D007",
            "certificates are checked with `python-flint`, which is not installed",
            f"install it: {pip_install('prove')}",
        )


def no_certificate(error: Exception) -> SoterError:
    """D009: what was given is none."""
    hint = "`soter verify --cert DIR` makes one"
    return mistake("D009", f"this is no certificate: {error}", hint)

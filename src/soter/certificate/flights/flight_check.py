"""Every verdict of a flight, once more.

Purpose: `Flights`: logs of flights of the program in a certificate; each verdict "AC" of a module
whose decision module follows SC is confirmed from the estimate that it read, or named.
Non-goals: reading logs (`flight_log.py`), tubes (`tubes/`), the claims of the certificate.

The argument: a log is one of the program, parameters and system of the certificate, or of a system
that deploys it (M025: the same modules and nodes, without plants), or it is refused. By the theorem
a verdict "AC" needs reads that are fresh and an estimate that is good (docs/proof.md, "Decisions by
tubes", condition 5): the first the log says, the second is asked of the tube of this room, with
what the certificate claims of rest. Whether that claim holds is the matter of the re-check that
comes first; without it nothing here is confirmed.
"""

from __future__ import annotations

import os
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from soter.certificate.flights.flight_log import read_flight
from soter.certificate.flights.flight_report import UNCONFIRMED, Doubt, FlightReport
from soter.certificate.format.certificate_program import program_of
from soter.certificate.format.errors import REJECTED, NotRecheckedError, RejectedError
from soter.certificate.format.folder import read_certificate
from soter.certificate.rechecker import in_words
from soter.certificate.task_processes import TaskProcesses, can_fork
from soter.certificate.tubes.check_rest import rest_of
from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.front_end import system_to_prove
from soter.report.parameter_text import changed
from soter.report.printable_text import visible
from soter.report.run_log import metadata, require_log_package, unreadable

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence

    from soter.certificate.flights.flight_log import LoggedVerdict
    from soter.certificate.format.folder import Certificate
    from soter.certificate.report import Report
    from soter.certificate.tubes.flight_verdict import ModuleTube
    from soter.language.model.system import System

    Progress = Callable[[float], None]

REST = "rest"
OF_LOGS = ("D006", "D007", "D023")
ANY_COMMAND = "with any command, and the log has not what was judged of commands: "
PARAMETER = "param "
"""What a log calls a parameter that is not at its default begins so."""


def flights_of(folder: Path, logs: Sequence[str]) -> Flights | None:
    """Logs, and the certificate in a folder; None where a re-check does not get far with that.

    SoterError D006 of what is no log, D007 where `mcap` is not installed, D023 of a log that the
    certificate is not about; `NotACertificateError`.
    """
    require_log_package()
    try:
        return Flights(read_certificate(folder), logs)
    except SoterError as error:
        if any(d.code in OF_LOGS for d in error.diagnostics):
            raise
    except (RejectedError, NotRecheckedError, LookupError, TypeError, AttributeError):
        pass
    return None


class Flights:
    """Logs of flights of the program of a certificate, whose seal is `seal`."""

    def __init__(self, certificate: Certificate, logs: Sequence[str]) -> None:
        """All logs are looked at, and none is read."""
        self.seal = certificate.seal
        self._checked, self._overrides = program_of(certificate)
        assert self._checked.program is not None
        self._sha256 = self._checked.program.sha256
        self._entries = [e for e in certificate.manifest["modules"] if REST in e]
        if not self._entries:
            where = visible(str(certificate.folder))
            text = f"no decision module of the certificate `{where}` follows SC: nothing to confirm"
            raise SoterError((Diagnostic("D023", text),))
        self._flats: dict[str, System] = {}
        self._proved: dict[str, str] = {}
        """Of a system that flew: the one of the certificate, which it is or deploys."""
        self._followers: dict[tuple[str, str], ModuleTube | str] = {}
        self._logs = [(log, self._system_of(log)) for log in logs]

    def add_to(self, report: Report, progress: Progress) -> None:
        """What is found of the logs, to the report on the certificate, if that is not rejected."""
        if report.verdict != REJECTED and report.seal != self.seal:
            report.verdict, report.reason = REJECTED, "it was changed while it was being read"
        if report.verdict != REJECTED:
            report.flights += self.check(progress)

    def check(self, progress: Progress, workers: int | None = None) -> Iterator[FlightReport]:
        """Log by log; `progress` is called with the share of its verdicts that are done.

        Ctrl-C ends it with what was asked until then of the log that it was at.
        """
        for log, system in self._logs:
            began = _spent()
            phase(f"reading {visible(log)}", anew=True)
            flat = self._flats[system]
            proved = self._proved[system]
            names = [e["module"] for e in self._entries if e["system"] == proved]
            modules = [m for m in flat.modules if m.name in names]
            report = FlightReport(log, system, names)
            asked: list[LoggedVerdict] = []
            try:
                read = read_flight(Path(log), flat, modules)
                report.verdicts, report.others = len(read.verdicts), read.others
                report.to_ns, report.cut, report.doubts = read.to_ns, read.cut, list(read.doubts)
                report.unlogged = list(read.unlogged)
                phase(f"{visible(log)}: SC, followed from each estimate", anew=True)
                every = self._answers(system, read.verdicts, workers or os.cpu_count() or 1)
                with closing(every) as answers:  # processes end where somebody breaks it off
                    for v, why in answers:
                        asked.append(v)
                        if why:
                            doubt = Doubt(v.time_ns, v.module, UNCONFIRMED, why, v.estimate)
                            report.doubts.append(doubt)
                        progress(len(asked) / len(read.verdicts))
            except KeyboardInterrupt:
                report.interrupted = True
            report.doubts.sort(key=lambda d: (d.time_ns, d.module, d.kind))
            doubted = {(d.time_ns, d.module) for d in report.doubts}
            report.asked = len(asked)
            report.confirmed = sum((v.time_ns, v.module) not in doubted for v in asked)
            report.seconds = _spent() - began
            yield report
            if report.interrupted:
                return

    def _answers(
        self, system: str, verdicts: Sequence[LoggedVerdict], workers: int
    ) -> Generator[tuple[LoggedVerdict, str]]:
        """Each verdict, as it is done, and why its estimate is not known to be good; "": it is."""
        for name in {v.module for v in verdicts}:
            self._follower(system, name)  # before processes are forked

        def answer(k: int) -> str:
            return self._why_not(system, verdicts[k])

        answers: Generator[tuple[int, str]] = ((k, answer(k)) for k in range(len(verdicts)))
        if workers > 1 and len(verdicts) > 1 and can_fork():
            answers = TaskProcesses(len(verdicts), answer, min(workers, len(verdicts))).answers()
        with closing(answers):
            for k, why in answers:
                yield verdicts[k], why

    def _why_not(self, system: str, verdict: LoggedVerdict) -> str:
        """Why a verdict is not confirmed; "": it is."""
        known = self._follower(system, verdict.module)
        if isinstance(known, str):
            return known
        missing = [name for name in known.reads if name not in verdict.estimate]
        if missing:
            return f"the log does not say what it read of {', '.join(missing)}"
        try:
            why = known.good(verdict.estimate) or ""
            return ANY_COMMAND + why if why and known.judges else why
        except Exception as error:  # noqa: BLE001 - whatever it is, nothing is confirmed
            return in_words(error)

    def _follower(self, system: str, module: str) -> ModuleTube | str:
        """What follows a module, read once; why there is none, where nothing is known of it."""
        key = system, module
        if key not in self._followers:
            proved = self._proved[system], module
            entry = next(e for e in self._entries if (e["system"], e["module"]) == proved)
            try:
                self._followers[key] = rest_of(self._flat(proved[0]), entry)
            except Exception as error:  # noqa: BLE001 - as above
                self._followers[key] = in_words(error)
        return self._followers[key]

    # ------------------------------------------------------------ of which program

    def _system_of(self, log: str) -> str:
        """The system that flew in a log; SoterError D023 where the certificate is of another."""
        said = metadata(Path(log))
        if not said:
            raise unreadable(Path(log), "it does not say what flew")
        system, own = said.get("system", ""), self._sha256
        if said.get("program_sha256") != own:
            other = said.get("program_sha256", "none")
            raise _of_another(
                log, f"its program is {other[:12]}, that of the certificate {own[:12]}"
            )
        of_entries = dict.fromkeys(e["system"] for e in self._entries)
        assert self._checked.program is not None
        if system in self._checked.program.systems:
            self._proved[system] = (self._flat(system).proved or self._flat(system)).name
        if self._proved.get(system) not in of_entries:
            names = ", ".join(f"`{n}`" for n in of_entries)
            raise _of_another(log, f"system `{system}` flew, and the certificate is about {names}")
        proved = {name: text for name, (text, _) in changed(self._flats[system]).items()}
        begin = len(PARAMETER)
        flown = {name[begin:]: text for name, text in said.items() if name.startswith(PARAMETER)}
        for name in sorted(proved.keys() | flown.keys()):
            values = [of.get(name, "the default") for of in (flown, proved)]
            if values[0] != values[1]:
                text = f"{name} was {values[0]} in it, and is {values[1]} in the certificate"
                raise _of_another(log, text)
        return system

    def _flat(self, system: str) -> System:
        if system not in self._flats:
            flat = system_to_prove(self._checked, system, self._overrides, exact=False)
            self._flats[system] = flat
        return self._flats[system]


def _of_another(log: str, why: str) -> SoterError:
    helps = ("fly and prove the same program with the same parameters",)
    return SoterError((Diagnostic("D023", f"`{log}` is of another flight: {why}", helps=helps),))


def _spent() -> float:
    """Seconds of processors so far, of this process and of those that it has ended."""
    t = os.times()
    return t.user + t.system + t.children_user + t.children_system

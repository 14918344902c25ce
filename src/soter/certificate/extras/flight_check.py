"""Every verdict in the log of a flight, checked again.

Purpose: `Flights` confirms, or names, each verdict "AC" in logs of the program of a certificate, of
modules whose decision module follows SC (`rest`), from the estimate that it read. `read_flight`
reads an MCAP of `soter run --log`: every verdict of these modules, what it says that it read, and
all in which the log contradicts itself or the program.
Non-goals: logs of somebody else, tubes (`tubes/`), the claims of the certificate.

The argument: a verdict is one about what was published. So each read has to be the value that the
log has of that topic at that time, and the newest one before the verdict; where an instant has
both, either counts, as the program's order decides it and a fresh one is as good. Verdicts are due
at each release of the module: one that is missing, or came later than the module may start, is
named, whoever had control: SC waits for it. An instant is judged when it is over; of a file that is
cut the last instant may be half there, and is left out.

The argument: a log is one of the program, parameters and system of the certificate, or of a system
that deploys it (M025: the same modules and nodes, without plants), or it is refused. By the theorem
a verdict "AC" needs reads that are fresh and an estimate that is good (proof-flight.md, "Decisions
by tubes", condition 5): the first the log says, the second is asked of the tube of this room, with
what the certificate claims of rest. Whether that claim holds is the matter of the re-check that
comes first; without it nothing here is confirmed.
"""

from __future__ import annotations

import os
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.certificate.case_check import TaskProcesses, can_fork
from soter.certificate.extras.flight_assumptions import LoggedAssumptions
from soter.certificate.reading.folder import read_certificate, read_program
from soter.certificate.reading.symbolic_values import scalar_leaves
from soter.certificate.rechecker import reason_in_words
from soter.certificate.report import (
    CONTRADICTED,
    REJECTED,
    UNCONFIRMED,
    Doubt,
    FlightReport,
    NotRecheckedError,
    RejectedError,
)
from soter.certificate.tubes.check_rest import entries_of_plans, tube_of_entry
from soter.diagnostics.current_phase import phase, share_done
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.check.constants_and_types import declared_ns
from soter.language.front_end import system_to_prove
from soter.language.model.types import FloatType, RecordType, has_list, leaf_name, leaves
from soter.language.model.values import ValueShapeError, from_json
from soter.report.mcap_log import DECISIONS_TOPIC, MODES_TOPIC
from soter.report.mcap_reading import (
    log_messages,
    log_metadata,
    require_log_package,
    unreadable_error,
)
from soter.report.wording import changed_parameters, visible

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence

    from soter.certificate.reading.folder import Certificate
    from soter.certificate.report import Report
    from soter.certificate.tubes.tube_chains import ModuleTube
    from soter.language.model.system import Module, System
    from soter.language.model.types import Value


LATENESS = ("late_ns", "done_ns")
AGAINST = ("ttf", "stale")
"""Predicates that are false in every verdict "AC"."""
REST, PLANS = "rest", "plans"
OF_LOGS = ("D006", "D007", "D023")
ANY_COMMAND = "with any command, and the log has not what was judged of commands: "
SAME_PROGRAM = "fly and prove the same program with the same parameters"
PARAMETER = "param "
"""The beginning, in a log, of the name of a parameter that is not at its default."""


@dataclass(frozen=True)
class LoggedVerdict:
    """A verdict "AC": its time in ns, module, and `topic.leaf` -> the number that the DM read.

    `plan`: the plan that SC follows from then on; "" if the module has only one plan.
    """

    time_ns: int
    module: str
    estimate: dict[str, float]
    plan: str = ""


@dataclass
class FlightLog:
    """The verdicts "AC" of a log in order of time; `others` counts the verdicts "SC".

    `to_ns`: the time up to which the log was read; `cut`: why reading stopped early, or "".
    `unlogged`: topics that a DM read but that have no message in the log.
    """

    verdicts: list[LoggedVerdict] = field(default_factory=list)
    others: int = 0
    doubts: list[Doubt] = field(default_factory=list)
    to_ns: int = 0
    cut: str = ""
    unlogged: dict[str, None] = field(default_factory=dict)


def read_flight(path: Path, system: System, modules: Sequence[Module]) -> FlightLog:
    """Reads the verdicts of `modules` of `system`. Raises D006 for a file that is no log."""
    log = FlightLog()
    reader = _Reader(path, system, modules, log)
    due: list[tuple[str, dict[str, Any]]] = []
    now: int | None = None

    def note_cut(why: str) -> None:
        log.cut = why

    for time_ns, channel, message in log_messages(path, note_cut):
        if now is not None and time_ns > now:
            reader.read_instant(now, due)
            due = []
        now = time_ns
        due.append((channel, message))
    if now is not None and not log.cut:
        reader.read_instant(now, due)
    reader.end_log(log.to_ns)
    log.doubts.sort(key=lambda d: d.time_ns)
    return log


class _Verdicts:
    """Follows the verdicts of one module, in the order of the log."""

    def __init__(self, module: Module) -> None:
        self.name, self.period, self.late = module.name, module.period_ns, module.late_ns
        self.response = declared_ns(module, module.symbol.verify.response_dm)
        self.due_ns = 0
        """The release of which the verdict is still missing."""
        self.was_ac: bool | None = None
        """Whether the verdict before it was "AC"; None: that one is missing, or there is none."""
        self.in_ac = False
        """Whether AC has control, as the log says."""
        self.plan = module.symbol.plans[0].name if module.plan is not None else ""
        """The plan that SC follows, which is another one after a verdict "AC" alone."""

    def doubts_about(self, time_ns: int, decision: dict[str, Any]) -> Iterator[str]:
        """Yields doubts if a verdict contradicts earlier verdicts, the mode, or its predicates."""
        before, after = (decision[f"mode_{at}"] == "AC" for at in ("before", "after"))
        release = time_ns // self.period * self.period
        began, ended = (time_ns - release + _ns_after_instant(decision, at) for at in LATENESS)
        if release < self.due_ns:
            yield "it is the second one of its period"
            return
        yield from self._doubts_about_lateness(began, ended)
        if self.was_ac is not None and self.was_ac != before and release == self.due_ns:
            had, by_last = _mode_name(before), _mode_name(self.was_ac)
            yield f"{had} had control before it, and {by_last} by the one before"
        if after != self.in_ac:
            yield f'it says "{_mode_name(after)}", and {_mode_name(self.in_ac)} has control'
        predicates = decision["predicates"]
        # SC gives control back after a fault of AC, too (docs/semantics.md)
        false = [name for name in (*AGAINST, *["gate_fault"] * before) if predicates[name]]
        false += ["safer"] * (not before and not predicates["safer"])
        if after and false:
            yield f'it says "AC" against its own {", ".join(false)}'
        plan = str(decision.get("plan", ""))
        if plan != self.plan and not after:
            yield f'it has SC follow another plan, `{plan}`, and does not say "AC"'
        self.plan = plan
        self.due_ns, self.was_ac = release + self.period, after

    def _doubts_about_lateness(self, began: int, ended: int) -> Iterator[str]:
        """Yields a doubt if a verdict began, or took effect, too late after its release."""
        most = self.late + self.response
        if began > self.late:
            yield f"it came {began} ns after its release, and may {self.late} ns"
        elif ended > most:
            yield f"it was there {ended} ns after its release, and may {most} ns"

    def missing_text(self, before_ns: int) -> str:
        """A text that tells how many verdicts are missing before a time; "" if none is missing."""
        count = -((self.due_ns - before_ns) // self.period) if before_ns > self.due_ns else 0
        return f"{count} verdicts are missing" if count > 1 else "the verdict is missing" * count


def _ns_after_instant(decision: dict[str, Any], at: str) -> int:
    """The ns from the instant to the step's begin or end. Raises ValueError for a wrong time."""
    late = decision.get(at, 0)
    if type(late) is not int or late < 0:
        raise ValueError(f"`{at}` is {late!r}, and no step comes before its release")
    return late


def _mode_name(in_ac: bool) -> str:
    return "AC" if in_ac else "SC"


class _Reader:
    """Reads a log into a `FlightLog`, instant by instant."""

    def __init__(
        self, path: Path, system: System, modules: Sequence[Module], log: FlightLog
    ) -> None:
        self.path, self.system, self.log = path, system, log
        self.verdicts_of = {m.name: _Verdicts(m) for m in modules}
        self.topics = {t.name: t for t in system.topics}
        self.outside = {e.topic: e for e in system.externals}
        self.plants = {f"{c.name}.truth": c for c in system.components if c.plant is not None}
        self.assumed = LoggedAssumptions(system, modules)
        self.modules = {m.name: m for m in modules}
        self.published: dict[str, list[tuple[int, Value]]] = {}
        """Topic that the log has messages of -> its last two (time, value), the newest first."""
        self.begun = False

    def read_instant(self, time_ns: int, due: Sequence[tuple[str, dict[str, Any]]]) -> None:
        """Reads all messages of an instant. Raises D006 for messages that make no sense."""
        self.log.to_ns, self.begun = time_ns, True
        try:
            for channel, message in due:
                if channel in self.topics:
                    value = self._topic_value(channel, message)
                    before = self.published.get(channel, [])
                    self.published[channel] = [(time_ns, value), *before[:1]]
                    self.assumed.note_message(time_ns, channel, value)
                elif channel == MODES_TOPIC and message["module"] in self.verdicts_of:
                    self.verdicts_of[message["module"]].in_ac = message["mode"] == "AC"
            for channel, message in due:
                if (plant := self.plants.get(channel)) is not None and plant.plant is not None:
                    states = from_json(plant.plant.truth, message, channel)
                    self.assumed.note_truth(time_ns, plant, states)
                if channel == DECISIONS_TOPIC and message["module"] in self.verdicts_of:
                    self._note_logged_verdict(time_ns, message)
            self.assumed.end_instant(time_ns)
        except (ValueShapeError, LookupError, TypeError, ValueError, AttributeError) as error:
            fault = error if isinstance(error, ValueShapeError) else repr(error)
            why = f"at {time_ns} ns: {fault}; is it a log of `{self.system.name}`?"
            raise unreadable_error(self.path, why) from error

    def end_log(self, time_ns: int) -> None:
        """Adds the doubts that come up at the end of the log."""
        self.assumed.end_log(time_ns)
        self.log.doubts += self.assumed.doubts
        for name, verdicts in self.verdicts_of.items() if self.begun else ():
            if verdicts.due_ns == 0:
                text = "the log has no verdict of it"
                self.log.doubts.append(Doubt(0, name, CONTRADICTED, text))
            missing = verdicts.missing_text(time_ns + 1 - verdicts.late)
            self._note_missing(name, missing, verdicts.due_ns)

    def _note_missing(self, name: str, text: str, since_ns: int) -> None:
        if text:
            self.log.doubts.append(Doubt(since_ns, name, CONTRADICTED, text))

    def _note_logged_verdict(self, time_ns: int, message: dict[str, Any]) -> None:
        name = message["module"]
        verdicts = self.verdicts_of[name]
        release = time_ns // verdicts.period * verdicts.period
        self._note_missing(name, verdicts.missing_text(release), verdicts.due_ns)
        why = list(verdicts.doubts_about(time_ns, message))
        estimate: dict[str, float] = {}
        is_ac = message["mode_after"] == "AC"
        self.assumed.note_verdict(time_ns, self.modules[name], is_ac=is_ac, plan=verdicts.plan)
        if is_ac:
            reads = message.get("reads", {})
            for topic, read in reads.items():
                why += self._doubts_about_read(time_ns, topic, read, estimate)
            why += self.assumed.why_not_one_instant(
                {t: r["age_ns"] for t, r in reads.items() if r["age_ns"] is not None}
            )
            self.log.verdicts.append(LoggedVerdict(time_ns, name, estimate, verdicts.plan))
        else:
            self.log.others += 1
        self.log.doubts += [Doubt(time_ns, name, CONTRADICTED, w, estimate) for w in why]
        if is_ac and (silent := [t for t in reads if t not in self.published]):
            self.log.unlogged |= dict.fromkeys(silent)
            text = f"the log has no message of {', '.join(silent)} to compare its reads with"
            self.log.doubts.append(Doubt(time_ns, name, UNCONFIRMED, text, estimate))

    def _doubts_about_read(
        self, time_ns: int, name: str, read: dict[str, Any], estimate: dict[str, float]
    ) -> Iterator[str]:
        """Adds the leaves of a read to `estimate`, and yields the doubts about this read."""
        topic, age = self.topics[name], read["age_ns"]
        value = from_json(topic.type, read["value"], name)
        if not has_list(topic.type):
            pairs = zip(leaves(topic.type), scalar_leaves(value), strict=True)
            estimate.update(
                {leaf_name(name, p): x for (p, t), x in pairs if isinstance(t, FloatType)}
            )
        if type(age) is not int:
            yield f"it read {name}, which nobody had published"
            return
        if age < 0 or (topic.max_age_ns is not None and age > topic.max_age_ns):
            yield f"it read {name}, {age} ns old, and max_age is {topic.max_age_ns} ns"
        last = self.published.get(name)
        if last is None:
            return
        if topic.index in self.outside:  # measured before it came, and read as it has come
            came, known = last[0]
            late, e = came - (time_ns - age), self.outside[topic.index]
            if late < 0:
                yield f"it read {name} of {time_ns - age} ns, and the last one came at {came} ns"
            elif e.every_ns is not None and late > (e.delay_ns or 0):
                yield f"it read {name}, which came {late} ns late, and may {e.delay_ns or 0} ns"
            elif repr(known) != repr(value):
                yield f"it read another {name} than the last one, which came at {came} ns"
            return
        possible = last if last[0][0] == time_ns else last[:1]
        published = dict(possible).get(time_ns - age)
        if published is None:
            yield f"it read {name} of {time_ns - age} ns, and the last one is of {last[0][0]} ns"
        elif repr(published) != repr(value):  # bit by bit: -0.0 is another number than 0.0
            yield f"it read {name} of {time_ns - age} ns, and the log has another value of then"

    def _topic_value(self, channel: str, message: dict[str, Any]) -> Value:
        value_type = self.topics[channel].type
        plain = message if isinstance(value_type, RecordType) else message["value"]
        return from_json(value_type, plain, channel)


def open_flights(folder: Path, logs: Sequence[str]) -> Flights | None:
    """Opens logs with the certificate in a folder; None if the certificate cannot be read.

    Raises SoterError D006 for a file that is no log, D007 if `mcap` is not installed, D023 for a
    log that the certificate is not about; NotACertificateError if the folder has no certificate.
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
    """Logs of flights of a certificate's program; `seal` is the seal of the certificate."""

    def __init__(self, certificate: Certificate, logs: Sequence[str]) -> None:
        """Finds the system of each log; does not read the verdicts yet."""
        self.seal = certificate.seal
        self._checked, self._overrides = read_program(certificate)
        assert self._checked.program is not None
        self._sha256 = self._checked.program.sha256
        self._entries = [e for e in certificate.manifest["modules"] if REST in e or PLANS in e]
        if not self._entries:
            where = visible(str(certificate.folder))
            text = f"no decision module of the certificate `{where}` follows SC: nothing to confirm"
            raise SoterError((Diagnostic("D023", text),))
        self._flats: dict[str, System] = {}
        self._proved: dict[str, str] = {}
        """System that flew -> the one of the certificate that it is, or that it deploys."""
        self._followers: dict[tuple[str, str], dict[str, ModuleTube] | str] = {}
        self._logs = [(log, self._system_of(log)) for log in logs]

    def add_to_report(self, report: Report) -> None:
        """Adds the findings about the logs to the report, unless the certificate is rejected."""
        if report.verdict != REJECTED and report.seal != self.seal:
            report.verdict, report.reason = REJECTED, "it was changed while it was being read"
        if report.verdict != REJECTED:
            report.flights += self.judge_logs()

    def judge_logs(self, workers: int | None = None) -> Iterator[FlightReport]:
        """Judges the logs in turn, and reports which share of the verdicts is done.

        Ctrl-C stops it; the report of the current log then counts the verdicts judged until then.
        """
        for log, system in self._logs:
            began = _cpu_seconds()
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
                every = self._judged_verdicts(system, read.verdicts, workers or os.cpu_count() or 1)
                with closing(every) as answers:  # processes end where somebody breaks it off
                    for v, why in answers:
                        asked.append(v)
                        if why:
                            doubt = Doubt(v.time_ns, v.module, UNCONFIRMED, why, v.estimate)
                            report.doubts.append(doubt)
                        share_done(len(asked) / len(read.verdicts))
            except KeyboardInterrupt:
                report.interrupted = True
            report.doubts.sort(key=lambda d: (d.time_ns, d.module, d.kind))
            doubted = {(d.time_ns, d.module) for d in report.doubts}
            report.asked = len(asked)
            report.confirmed = sum((v.time_ns, v.module) not in doubted for v in asked)
            report.seconds = _cpu_seconds() - began
            yield report
            if report.interrupted:
                return

    def _judged_verdicts(
        self, system: str, verdicts: Sequence[LoggedVerdict], workers: int
    ) -> Generator[tuple[LoggedVerdict, str]]:
        """Yields each judged verdict with why its estimate may be bad; "" if it is good."""
        for name in {v.module for v in verdicts}:
            self._tubes_by_plan(system, name)  # before processes are forked

        def why_fails(k: int) -> str:
            return self._why_not_confirmed(system, verdicts[k])

        answers: Generator[tuple[int, str]] = ((k, why_fails(k)) for k in range(len(verdicts)))
        if workers > 1 and len(verdicts) > 1 and can_fork():
            answers = TaskProcesses(len(verdicts), why_fails, min(workers, len(verdicts))).answers()
        with closing(answers):
            for k, why in answers:
                yield verdicts[k], why

    def _why_not_confirmed(self, system: str, verdict: LoggedVerdict) -> str:
        tubes = self._tubes_by_plan(system, verdict.module)
        if isinstance(tubes, str):
            return tubes
        if (known := tubes.get(verdict.plan)) is None:
            return f"the module has no plan `{verdict.plan}`"
        missing = [name for name in known.estimate_fields if name not in verdict.estimate]
        if missing:
            return f"the log does not say what it read of {', '.join(missing)}"
        try:
            why = known.why_not_good(verdict.estimate) or ""
            return ANY_COMMAND + why if why and known.judges_commands else why
        except Exception as error:  # noqa: BLE001 - whatever it is, nothing is confirmed
            return reason_in_words(error)

    def _tubes_by_plan(self, system: str, module: str) -> dict[str, ModuleTube] | str:
        """The tube of each plan of a module, computed only once; or why it cannot be made."""
        key = system, module
        if key not in self._followers:
            proved = self._proved[system], module
            entry = next(e for e in self._entries if (e["system"], e["module"]) == proved)
            try:
                plans = entries_of_plans(self._flat_of(proved[0]), entry)
                self._followers[key] = {name: tube_of_entry(*of) for name, of in plans.items()}
            except Exception as error:  # noqa: BLE001 - as above
                self._followers[key] = reason_in_words(error)
        return self._followers[key]

    # ------------------------------------------------------------ of which program

    def _system_of(self, log: str) -> str:
        """The system that flew in a log. Raises D023 if the certificate is about another."""
        header = log_metadata(Path(log))
        if not header:
            raise unreadable_error(Path(log), "it does not say what flew")
        system, sha256 = header.get("system", ""), self._sha256
        if header.get("program_sha256") != sha256:
            other = header.get("program_sha256", "none")
            raise _other_flight_error(
                log, f"its program is {other[:12]}, that of the certificate {sha256[:12]}"
            )
        of_entries = dict.fromkeys(e["system"] for e in self._entries)
        assert self._checked.program is not None
        if system in self._checked.program.systems:
            self._proved[system] = (self._flat_of(system).proved or self._flat_of(system)).name
        if self._proved.get(system) not in of_entries:
            names = ", ".join(f"`{n}`" for n in of_entries)
            why = f"system `{system}` flew, and the certificate is about {names}"
            prove = f"`soter verify --system {system}` proves what flew, without its `faults`"
            raise _other_flight_error(log, why, prove)
        proved = {name: text for name, (text, _) in changed_parameters(self._flats[system]).items()}
        begin = len(PARAMETER)
        flown = {name[begin:]: text for name, text in header.items() if name.startswith(PARAMETER)}
        for name in sorted(proved.keys() | flown.keys()):
            values = [of.get(name, "the default") for of in (flown, proved)]
            if values[0] != values[1]:
                text = f"{name} was {values[0]} in it, and is {values[1]} in the certificate"
                raise _other_flight_error(log, text)
        return system

    def _flat_of(self, system: str) -> System:
        if system not in self._flats:
            flat = system_to_prove(self._checked, system, self._overrides, exact=False)
            self._flats[system] = flat
        return self._flats[system]


def _other_flight_error(log: str, why: str, help_: str = SAME_PROGRAM) -> SoterError:
    return SoterError((Diagnostic("D023", f"`{log}` is of another flight: {why}", helps=(help_,)),))


def _cpu_seconds() -> float:
    """CPU seconds so far of this process and its finished children."""
    t = os.times()
    return t.user + t.system + t.children_user + t.children_system

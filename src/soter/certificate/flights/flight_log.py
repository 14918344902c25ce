"""What the log of a flight says of the verdicts of decision modules that follow SC.

Purpose: `read_flight`: from an MCAP of `soter run --log` to every verdict of every such module,
with what it says that it read, and all in which the log contradicts itself or the program.
Non-goals: whether a verdict was right (`flight_check.py`); logs of somebody else.

The argument: a verdict is one about what was published. So each read has to be the value that the
log has of that topic at that time, and the newest one before the verdict; where an instant has
both, either counts, as the program's order decides it and a fresh one is as good. Verdicts are due
at each release of the module: one that is missing, or came later than the module may start, is
named wherever AC had control. An instant is judged when it is over; of a file that is cut the last
instant may be half there, and is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from soter.certificate.flights.flight_report import CONTRADICTED, Doubt
from soter.certificate.reading.symbolic_values import flat
from soter.diagnostics.diagnostic import Diagnostics
from soter.language.check.constants import Calculator
from soter.language.model.python_values import ValueShapeError, from_json
from soter.language.model.types import FloatType, RecordType, has_list, leaf_name, leaves
from soter.report.mcap_log import DECISIONS_TOPIC, MODES_TOPIC
from soter.report.run_log import messages, unreadable

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from soter.language.model.system import Module, System
    from soter.language.model.types import Value

AGAINST = ("ttf", "stale")
"""Predicates of which none is true in a verdict "AC"."""


@dataclass(frozen=True)
class LoggedVerdict:
    """A verdict "AC": when (ns), whose, and the leaves of all that it read, by `topic.leaf`."""

    time_ns: int
    module: str
    estimate: dict[str, float]


@dataclass
class FlightLog:
    """Verdicts "AC" in order of time; `others`: how many said "SC"; `doubts`: see above.

    `to_ns`: up to where the log was read; `cut`: why it was not read to its end, "" where it was.
    `unlogged`: topics that were read, and of which there is no message.
    """

    verdicts: list[LoggedVerdict] = field(default_factory=list)
    others: int = 0
    doubts: list[Doubt] = field(default_factory=list)
    to_ns: int = 0
    cut: str = ""
    unlogged: dict[str, None] = field(default_factory=dict)


def read_flight(path: Path, system: System, modules: Sequence[Module]) -> FlightLog:
    """The verdicts of `modules` of `system`; SoterError D006 for what is no such log."""
    log = FlightLog()
    reader = _Reader(path, system, modules, log)
    due: list[tuple[str, dict[str, Any]]] = []
    now: int | None = None

    def cut(why: str) -> None:
        log.cut = why

    for time_ns, channel, message in messages(path, cut):
        if now is not None and time_ns > now:
            reader.instant(now, due)
            due = []
        now = time_ns
        due.append((channel, message))
    if now is not None and not log.cut:
        reader.instant(now, due)
    reader.end(log.to_ns)
    log.doubts.sort(key=lambda d: d.time_ns)
    return log


class _Verdicts:
    """The verdicts of one module, as they come."""

    def __init__(self, module: Module) -> None:
        self.name, self.period, self.late = module.name, module.period_ns, module.late_ns
        self.response = _response_ns(module)
        self.next = 0
        """The release of which the verdict is still missing."""
        self.said: bool | None = None
        """Whether the verdict before it was "AC"; None: that one is missing, or there is none."""
        self.in_ac = self.flew = False
        """Whether AC has control, and whether it had since the last verdict."""

    def changed(self, in_ac: bool) -> None:
        """The log says who has control from here on."""
        self.in_ac = in_ac
        self.flew |= in_ac

    def doubts_of(self, time_ns: int, said: dict[str, Any]) -> Iterator[str]:
        """What is wrong with a verdict for its place among the others, and with its own words."""
        before, after = (said[f"mode_{at}"] == "AC" for at in ("before", "after"))
        release = time_ns // self.period * self.period
        if release < self.next:
            yield "it is the second one of its period"
            return
        began, ended = (time_ns - release + said.get(at, 0) for at in ("late_ns", "done_ns"))
        if (before or after) and began > self.late:  # the one before it counts until then
            yield f"it came {began} ns after its release, and may {self.late} ns"
        elif (before or after) and ended > self.late + self.response:
            most = self.late + self.response
            yield f"it was there {ended} ns after its release, and may {most} ns"
        if self.said is not None and self.said != before and release == self.next:
            yield f"{_mode(before)} had control before it, and {_mode(self.said)} by the one before"
        if after != self.in_ac:
            yield f'it says "{_mode(after)}", and {_mode(self.in_ac)} has control'
        predicates = said["predicates"]
        false = [name for name in AGAINST if predicates[name]]
        if before:  # SC gives control back after a fault of AC, too (docs/semantics.md)
            false += ["gate_fault"] if predicates["gate_fault"] else []
        else:
            false += ["safer"] if not predicates["safer"] else []
        if after and false:
            yield f'it says "AC" against its own {", ".join(false)}'
        self.next, self.said, self.flew = release + self.period, after, self.in_ac

    def missing(self, before_ns: int, *, in_ac: bool = False) -> str:
        """What is missing of the releases before a time, if AC had control; `in_ac`: just then."""
        count = -((self.next - before_ns) // self.period) if before_ns > self.next else 0
        if not count or not (self.flew or in_ac):
            return ""
        return f"{count} verdicts are" if count > 1 else "the verdict is"


def _response_ns(module: Module) -> int:
    """How long the step of a decision module may take."""
    said = module.symbol.verify.response_dm
    given = Calculator(Diagnostics(), module.scope.params).value(said, "a time") if said else 0
    return given if isinstance(given, int) else 0


def _mode(in_ac: bool) -> str:
    return "AC" if in_ac else "SC"


class _Reader:
    """What is known while a log goes by."""

    def __init__(
        self, path: Path, system: System, modules: Sequence[Module], log: FlightLog
    ) -> None:
        self.path, self.system, self.log = path, system, log
        self.modules = {m.name: _Verdicts(m) for m in modules}
        self.topics = {t.name: t for t in system.topics}
        self.outside = {e.topic for e in system.externals}
        self.published: dict[str, list[tuple[int, Value]]] = {}
        """Of each topic of which the log has messages: the last two, the newest one first."""
        self.begun = False

    def instant(self, time_ns: int, due: Sequence[tuple[str, dict[str, Any]]]) -> None:
        """All that the log has of one instant; SoterError D006 for what it cannot mean."""
        self.log.to_ns, self.begun = time_ns, True
        try:
            for channel, message in due:
                if channel in self.topics:
                    value = self._message(channel, message)
                    before = self.published.get(channel, [])
                    self.published[channel] = [(time_ns, value), *before[:1]]
                elif channel == MODES_TOPIC and message["module"] in self.modules:
                    self.modules[message["module"]].changed(message["mode"] == "AC")
            for channel, message in due:
                if channel == DECISIONS_TOPIC and message["module"] in self.modules:
                    self._verdict(time_ns, message)
        except (ValueShapeError, LookupError, TypeError, ValueError, AttributeError) as error:
            said = error if isinstance(error, ValueShapeError) else repr(error)
            why = f"at {time_ns} ns: {said}; is it a log of `{self.system.name}`?"
            raise unreadable(self.path, why) from error

    def end(self, time_ns: int) -> None:
        """The log was read up to here, this instant included."""
        for name, module in self.modules.items():
            if module.next == 0 and self.begun:
                text = "the log has no verdict of it"
                self.log.doubts.append(Doubt(0, name, CONTRADICTED, text))
            self._missing(name, module.missing(time_ns + 1), module.next)

    def _missing(self, name: str, what: str, since_ns: int) -> None:
        if what:
            text = f"{what} missing while AC had control"
            self.log.doubts.append(Doubt(since_ns, name, CONTRADICTED, text))

    def _verdict(self, time_ns: int, message: dict[str, Any]) -> None:
        name = message["module"]
        module = self.modules[name]
        release = time_ns // module.period * module.period
        was_ac = message["mode_before"] == "AC"
        self._missing(name, module.missing(release, in_ac=was_ac), module.next)
        why = list(module.doubts_of(time_ns, message))
        estimate: dict[str, float] = {}
        if message["mode_after"] == "AC":
            for topic, read in message.get("reads", {}).items():
                why += self._read(time_ns, topic, read, estimate)
            self.log.verdicts.append(LoggedVerdict(time_ns, name, estimate))
        else:
            self.log.others += 1
        self.log.doubts += [Doubt(time_ns, name, CONTRADICTED, w, estimate) for w in why]

    def _read(
        self, time_ns: int, name: str, read: dict[str, Any], estimate: dict[str, float]
    ) -> Iterator[str]:
        """Adds the leaves of what was read; what speaks against it."""
        topic, age = self.topics[name], read["age_ns"]
        value = from_json(topic.type, read["value"], name)
        if not has_list(topic.type):
            pairs = zip(leaves(topic.type), flat(value), strict=True)
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
            self.log.unlogged[name] = None
            return
        if topic.index in self.outside:  # measured before it came, and read as it has come
            came, known = last[0]
            if time_ns - age > came:
                yield f"it read {name} of {time_ns - age} ns, and the last one came at {came} ns"
            elif repr(known) != repr(value):
                yield f"it read another {name} than the last one, which came at {came} ns"
            return
        possible = last if last[0][0] == time_ns else last[:1]
        there = dict(possible).get(time_ns - age)
        if there is None:
            yield f"it read {name} of {time_ns - age} ns, and the last one is of {last[0][0]} ns"
        elif repr(there) != repr(value):  # bit by bit: -0.0 is another number than 0.0
            yield f"it read {name} of {time_ns - age} ns, and the log has another value of then"

    def _message(self, channel: str, message: dict[str, Any]) -> Value:
        """A message as a value of its topic."""
        of = self.topics[channel].type
        given = message if isinstance(of, RecordType) else message["value"]
        return from_json(of, given, channel)

"""What a log of a flight says against the assumptions that its certificate prints.

Purpose: `LoggedAssumptions` is told every message and verdict of a log, instant by instant, and has
a `Doubt` wherever these contradict an assumption on sensors, on the times of SC, or on sets.
Non-goals: verdicts by themselves, and their reads (`flight_check.py`); disturbances, which the
states of a log do not show (`soter monitor` asks a model).

The assumptions and what contradicts each: *sensors publish exactly at their releases*: a message at
another time; *sensors never drop out*, or are *silent for O longer than their periods at most*: a
release, or more, without a message; *the DM says "AC" on one instant alone*: two reads of plants
that publish together with other ages, or of sensors further apart than `every` and `delayed` say;
*no release is skipped* and SC's `late` and `response`: a release of SC in control without outputs
in time; *SC waits for the DM*: an output of a release of SC before the verdict for which it waits;
*binary64 is computed as IEEE 754 says*: an output of SC in control that its step gives on
nothing that it may have read; *what is published lies in the declared sets*: a message that does
not; *errors of sensors stay within their bounds*: a message further from what the plant drives in
the state that a simulation logs beside it.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from itertools import combinations, product
from math import prod
from typing import TYPE_CHECKING

from soter.certificate.reading.symbolic_values import scalar_leaves
from soter.certificate.report import CONTRADICTED, Doubt
from soter.language.check.constants_and_types import declared_ns
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.model.types import FloatType, has_list, leaf_name, leaves, show_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from soter.language.model.system import Component, Module, System, Topic
    from soter.language.model.types import Value

UNKNOWN = (LookupError, RuntimeError, StepFault)
"""What the evaluator raises where code of a plant reads what no log has: inputs, a choice."""

READS_MAX = 4096
"""So many combinations of what SC may have read are tried."""


@dataclass(eq=False)
class _Sensor:
    """The times at which a topic has to be published, by a plant or by a sensor from outside.

    `apart_ns`: the longest time between publications without a silence; `delay_ns`: the greatest
    age of what a sensor publishes.
    """

    apart_ns: int
    releases: tuple[int, int] | None
    """Period and phase of its plant; None: it is outside of the system."""
    delay_ns: int = 0
    last_ns: int | None = None


def _sensors_by_topic(system: System) -> dict[str, _Sensor]:
    """Maps each topic that shows the world at a known rate to its sensor."""
    found = {}
    for c in system.components:
        if c.plant is not None:
            for index in c.writes:
                name = system.topics[index].name
                found[name] = _Sensor(c.period_ns, (c.period_ns, c.phase_ns))
    for e in system.externals:
        if e.every_ns is not None:
            delay = e.delay_ns or 0
            found[system.topics[e.topic].name] = _Sensor(e.every_ns + delay, None, delay)
    return found


@dataclass(eq=False)
class _Outputs:
    """The outputs of a module's SC: its releases, and the releases whose outputs are still due.

    `since`: the release of its last verdict other than "AC"; None while AC has control. `plan`: the
    number of the plan that SC follows since the last verdict "AC". `read`: for each topic that SC
    reads, the last messages, which its latest step may have read. SC starts up to `late` after its
    release, or waits `waits` for the DM, and publishes up to `response` later.
    """

    module: Module
    period: int
    phase: int
    topics: tuple[str, ...]
    late: int
    waits: int
    response: int
    since: int | None = None
    plan: int = 0
    next_release: int = 0
    published: dict[str, int] = field(default_factory=dict)
    read: dict[str, list[tuple[int, Value]]] = field(default_factory=dict)

    @property
    def max_delay(self) -> int:
        """The longest time (ns) from a release of SC until its step publishes."""
        return max(self.late, self.waits) + self.response


class LoggedAssumptions:
    """Compares a log with the assumptions on sensors, on the times of SC, and on declared sets."""

    def __init__(self, system: System, modules: Sequence[Module]) -> None:
        self.system, self.modules = system, modules
        self.doubts: list[Doubt] = []
        self._sensors = _sensors_by_topic(system)
        self._evaluators = {c.index: Evaluator(c.scope.params) for c in system.components}
        self._latest: dict[str, tuple[int, Value]] = {}
        self._topics = {t.name: t for t in system.topics}
        self._read = {m.name: _names_read_by(system, m) & self._sensors.keys() for m in modules}
        self._outputs = {}
        self._steps: dict[str, Callable[[Environment], object]] = {}
        for m in modules:
            sc, verify = system.components[m.sc], m.symbol.verify
            assert sc.node is not None
            names = tuple(system.topics[i].name for i in m.outputs)
            declared = verify.late_sc, verify.response_dm, verify.response_sc
            late, spoken, response = (declared_ns(m, e) for e in declared)
            times = sc.period_ns, sc.phase_ns, names, late, m.late_ns + spoken, response
            of_sc = (system.topics[sc.scope.topics[s.topic]].name for s in sc.node.subscribes)
            read: dict[str, list[tuple[int, Value]]] = {name: [] for name in of_sc}
            self._outputs[m.name] = _Outputs(m, *times, next_release=sc.phase_ns, read=read)
            self._steps[m.name] = Evaluator.for_scope(sc.scope).compiled_block(sc.node.step)

    def _note_doubt(self, time_ns: int, module: Module, text: str) -> None:
        self.doubts.append(Doubt(time_ns, module.name, CONTRADICTED, text))

    # ------------------------------------------------------------ messages

    def note_message(self, time_ns: int, name: str, value: Value) -> None:
        """Compares a message with its set and release, and the silence before it with its limit."""
        self._latest[name] = time_ns, value
        for text in self._leaves_outside_set(name, value):
            for m in self.modules:
                self._note_doubt(time_ns, m, text)
        for outputs in self._outputs.values():
            self._check_due_outputs(outputs, time_ns - 1)
            if name in outputs.topics:
                outputs.published[name] = time_ns
            if name in outputs.read:
                outputs.read[name].append((time_ns, value))
        if (sensor := self._sensors.get(name)) is not None:
            at = sensor.releases
            if at is not None and ((time_ns - at[1]) % at[0] or sensor.last_ns == time_ns):
                for m in self._modules_reading(name):
                    text = f"{name} was published otherwise than once at a release of its plant"
                    self._note_doubt(time_ns, m, text)
            self._check_silence(name, sensor, time_ns)
            sensor.last_ns = time_ns

    def _leaves_outside_set(self, name: str, value: Value) -> Iterator[str]:
        topic = self._topics[name]
        if has_list(topic.type):
            return
        every = zip(leaves(topic.type), topic.bounds, scalar_leaves(value), strict=True)
        for (path, _), bound, x in every:
            if bound is not None and not bound.low <= x <= bound.high:
                where = f"[{bound.low!r}, {bound.high!r}]"
                yield f"{leaf_name(name, path)} is {x!r}, outside of its set {where}"

    def note_truth(self, time_ns: int, plant: Component, states: Sequence[Value]) -> None:
        """Compares the states of a plant with the values that it published at that time."""
        assert plant.plant is not None
        env = Environment(dict(zip(plant.plant.states, states, strict=True)), time_ns=time_ns)
        value = self._evaluators[plant.index].value
        for variable, of in plant.plant.lets:
            with suppress(*UNKNOWN):
                env.variables[variable] = value(of, env)
        for symbol, of in plant.plant.drives:
            topic = self.system.topics[plant.scope.topics[symbol]]
            when, shown = self._latest.get(topic.name, (None, 0.0))
            if when == time_ns:
                with suppress(*UNKNOWN):
                    self._compare_with_truth(time_ns, plant, topic, shown, value(of, env))

    def _compare_with_truth(
        self, time_ns: int, plant: Component, topic: Topic, shown: Value, true: Value
    ) -> None:
        """Adds a doubt for each published number whose error exceeds its bound."""
        errors = {m.leaf: m.bound for m in plant.measured if m.topic == topic.index}
        every = zip(leaves(topic.type), scalar_leaves(shown), scalar_leaves(true), strict=True)
        for k, ((path, of), x, y) in enumerate(every):
            error = errors.get(k, 0.0)
            if isinstance(of, FloatType) and not y - error <= x <= y + error:
                name = leaf_name(topic.name, path)
                for m in self._modules_reading(topic.name):
                    text = f"{name} is {x!r} where the plant is at {y!r}, measured within {error!r}"
                    self._note_doubt(time_ns, m, text)

    def _modules_reading(self, name: str) -> list[Module]:
        return [m for m in self.modules if name in self._read[m.name]]

    def _check_silence(self, name: str, sensor: _Sensor, until_ns: int) -> None:
        """Adds a doubt if a topic was silent for longer than allowed before `until_ns`."""
        for m in self._modules_reading(name):
            silent = declared_ns(m, m.symbol.verify.dropout)
            if sensor.last_ns is None:
                first = sensor.releases[1] if sensor.releases else sensor.apart_ns
                missing, since = until_ns > first, 0
            else:
                since = sensor.last_ns
                missing = until_ns - since > sensor.apart_ns + silent
            if missing:
                most = f"sensors are silent for {show_ns(silent)} longer than that at most"
                allowed = most if silent else "sensors never drop out"
                self._note_doubt(
                    since,
                    m,
                    f"nothing came of {name} for {show_ns(until_ns - since)}, it is published "
                    f"every {show_ns(sensor.apart_ns)}, and {allowed}",
                )

    # ------------------------------------------------------------ verdicts

    def note_verdict(self, time_ns: int, module: Module, *, is_ac: bool, plan: str = "") -> None:
        """Notes which controller has control after a verdict, and which plan SC follows."""
        outputs = self._outputs[module.name]
        self._check_due_outputs(outputs, time_ns - 1)
        asked = time_ns - time_ns % module.period_ns  # SC waits for a verdict that is late
        for name, at in outputs.published.items() if outputs.since is not None else ():
            began = at - outputs.max_delay
            if began + (outputs.phase - began) % outputs.period >= asked and at < time_ns:
                self._note_doubt(
                    at, module, f"SC published {name} before the verdict of its release"
                )
        if is_ac:
            outputs.since = None
            names = [p.name for p in module.symbol.plans]
            outputs.plan = names.index(plan) if plan in names else 0
        elif outputs.since is None:
            outputs.since = time_ns
            outputs.next_release = asked + (outputs.phase - asked) % outputs.period

    def why_not_one_instant(self, ages: Mapping[str, int]) -> Iterator[str]:
        """Why reads of these ages (ns, by topic) under one verdict "AC" are not of one instant."""
        for one, other in combinations([n for n in ages if n in self._sensors], 2):
            a, b = self._sensors[one], self._sensors[other]
            if a.releases != b.releases:
                continue
            most = 0 if a.releases else max(a.apart_ns, b.apart_ns)
            if (apart := abs(ages[one] - ages[other])) > most:
                yield f"it read {one} and {other} of instants that are {apart} ns apart"

    # ------------------------------------------------------------ SC, and the end

    def end_instant(self, time_ns: int) -> None:
        """Adds the doubts about outputs of SC that are overdue, or that SC cannot have computed."""
        for outputs in self._outputs.values():
            self._check_due_outputs(outputs, time_ns)
            began = time_ns - outputs.max_delay
            for of in outputs.read.values():
                while len(of) > 1 and of[1][0] < began:
                    del of[0]
            if outputs.since is None or outputs.since == time_ns:
                continue  # AC may have published in this instant
            for name in outputs.topics:
                if outputs.published.get(name) == time_ns and not self._may_publish(outputs, name):
                    why = f"SC published {name}, which its step gives on nothing it may have read"
                    self._note_doubt(time_ns, outputs.module, why)

    def _may_publish(self, outputs: _Outputs, name: str) -> bool:
        """Whether SC's step gives the published value for messages that SC may have read."""
        if not 0 < prod(map(len, outputs.read.values())) <= READS_MAX:
            return True  # no message of what it reads, or too many
        topics = [t.default for t in self.system.topics]
        for values in product(*(reversed(of) for of in outputs.read.values())):
            for read, (_, value) in zip(outputs.read, values, strict=True):
                topics[self._topics[read].index] = value
            if outputs.module.plan is not None:
                topics[outputs.module.plan] = outputs.plan
            env = Environment(topics=topics)
            try:
                self._steps[outputs.module.name](env)
            except UNKNOWN:
                return True
            if repr(env.published.get(self._topics[name].index)) == repr(self._latest[name][1]):
                return True
        return False

    def _check_due_outputs(self, outputs: _Outputs, until_ns: int) -> None:
        """Adds a doubt for each release of SC in control whose outputs are overdue and missing."""
        while outputs.since is not None and self._outputs_due_ns(outputs) <= until_ns:
            release = outputs.next_release
            outputs.next_release += outputs.period
            for name in outputs.topics:
                if outputs.published.get(name, -1) < max(release, outputs.since):
                    text = f"SC published no {name} in time after its release"
                    self._note_doubt(release, outputs.module, text)

    def _outputs_due_ns(self, outputs: _Outputs) -> int:
        """The time in ns by which the outputs of SC's next release must be published."""
        asked = outputs.next_release - outputs.next_release % outputs.module.period_ns
        return max(outputs.next_release + outputs.late, asked + outputs.waits) + outputs.response

    def end_log(self, time_ns: int) -> None:
        """Judges the silences until the end of the log."""
        for name, sensor in self._sensors.items():
            if sensor.last_ns is not None:
                self._check_silence(name, sensor, time_ns)


def _names_read_by(system: System, module: Module) -> set[str]:
    read = {*module.inputs, *system.components[module.sc].scope.topics.values()}
    return {system.topics[i].name for i in (*read, *module.scope.topics.values())}

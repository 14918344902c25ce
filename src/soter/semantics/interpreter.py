"""The reference interpreter: a driver that decides which rule comes next.

Purpose: runs of a system in virtual time. The two choices the paper leaves open, the next node
of FN and the environment's inputs, are functions passed in; by default they are those of the
deployed drivers (docs/semantics.md, Deployed order).
Non-goals: speed, logs, searching (`explore/` brings its own choices).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.system import Bound
from soter.language.model.types import leaf_count
from soter.semantics.configuration import (
    AC,
    NEVER,
    SC,
    ComponentRecord,
    Configuration,
    ModuleRecord,
    PropertyRecord,
    Record,
    enabled_at_first,
)
from soter.semantics.draws import chosen_value
from soter.semantics.environment import plant_step, refusal
from soter.semantics.executable_system import ExecutableSystem
from soter.semantics.externs import reset
from soter.semantics.faults import in_any_order
from soter.semantics.properties import violated
from soter.semantics.publication_gate import publish, to_ends
from soter.semantics.rules import (
    ac_or_sc_step,
    discrete_time_progress_step,
    dm_step,
    environment_input,
    next_instant,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from soter.language.evaluate.arithmetic import FaultKind
    from soter.language.model.system import Component, InputDrive, Module, System
    from soter.language.model.types import Value
    from soter.semantics.configuration import DecisionVerdict, StepOutcome
    from soter.semantics.draws import Draws

    ChooseNode = Callable[[Configuration], int]
    ChooseInput = Callable[[Configuration], Iterable[tuple[int, Value]]]
    Observe = Callable[[Configuration, Record], object]


def deployed_order(c: Configuration) -> int:
    """The choice of deployed drivers: plants, DMs, SCs, the rest; ties by declaration."""
    return c.FN[0]


class Interpreter:
    """Runs of one system under one seed.

    `externs` maps the names of extern nodes, plants and functions to callables of one argument
    (functions: of their own arguments), or to objects with a method `step` and perhaps
    `reset(seed)`; see `language/model/values.py` for what they get and may give. Raises
    `UnboundExternError` where one is missing. `draws` chooses what is left to the environment.
    """

    def __init__(
        self,
        system: System,
        seed: int = 0,
        externs: Mapping[str, object] | None = None,
        draws: Draws | None = None,
    ) -> None:
        self.system = system
        self._externs = externs or {}
        self.machine = ExecutableSystem(system, seed, self._externs, draws)

    # ------------------------------------------------------------ the start

    def initial(self) -> Configuration:
        """(L0, OE0, ct0, FN0, Topics0); externs that can are reset (`ExternResetError`)."""
        for name, bound in self._externs.items():
            reset(name, bound, self.machine.seed)
        components, modules = self.system.components, self.system.modules
        return Configuration(
            L=tuple([self._first_state(n) for n in components]),
            OE=enabled_at_first(self.system, [_first_mode(m) for m in modules]),
            ct=-1,
            FN=(),
            Topics=tuple([topic.default for topic in self.system.topics]),
            stamps=(NEVER,) * len(self.system.topics),
            latched=(False,) * len(components),
            had_control=(False,) * len(components),
            gate_fault=(False,) * len(modules),
            clean_needed=(0,) * len(modules),
        )

    def record(self) -> Record:
        """An empty record for a run from `initial()`."""
        return Record(
            modules=[ModuleRecord(_first_mode(m)) for m in self.system.modules],
            components=[ComponentRecord() for _ in self.system.components],
            properties=[
                PropertyRecord(contract=p.component is not None) for p in self.system.properties
            ],
        )

    def _first_state(self, n: Component) -> Value:
        if n.role == "dm":
            return _first_mode(self._module_of(n))
        if n.plant is None:
            return n.initial
        return tuple([self._first_plant_state(n, i) for i in range(len(n.plant.states))])

    def _first_plant_state(self, n: Component, i: int) -> Value:
        span = n.initial_range[i] if i < len(n.initial_range) else None
        if span is None:
            return n.initial[i]
        assert n.plant is not None, n.name
        state = n.plant.states[i]
        bounds = [Bound(*span)] * leaf_count(state.type)
        return chosen_value(
            state.type, bounds, self.machine.draws, f"{n.name}.{state.name}.start", 0
        )

    def _module_of(self, n: Component) -> Module:
        assert n.module is not None, n.name
        return self.system.modules[n.module]

    # ------------------------------------------------------------ transitions

    def enabled(self, c: Configuration) -> tuple[int, ...]:
        """The components that may fire next; none means that time may progress."""
        return c.FN

    def fire(self, c: Configuration, n: int) -> tuple[Configuration, DecisionVerdict | StepOutcome]:
        """The step of component `n` of FN, whichever rule it takes, and what it had to say."""
        role = self.system.components[n].role
        if role == "plant":
            return plant_step(self.machine, c, n)
        if role == "dm":
            return dm_step(self.machine, c, n)
        return ac_or_sc_step(self.machine, c, n)

    def next_node(self, c: Configuration) -> int:
        """The choice of deployed drivers; plants first, then any, where the system says so."""
        first = deployed_order(c)
        if not self.system.shuffled or self.system.components[first].role == "plant":
            return first
        return c.FN[in_any_order(self.machine.seed, c.ct, len(c.FN))]

    def publish(self, c: Configuration, published: Mapping[int, Value]) -> Configuration:
        """Values reach topics and their queues, for drivers that hold publications back."""
        return publish(self.system.topics, c, published)

    def publish_input(
        self, c: Configuration, topic: int, value: Value, time_ns: int, *, within: bool = False
    ) -> tuple[Configuration, FaultKind | None]:
        """A value from outside, measured at `time_ns`: `soter_publish` of `runtime/soter.h`.

        Stamped so where the topic takes it; else nothing changes and the kind says why (`refusal`).
        `within`: for a driver that moved time and has not ended the instant. C knows by itself; a
        configuration with FN empty looks the same before and after.
        """
        refused = refusal(self.machine, c, topic, value, time_ns, within=within)
        if refused is not None:
            return c, refused
        taken = to_ends(self.system.topics[topic], value)
        return environment_input(self.machine, c, topic, taken, time_ns), None

    def due_inputs(self, c: Configuration) -> Iterable[tuple[int, Value]]:
        """The inputs of the virtual-time driver at ct: the seeded draws of `input t every d`."""
        for drive in self.system.inputs:
            if c.ct % drive.every_ns == 0:
                yield drive.topic, self.drawn_input(drive, c.ct)

    def drawn_input(self, drive: InputDrive, ct: int) -> Value:
        """The value that the draws choose for an input at ct."""
        topic, draws = self.system.topics[drive.topic], self.machine.draws
        stream, index = f"input.{topic.name}", ct // drive.every_ns
        if drive.values:
            return drive.values[draws.choice(stream, index, len(drive.values))]
        return chosen_value(topic.type, topic.bounds, draws, stream, index)

    def instant(
        self,
        c: Configuration,
        choose_node: ChooseNode | None = None,
        choose_input: ChooseInput | None = None,
        record: Record | None = None,
    ) -> Configuration:
        """One whole instant: time progresses, inputs change, all of FN fires.

        `choose_node` gets a configuration and picks from its FN; `choose_input` gives the
        inputs, (topic index, value), of the instant that begins. A `record` is added to.
        """
        choose = choose_node or self.next_node
        c = discrete_time_progress_step(self.machine, c)
        for topic, value in (choose_input or self.due_inputs)(c):
            c = environment_input(self.machine, c, topic, value)
        while c.FN:
            c, event = self.fire(c, choose(c))
            if record is not None:
                record.note(event, c.ct)
        if record is not None:
            record.note_properties(violated(self.machine, c), c.ct)
        return c

    def run(
        self,
        until_ns: int | None = None,
        observe: Observe | None = None,
        choose_node: ChooseNode | None = None,
        choose_input: ChooseInput | None = None,
    ) -> tuple[Configuration, Record]:
        """All instants up to and including `until_ns` (by default the system's own `until`).

        `observe` sees the configuration and the record after every instant.
        """
        until = self.system.until_ns if until_ns is None else until_ns
        assert until is not None, "the system says no `until`: pass one"
        c, record = self.initial(), self.record()
        while next_instant(self.machine, c) <= until:
            c = self.instant(c, choose_node, choose_input, record)
            if observe is not None:
                observe(c, record)
        return c, record


def _first_mode(module: Module) -> int:
    """SC, so that every module starts in safe hands; AC only where the system forces it."""
    return AC if module.forced == "ac" else SC

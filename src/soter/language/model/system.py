"""One system of a program, flattened: every number known, every instance named.

Purpose: the static half of a transition system: what runs, how often, on which topics, in
which deployed order. Interpreter, lowering, simulation and reach all start here.
Non-goals: behaviour (`semantics/`), storage (`core/layout.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.typed import (
        ModuleSymbol,
        NodeSymbol,
        ParamSymbol,
        PlantSymbol,
        TopicSymbol,
        TypedExpr,
        TypedProgram,
        Variable,
    )
    from soter.language.model.types import Type, Value

LEVELS_DEFAULT, LEVELS_LEAST = 3, 2


@dataclass(frozen=True)
class Bound:
    """Closed bounds of one scalar leaf: floats, or ints for int leaves."""

    low: float
    high: float


@dataclass(eq=False)
class Topic:
    """A topic of the system; `name` is its full dotted name (`d.control`).

    `bounds` has one entry per leaf of `leaves(type)`; None where every (finite) value of the
    type is allowed. `set_declared` says whether the program bounded every float and int leaf.
    """

    index: int
    name: str
    symbol: TopicSymbol
    type: Type
    bounds: tuple[Bound | None, ...]
    set_declared: bool
    default: Value
    max_age_ns: int | None
    driver: str
    """Name of the plant or node that drives it, "M" for a module, "input", or "" (nobody)."""
    queue_of: int | None = None
    """For the queue of a subscription: the topic whose values it collects. Its type is a list."""
    policy: str = ""
    """Of a queue that is full: drop_oldest, drop_newest or fault (of the subscriber)."""
    queues: tuple[int, ...] = ()
    """The queues that take what is published here."""
    held: bool = False
    """Whether it is no topic of the program: it holds what a node that `takes` time published, or
    what a DM saw, for those who read `margin`."""


@dataclass(eq=False)
class Scope:
    """What names of a declaration mean in one instance."""

    topics: dict[TopicSymbol, int]
    params: dict[ParamSymbol, Value]
    plants: dict[str, int] = field(default_factory=dict)
    modules: dict[ModuleSymbol | str, int] = field(default_factory=dict)


@dataclass(eq=False)
class Disturbance:
    """A disturbance of a plant instance with its numbers; `hold_ns` 0: drawn each step.

    Every leaf has the stream `<plant>.<disturbance>[.<leaf path>]`; the draw for a step that
    ends at t has index (t - period) // hold (hold = period when 0).
    """

    variable: Variable
    low: float
    high: float
    hold_ns: int
    streams: tuple[str, ...]


@dataclass(eq=False)
class Measurement:
    """An error within +-bound on one leaf of a driven topic; index of the draw: t // period."""

    topic: int
    leaf: int
    bound: float
    stream: str


@dataclass(frozen=True)
class StandIn:
    """What a component stands for that a test replaced by its contract.

    `of`: full name of the module or node; `role`: of the node in it that is stood for, which has
    its place in the deployed order; `clauses`: what its publications satisfy; `left`: the clauses
    that nobody could ask for there; `asked`: the conditions of the others; `tried`: of which topics
    values were picked that are tried, those of its contract being more.
    """

    of: str
    kind: str
    role: str
    clauses: tuple[str, ...]
    left: tuple[str, ...]
    asked: tuple[TypedExpr, ...]
    span: Span
    tried: tuple[str, ...] = ()


@dataclass(eq=False)
class Component:
    """Anything the calendar releases: a plant, a DM or a node.

    `role`: "plant", "dm", "sc", "ac" or "node". Releases at phase + k * period, k >= 0.
    `order` is the position in the deployed order within an instant (ruling 5): plants, then
    DMs, then SCs, then the rest, ties by declaration.
    """

    index: int
    name: str
    role: str
    period_ns: int
    phase_ns: int
    scope: Scope
    span: Span
    module: int | None = None
    """For dm, sc and ac: index of the module."""
    node: NodeSymbol | None = None
    plant: PlantSymbol | None = None
    initial: tuple[Value, ...] = ()
    """First values of the node's locals or the plant's states (fixed ones)."""
    initial_range: tuple[tuple[float, float] | None, ...] = ()
    """For plants: states drawn uniformly at the start; stream `<plant>.<state>.start`, index 0
    (leaf paths appended for vector states)."""
    failsafe: dict[int, Value] = field(default_factory=dict)
    disturbances: tuple[Disturbance, ...] = ()
    measured: tuple[Measurement, ...] = ()
    substeps: int = 1
    binding: str | None = None
    """For externs: `python:file.py:name`, `c:file.c:name`, or None (must be bound to run)."""
    stands_for: StandIn | None = None
    takes_ns: tuple[int, int] | None = None
    """How long a step lasts, at least and at most; None: what it publishes counts at once."""
    held: int | None = None
    """Where steps last: the topic that holds its publications (`elaborate/step_times.py`)."""
    wcet_ns: int | None = None
    """What a step, or a decision, needs of its processor at most; None: not declared."""
    jitter_ns: int = 0
    """How late its release may be (docs/timing.md)."""
    inline: bool = False
    """Whether the system says that it runs in the thread of the trusted part."""

    @property
    def extern(self) -> bool:
        """Whether the step is done by a driver, not by Soter code."""
        return bool(self.node and self.node.extern) or bool(self.plant and self.plant.extern)

    @property
    def published(self) -> list[TopicSymbol]:
        """What it publishes, or drives, by the names of its declaration."""
        if self.plant is not None:
            return [t for t, _ in self.plant.drives]
        return [] if self.node is None else list(self.node.publishes)

    @property
    def writes(self) -> list[int]:
        """The same as topics of the system."""
        return [self.scope.topics[t] for t in self.published]

    @property
    def reads(self) -> list[int]:
        """Topics of the system that a plant reads, or a node subscribes to; none of a DM."""
        if self.plant is not None:
            return [self.scope.topics[t] for t in self.plant.reads]
        return (
            [] if self.node is None else [self.scope.topics[s.topic] for s in self.node.subscribes]
        )


@dataclass(eq=False)
class Shield:
    """How a module judges the commands of its AC (docs/semantics.md, Shields).

    `cells`: into how many each number of a command is cut; `topic`: the hidden topic that holds of
    each cell until when (s) a command of it was held. `held` is its next value where a command is
    published, `permits` whether all commands that may act then may do so until SC's first output
    acts; both None until they are computed. Of `toward sc` the hidden topic `proposed` has the
    numbers that AC would have published last, and behind them SC's; `moved` what AC does instead.
    """

    cells: int
    topic: int
    held: TypedExpr | None = None
    permits: TypedExpr | None = None
    proposed: int | None = None
    moved: tuple[TypedExpr, ...] = ()


@dataclass(eq=False)
class Module:
    """An RTA module instance; `dm`, `ac`, `sc` are component indices.

    `forced`: None, "ac" or "sc": a forced module's DM runs and records its predicates but the
    mode never changes (a system used as an experiment's control arm).
    `inputs`: topics that ttf and safer read; with a max_age each read is checked for staleness.
    `outputs`: gated topics.
    """

    index: int
    name: str
    symbol: ModuleSymbol
    dm: int
    ac: int
    sc: int
    period_ns: int
    scope: Scope
    clean: int
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    forced: str | None = None
    around: dict[ParamSymbol, Value] = field(default_factory=dict)
    """Parameters of the system whose topics it reads and gates; its own are those of `scope`."""
    over: int | None = None
    """The module that stands in the place of AC; `ac` is then that one's."""
    view: str = ""
    """As a view sees it (`elaborate/views_for_proofs.py`): `symbol` is a part, `whole` the one that
    flies."""
    whole: ModuleSymbol | None = None
    law: dict[int, Value] = field(default_factory=dict)
    """The fail-safe law: topic index -> what its actuator holds once the lease has ended; empty:
    none is declared."""
    late_ns: int = 0
    """How late a release of its DM may be (`late dm`)."""
    levels: int = LEVELS_DEFAULT
    """Of its predicates, where they are computed."""
    computed: bool = False
    """Whether `ttf` and `safer` were computed: a level of each group is compared with 1 and 2."""
    grid_ends: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Where they were: both ends of the axes of grids, by leaf of a topic."""
    unshown: str = ""
    """What decisions of a module with `rest` are based on, and nothing shows; "" with any other."""
    looks: int = 1
    """For how many periods of its DM AC keeps control after a look that found `safer` true."""
    looked: int | None = None
    """The topic that says what the DM saw last; None where nobody reads the module's `margin`."""
    latch: int | None = None
    """Where its DM does not give control back by itself: the topic in which it remembers why not
    (`elaborate/topics.py`)."""
    acknowledgement: int | None = None
    """With a `latch`: the topic after a press on which it gives control back; None: it never does,
    once AC has had it."""
    shield: Shield | None = None

    @property
    def reads(self) -> tuple[int, ...]:
        """All topics that its DM reads: `inputs`, and the acknowledgement."""
        if self.acknowledgement is None or self.acknowledgement in self.inputs:
            return self.inputs
        return (*self.inputs, self.acknowledgement)

    def looks_left(self, *, unsafe: bool, safer: bool) -> int:
        """How many periods from a look on AC surely keeps control; `unsafe`: not even this one."""
        return 0 if unsafe else self.looks if safer else 1

    def margin_ns(self, looks: int, age_ns: int) -> int:
        """What is left of `looks` periods when the look is `age_ns` old; 0 or more."""
        return max(looks * self.period_ns - self.late_ns - age_ns, 0)


@dataclass(eq=False)
class Property:
    """A property checked at the end of every instant: "always" or "never".

    With a `component` it is a contract of that node, "assumes" or "guarantees", checked as the
    node steps (docs/semantics.md).
    """

    index: int
    kind: str
    condition: TypedExpr
    scope: Scope
    text: str
    span: Span
    component: int | None = None


@dataclass(eq=False)
class InputDrive:
    """A seeded environment input: drawn at every multiple of `every_ns`, before all else.

    One stream `input.<topic>[.<leaf>]` a leaf, index = t // every. With `values` it is one of
    them, from the stream `input.<topic>`.
    """

    topic: int
    every_ns: int
    values: tuple[Value, ...] = ()


@dataclass(eq=False)
class External:
    """A topic that somebody outside of the system publishes or reads.

    What was said of what comes from outside, None where nothing was: it comes at least every
    `every_ns`, at most `delay_ns` after it was measured, and leaf k is at most `errors[k]` off.
    """

    topic: int
    every_ns: int | None
    delay_ns: int | None
    errors: tuple[float | None, ...]
    span: Span


@dataclass(eq=False)
class Metric:
    """What a campaign tells of runs: a number, looked at after instants, `every_ns` apart.

    Its histogram has `bins` equal parts of [low, high], and two for what lies below and above.
    """

    name: str
    value: TypedExpr
    scope: Scope
    every_ns: int
    low: float
    high: float
    bins: int
    span: Span


@dataclass(eq=False)
class TimedProperty:
    """A property that only a test has: "eventually", "leadsto" or "invariant" (docs/testing.md).

    `module` is the module of an invariant; the other two have `condition` and `within_ns`.
    """

    index: int
    kind: str
    premise: TypedExpr | None
    condition: TypedExpr | None
    within_ns: int
    module: int | None
    scope: Scope
    text: str
    span: Span
    asks: str = ""
    promises: str = ""
    """The premise and the condition as people read them: in a loop with its variables filled in."""


@dataclass(eq=False)
class TimingFault:
    """A node or DM that may be "late", "skip" or "overrun" (docs/testing.md).

    `least_ns` > 0 of an overrun: no fault, a node that says how long its steps take.
    """

    kind: str
    component: int
    by_ns: int
    at_most: int
    span: Span
    least_ns: int = 0


@dataclass(eq=False)
class Fault:
    """What goes wrong with one component in the runs of a system (docs/semantics.md, Faults).

    `kind`: "late" or "skip" of its releases; "nan", "stuck", "silent", "saturated", "bias",
    "noise", "scale" of the leaves (indices) of a topic that it publishes, or "scale" of one of its
    disturbances. Time is cut into slots of `slot_ns` (0: every release is one), each of them faulty
    with `probability`, drawn from `stream`. `amount`: of "late" times in ns, between which each
    release is late (the quantiles of the lateness); with a slot the longest time for which the
    component is held up. "wait": a release that falls together with one of the component `on`
    happens no earlier than that (`language/elaborate/step_times.py`). "overrun": a
    step that begins while it is there lasts `amount` longer, ns (`Component.held`). `apart`: never
    in two slots in a row. `inside`: None, or the assumption that it does not break; `text`: as it
    was written.
    """

    kind: str
    component: int
    stream: str
    probability: float
    slot_ns: int
    amount: tuple[float, ...] = ()
    topic: int | None = None
    leaves: tuple[int, ...] = ()
    disturbance: int | None = None
    on: int | None = None
    apart: bool = False
    inside: str | None = None
    text: str = ""

    @property
    def of_time(self) -> bool:
        """Whether it moves releases."""
        return self.kind in {"late", "skip", "wait"}


@dataclass(eq=False)
class TestPlan:
    """What a `test` block adds to its system. Times in ns; `quantum_ns` as declared.

    `ordered`: within an instant steps happen in the deployed order, inputs first.
    """

    name: str
    skew_ns: int
    horizon_ns: int
    quantum_ns: int | None
    faults: tuple[TimingFault, ...]
    timed: tuple[TimedProperty, ...]
    span: Span
    ordered: bool = False

    __test__ = False  # not a test of pytest's


@dataclass(eq=False)
class System:
    """A flattened system."""

    name: str
    program: TypedProgram
    topics: tuple[Topic, ...]
    components: tuple[Component, ...]
    """In deployed order: `components[i].index == i`."""
    modules: tuple[Module, ...]
    properties: tuple[Property, ...]
    inputs: tuple[InputDrive, ...]
    until_ns: int | None
    params: dict[str, Value]
    """Values of all parameters by full name; where an instance has its own, by its name, too
    (`r[0].GAIN`). `Scope.params` is what code sees."""
    hyperperiod_ns: int
    test: TestPlan | None = None
    """Set when the system was flattened for a `test` block, with its properties."""
    faults: tuple[Fault, ...] = ()
    """What goes wrong in its runs; no proof and no test is about them."""
    measures: tuple[Metric, ...] = ()
    """What campaigns tell of its runs."""
    externals: tuple[External, ...] = ()
    """Topics that somebody outside publishes or reads: it stands in the world, without plants."""
    proved: System | None = None
    """Of one that deploys another: that one, flattened under the same parameters."""
    certificate: str = ""
    """Of one that deploys another: the seal of the certificate whose verdicts it carries."""
    shuffled: bool = False
    """Whether the nodes of an instant step in an order that is drawn, not in the deployed one."""

    def topic(self, name: str) -> Topic:
        """The topic with this full name; KeyError when there is none."""
        for t in self.topics:
            if t.name == name:
                return t
        raise KeyError(name)

    def component(self, name: str) -> Component:
        """The component with this full name; KeyError when there is none."""
        for c in self.components:
            if c.name == name:
                return c
        raise KeyError(name)


def environment_topics(system: System) -> tuple[int, ...]:
    """The topics that only the environment sets: input topics, and what a driver draws."""
    drawn = {d.topic for d in system.inputs}
    return tuple(
        [
            t.index
            for t in system.topics
            if t.queue_of is None and (t.driver == "input" or t.index in drawn)
        ]
    )


def queues_of(system: System, component: Component) -> tuple[int, ...]:
    """The queues that a node reads, as topic indices."""
    if component.node is None:
        return ()
    read = [component.scope.topics[s.topic] for s in component.node.subscribes]
    return tuple([i for i in read if system.topics[i].queue_of is not None])


def modules_above(system: System, module: int) -> tuple[Module, ...]:
    """The modules in which this one stands in the place of AC, the next one first."""
    above = next((m for m in system.modules if m.over == module), None)
    return () if above is None else (above, *modules_above(system, above.index))


def tower_of(system: System, module: int) -> tuple[Module, ...]:
    """A module with those above and below it, the topmost first; itself where it stands alone."""
    tower = [*reversed(modules_above(system, module)), system.modules[module]]
    while (below := tower[-1].over) is not None:
        tower.append(system.modules[below])
    return tuple(tower)


def holder_of(system: System, module: Module) -> str:
    """The name of the sub-system that holds a module, or its tower; "" where no other one does."""
    return tower_of(system, module.index)[0].name.rpartition(".")[0]


def claims_nothing(system: System, module: Module) -> bool:
    """Whether a module is there for comfort: another one is above it, and it says no `verify`."""
    return module.symbol.verify.span is None and bool(modules_above(system, module.index))

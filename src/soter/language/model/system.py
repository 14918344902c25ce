"""One system of a program, flattened: every number known, every instance named.

Purpose: the static half of a transition system: what runs, how often, on which topics, and in
which order. The interpreter, the lowering to Core, simulation and proofs all start from it.
Non-goals: behaviour (`semantics/`), storage (`core/layout.py`).
"""

from __future__ import annotations

import struct
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

    @property
    def float32_ends(self) -> tuple[float, float]:
        """Gives both ends, each as the nearest float32 if that lies outside of the bounds.

        Such a float32 beyond an end still counts as that end (docs/decisions.md, 257).
        """
        return min(self.low, _to_float32(self.low)), max(self.high, _to_float32(self.high))


def _to_float32(number: float) -> float:
    """Gives the nearest float32 number, or `number` itself if it is too large for a float32."""
    try:
        nearest: float = struct.unpack("<f", struct.pack("<f", number))[0]
    except OverflowError:
        return number
    return nearest


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
    """Who publishes it: a plant's or node's name, "M" for a module, "input", or "" (nobody)."""
    queue_of: int | None = None
    """For the queue of a subscription: the topic whose values it collects. Its type is a list."""
    policy: str = ""
    """What a full queue does: drop_oldest, drop_newest or fault (of the subscriber)."""
    queues: tuple[int, ...] = ()
    """The queues that take what is published here."""
    held: bool = False
    """Whether it is hidden, no topic of the program: it holds what a node that `takes` time
    published, or, for code that reads `margin`, what a DM saw."""

    @property
    def source(self) -> int:
        """Gives the topic's index, or for a queue the index of the topic that fills the queue."""
        return self.index if self.queue_of is None else self.queue_of


@dataclass(eq=False)
class Scope:
    """The meaning of the names of a declaration in one instance of this declaration."""

    topics: dict[TopicSymbol, int]
    params: dict[ParamSymbol, Value]
    plants: dict[str, int] = field(default_factory=dict)
    modules: dict[ModuleSymbol | str, int] = field(default_factory=dict)


@dataclass(eq=False)
class Disturbance:
    """A disturbance of a plant instance with its numbers; `hold_ns` 0 means a new draw each step.

    Every leaf has the stream `<plant>.<disturbance>[.<leaf path>]`. The draw for a step that ends
    at t has index (t - period) // hold, where hold is the period if `hold_ns` is 0.
    """

    variable: Variable
    low: float
    high: float
    hold_ns: int
    streams: tuple[str, ...]


@dataclass(eq=False)
class Measurement:
    """An error of at most `bound` on a leaf of a driven topic; its draw has index t // period."""

    topic: int
    leaf: int
    bound: float
    stream: str


@dataclass(frozen=True)
class StandIn:
    """The module or node that a component stands for in a test, which replaced it by its contract.

    `of` is the full name of the replaced module or node, and `role` the role by which the component
    is placed in the deployed order. The publications satisfy the conditions `asked` of `clauses`;
    the clauses in `left` could not be used. `tried` has the `assumes` statements of the test: they
    limit the values that are tried to some of those that the contract allows.
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
    """A part of a system that is released periodically: a plant, a DM or a node.

    `role` is "plant", "dm", "sc", "ac" or "node". Releases are at phase + k * period, k >= 0.
    `order` is the position in the deployed order within an instant (ruling 5): plants, then DMs,
    then SCs, then the rest; ties are in declared order.
    """

    index: int
    name: str
    role: str
    period_ns: int
    phase_ns: int
    scope: Scope
    span: Span
    module: int | None = None
    """Index of the module of a dm, sc or ac; None for others."""
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
    """The hidden topic for outputs of steps that take time (`step_times.py`), or None."""
    wcet_ns: int | None = None
    """What a step, or a decision, needs of its processor at most; None: not declared."""
    jitter_ns: int = 0
    """How late its release may be (docs/timing.md)."""
    inline: bool = False
    """Whether the system says that it runs in the thread of the trusted part."""

    @property
    def extern(self) -> bool:
        """Whether something other than Soter code does the component's step."""
        return bool(self.node and self.node.extern) or bool(self.plant and self.plant.extern)

    @property
    def in_thread(self) -> bool:
        """Whether the component runs in the trusted part's thread: Soter code, or `inline`."""
        return self.plant is None and (self.inline or not self.extern)

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Gives the variables kept between steps: a node's locals, or a plant's states."""
        return self.node.locals if self.node else self.plant.states if self.plant else ()

    @property
    def published(self) -> list[TopicSymbol]:
        """Gives the topics that the component publishes or drives, as declared symbols."""
        if self.plant is not None:
            return [t for t, _ in self.plant.drives]
        return [] if self.node is None else list(self.node.publishes)

    @property
    def writes(self) -> list[int]:
        """Gives the topics that the component publishes or drives, as indices in the system."""
        return [self.scope.topics[t] for t in self.published]

    @property
    def reads(self) -> list[int]:
        """Gives indices of the topics that a plant reads or a node subscribes to; [] for a DM."""
        if self.plant is not None:
            return [self.scope.topics[t] for t in self.plant.reads]
        return (
            [] if self.node is None else [self.scope.topics[s.topic] for s in self.node.subscribes]
        )


@dataclass(eq=False)
class Shield:
    """How a module judges the commands of its AC (docs/semantics.md, Shields).

    Each number of a command is cut into `cells` cells. The hidden topic `topic` has the time (s)
    until which a command in each cell was held; `held` is its next value after a publication.
    `permits` is whether all commands that may act then may act until SC's first output does. Both
    are None until computed. With `toward sc`, the hidden topic `proposed` has the numbers that AC
    last wanted to publish, then those of SC. `moved` is the array of numbers that AC publishes,
    followed by 0 if they were found to be forbidden, else 1.
    """

    cells: int
    topic: int
    held: TypedExpr | None = None
    permits: TypedExpr | None = None
    proposed: int | None = None
    moved: TypedExpr | None = None

    @property
    def expressions(self) -> list[TypedExpr]:
        """Gives the expressions of the shield that are already computed."""
        return [e for e in (self.held, self.permits, self.moved) if e is not None]


@dataclass(eq=False)
class Module:
    """An instance of an RTA module; `dm`, `ac` and `sc` are indices of components.

    `forced` is None, "ac" or "sc". The DM of a forced module runs and records its predicates, but
    never changes the mode (the control arm of an experiment). `inputs` are the topics that ttf and
    safer read; a read topic with a max_age is checked for staleness. `outputs` are the gated
    topics.
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
    view: str = ""
    """Name of the view, if it is one of a module (`elaborate/views_for_proofs.py`): `symbol` then
    has the view's part of the proof, `whole` is the module that flies."""
    whole: ModuleSymbol | None = None
    law: dict[int, Value] = field(default_factory=dict)
    """The fail-safe law: topic index -> what its actuator holds once the lease has ended; empty:
    none is declared."""
    late_ns: int = 0
    """How late a release of its DM may be (`late dm`)."""
    levels: int = LEVELS_DEFAULT
    """Number of levels that its predicates have if they are computed."""
    computed: bool = False
    """Whether `ttf` and `safer` were computed: a level of each group is compared with 1 and 2."""
    grid_ends: dict[str, tuple[float, float]] = field(default_factory=dict)
    """If they were computed: leaf of a topic -> both ends of its axis of a grid."""
    unshown: str = ""
    """What decisions of a module with `rest` rely on though nothing shows it; "" for others."""
    looks: int = 1
    """For how many periods of its DM AC surely keeps control after `safer` was true."""
    looked: int | None = None
    """The hidden topic with what the DM saw last; None if nothing reads the module's `margin`."""
    latch: int | None = None
    """The hidden topic in which a DM remembers that it may not give control back by itself
    (`elaborate/passes/memory_topics.py`); None: it may."""
    acknowledgement: int | None = None
    """With a `latch`: the topic of the button after whose press it gives control back; None: once
    it has taken control from AC it never does."""
    shield: Shield | None = None
    plan: int | None = None
    """With several plans of SC: the hidden topic with the number of the one that SC follows."""
    goods: tuple[TypedExpr, ...] = ()
    """With several plans, once predicates are computed: for each whether the estimate is good."""

    @property
    def reads(self) -> tuple[int, ...]:
        """Gives all topics that the DM reads: `inputs` and the topic of the acknowledgement."""
        if self.acknowledgement is None or self.acknowledgement in self.inputs:
            return self.inputs
        return (*self.inputs, self.acknowledgement)

    def periods_left(self, *, unsafe: bool, safer: bool) -> int:
        """Gives how many periods AC surely keeps control after a DM step; 0 if `unsafe`."""
        return 0 if unsafe else self.looks if safer else 1

    def margin_ns(self, looks: int, age_ns: int) -> int:
        """Gives the ns left of `looks` periods, `age_ns` after the DM's step; at least 0."""
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
    """A seeded input from the environment, drawn at every multiple of `every_ns`, before all else.

    Each leaf has a stream `input.<topic>[.<leaf>]` with index t // every. If `values` are set, one
    of them is drawn from the stream `input.<topic>`.
    """

    topic: int
    every_ns: int
    values: tuple[Value, ...] = ()


@dataclass(eq=False)
class External:
    """A topic that something outside of the system publishes or reads.

    For a publisher the program may state (else None): it publishes at least every `every_ns`, at
    most `delay_ns` after it measured, and leaf k is wrong by at most `errors[k]`.
    """

    topic: int
    every_ns: int | None
    delay_ns: int | None
    errors: tuple[float | None, ...]
    span: Span


@dataclass(eq=False)
class Metric:
    """A number that campaigns report, measured at instants `every_ns` apart, at their end.

    Its histogram has `bins` equal parts of [low, high], and two more for values below and above.
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
    """A property that only tests have: "eventually", "leadsto" or "invariant" (docs/testing.md).

    `module` is the module of an "invariant"; the other kinds have `condition` and `within_ns`.
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
    """`asks` is the premise, `promises` the condition as text, loop variables filled in."""


@dataclass(eq=False)
class TimingFault:
    """A node or DM that may be "late", "skip" or "overrun" (docs/testing.md).

    An "overrun" with `least_ns` > 0 is no fault but the declared duration of a node's steps.
    """

    kind: str
    component: int
    by_ns: int
    at_most: int
    span: Span
    least_ns: int = 0


@dataclass(eq=False)
class Fault:
    """A fault that one component has in the runs of a system (docs/semantics.md, Faults).

    `kind`: "late" and "skip" change releases of the component. "nan", "stuck", "silent",
    "saturated", "bias", "noise" and "scale" change leaves (by index) of a topic that it publishes;
    "scale" may also change one of its disturbances. Time is cut into slots of `slot_ns` (0: every
    release is a slot). Each slot is faulty with `probability`, drawn from `stream`. `amount` for
    "late" has times in ns: quantiles between which the lateness of each release is drawn, or, with
    slots, the longest delay. "wait": a release happens no earlier than a release of component `on`
    at the same time (`step_times.py`). "overrun": a step that begins in a faulty slot lasts
    `amount` ns longer (`Component.held`). `apart`: never two faulty slots in a row. `inside`: the
    assumption that the fault keeps to, or None. `text`: the fault as written.
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
    def changes_releases(self) -> bool:
        """Whether the fault moves or drops releases of its component."""
        return self.kind in {"late", "skip", "wait"}


@dataclass(eq=False)
class TestPlan:
    """The declarations of a `test` block besides its system; `quantum_ns` is as declared.

    `ordered`: the steps of one instant happen in the deployed order, inputs first.
    """

    name: str
    skew_ns: int
    horizon_ns: int
    quantum_ns: int | None
    faults: tuple[TimingFault, ...]
    timed: tuple[TimedProperty, ...]
    span: Span
    ordered: bool = False

    __test__ = False  # pytest must not collect this class


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
    """Faults of its runs; proofs and tests leave them out."""
    measures: tuple[Metric, ...] = ()
    """Numbers that campaigns report about its runs."""
    externals: tuple[External, ...] = ()
    """Topics that something outside publishes or reads: such a system runs without plants."""
    proved: System | None = None
    """For a system that deploys another one: that one, flattened with the same parameters."""
    certificate: str = ""
    """For a system that deploys another one: the seal of the certificate of its verdicts."""
    shuffled: bool = False
    """Whether nodes of one instant step in an order that is drawn, not in the deployed one."""

    @property
    def timed(self) -> bool:
        """Whether a component declares the time of its steps, or how late its release may be."""
        return any(c.wcet_ns is not None or c.jitter_ns for c in self.components)

    def topic(self, name: str) -> Topic:
        """Gives the topic with this full name; raises KeyError if no topic has the name."""
        return {t.name: t for t in self.topics}[name]

    def component(self, name: str) -> Component:
        """Gives the component with this full name; raises KeyError if no component has the name."""
        return {c.name: c for c in self.components}[name]


def environment_topics(system: System) -> tuple[int, ...]:
    """Gives indices of topics that only the environment sets: inputs, and what a driver draws."""
    drawn = {d.topic for d in system.inputs}
    return tuple(
        [
            t.index
            for t in system.topics
            if t.queue_of is None and (t.driver == "input" or t.index in drawn)
        ]
    )


def queues_read_by(system: System, component: Component) -> tuple[int, ...]:
    """Gives the queues that a node reads, as topic indices."""
    if component.node is None:
        return ()
    read = [component.scope.topics[s.topic] for s in component.node.subscribes]
    return tuple([i for i in read if system.topics[i].queue_of is not None])


def name_of_subsystem(module: Module) -> str:
    """Gives the name of the sub-system that a module is in; "" if it is in none."""
    return module.name.rpartition(".")[0]

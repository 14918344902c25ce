"""The checked program: declarations with their types, names resolved, conversions explicit.

Purpose: the records that the checker hands to every later pass: the reference interpreter and the
lowering to Core read these, and nothing of the syntax tree.
Non-goals: numbers that depend on parameters (periods, ranges): `system_numbers.py` computes them.

Rules that hold of every tree built by the checker:
- integer literals in float positions are already `Literal` of type FLOAT;
- `TypedBinary` on floats, ints or durations has both operands of the same kind; `Vector` does the
  componentwise cases; comparisons of bools and enums are only == and !=;
- a value that goes into an `int in [a, b]` place passes through `Narrow`;
- loops have literal bounds; functions are not recursive; every path of a function returns.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

from soter.language.model.types import ListType
from soter.language.syntax.node import Shown

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.types import RecordType, Type, Value


SYNTHESIZED = "synthesized"
"""Name of the extern node that stands where SC is to be synthesized."""
CELLS_MAX = 64
"""The most cells that a number of a command is cut into; `shield;` cuts it into as many."""

# ---------------------------------------------------------------- variables


@dataclass(eq=False, repr=False)
class Variable(Shown):
    """A named local variable; two variables are equal only if they are the same object.

    `kind`: "parameter" of a function, "let", "var", "loop" (all temporary), "local" (state of a
    node, kept between steps), "state" or "disturbance" of a plant, "plantlet".
    """

    name: str
    type: Type
    kind: str
    span: Span
    used: bool = False


# ---------------------------------------------------------------- expressions


@dataclass(eq=False, repr=False)
class TypedExpr(Shown):
    """Any checked expression."""

    type: Type
    span: Span


@dataclass(eq=False, repr=False)
class Literal(TypedExpr):
    """A constant of any type (also the value of a named `const`)."""

    value: Value
    name: str | None = None


@dataclass(eq=False, repr=False)
class ParamRead(TypedExpr):
    """A `param`; its value is fixed when a system is elaborated."""

    param: ParamSymbol


@dataclass(eq=False, repr=False)
class VarRead(TypedExpr):
    """A read of a local, a parameter, a plant's state, a disturbance or a plant's let."""

    variable: Variable


@dataclass(eq=False, repr=False)
class TopicRead(TypedExpr):
    """A read of a topic's value at the start of the step; a node must subscribe to the topic."""

    topic: TopicSymbol


@dataclass(eq=False, repr=False)
class TruthRead(TypedExpr):
    """`instance.truth`: the state of a plant instance as a record of its states."""

    instance: str


@dataclass(eq=False, repr=False)
class ModeRead(TypedExpr):
    """`mode(M)`: type MODE. `M` is an instance's path in a system, and elsewhere the module."""

    module: ModuleSymbol | str


@dataclass(eq=False, repr=False)
class MarginRead(TypedExpr):
    """`margin(M)`: seconds in which the module surely keeps AC in control, whatever AC does."""

    module: ModuleSymbol | str


@dataclass(eq=False, repr=False)
class InControl(TypedExpr):
    """`in_control`: whether this node's outputs count (true outside every module)."""


@dataclass(eq=False, repr=False)
class TimeRead(TypedExpr):
    """`time`: virtual time in seconds: float(ct) / 1e9."""


@dataclass(eq=False, repr=False)
class PeriodRead(TypedExpr):
    """`dt`: the period of this node or plant in seconds: float(period_ns) / 1e9."""


@dataclass(eq=False, repr=False)
class AgeRead(TypedExpr):
    """`age(topic)`: seconds since the topic's last publication: float(ct - stamp) / 1e9."""

    topic: TopicSymbol


@dataclass(eq=False, repr=False)
class TypedUnary(TypedExpr):
    """`-e` on int (faults on overflow), float, vector; `!e` on bool."""

    op: str
    operand: TypedExpr


@dataclass(eq=False, repr=False)
class TypedBinary(TypedExpr):
    """A scalar operation: + - * / % < <= > >= == != && || (the last two short-circuit).

    int: 64-bit, overflow faults; `/` truncates towards zero, `%` has the sign of the dividend,
    both fault on zero. float: IEEE; `/` faults on a zero divisor; no `%`.
    """

    op: str
    left: TypedExpr
    right: TypedExpr


@dataclass(eq=False, repr=False)
class Vector(TypedExpr):
    """An operation on each component of one or two vectors.

    vector + vector, vector - vector, scalar * vector, vector * scalar, vector / scalar (faults on
    zero). Operands are evaluated once, left first. The machine operation on each component has its
    operands in the same order.
    """

    op: str
    left: TypedExpr
    right: TypedExpr


@dataclass(eq=False, repr=False)
class Conditional(TypedExpr):
    """`c ? a : b`: only the chosen side is evaluated."""

    condition: TypedExpr
    then: TypedExpr
    otherwise: TypedExpr


@dataclass(eq=False, repr=False)
class TypedCall(TypedExpr):
    """A call of a declared function; arguments are evaluated from left to right."""

    fun: FunSymbol
    arguments: tuple[TypedExpr, ...]


@dataclass(eq=False, repr=False)
class Builtin(TypedExpr):
    """A built-in function; arguments are evaluated from left to right.

    sqrt floor abs min max (float, abs/min/max also int; abs(INT_MIN) faults);
    float(int); int(float) truncates, faults when NaN or out of range;
    seconds(duration) -> float(ns) / 1e9;
    dot(v, v): components multiplied and added from the left in leaf order;
    norm(v) = sqrt(dot(v, v)); saturate(v or float, a): each component min(max(x, -a), a).
    min(a, b) = b < a ? b : a; max(a, b) = b > a ? b : a.
    """

    name: str
    arguments: tuple[TypedExpr, ...]


@dataclass(eq=False, repr=False)
class TypedField(TypedExpr):
    """The field number `index` of a record."""

    target: TypedExpr
    index: int


@dataclass(eq=False, repr=False)
class Index(TypedExpr):
    """An element of an array or list; a fault if the index is out of range (`len` for lists)."""

    target: TypedExpr
    index: TypedExpr


@dataclass(eq=False, repr=False)
class TypedLength(TypedExpr):
    """`list.len`, or the constant length of an array; type INT."""

    target: TypedExpr


@dataclass(eq=False, repr=False)
class Aggregate(TypedExpr):
    """A literal of a record (values in field order, evaluated in written order), array or list.

    `order` gives the field index for each written position; None means the declared order.
    """

    elements: tuple[TypedExpr, ...]
    order: tuple[int, ...] | None = None


@dataclass(eq=False, repr=False)
class TypedChoose(TypedExpr):
    """`choose ...` in a step: one of finitely many values, picked by whoever runs the step.

    `options`, if any, are evaluated left to right, and one is the value. Otherwise the value is
    number `low + k` (k-th bool, enum member or int), 0 <= k < `count`. `ages` is the hidden local
    of a `fair` choice (array of `int in [0, 255]`, one per alternative), else None.
    """

    count: int
    low: int
    options: tuple[TypedExpr, ...]
    ages: Variable | None


@dataclass(eq=False, repr=False)
class Narrow(TypedExpr):
    """An int narrowed to an `int in [a, b]`, the type of this node; a fault if outside of it."""

    operand: TypedExpr


# ---------------------------------------------------------------- statements


@dataclass(eq=False, repr=False)
class TypedStmt(Shown):
    """Any checked statement."""

    span: Span


@dataclass(eq=False, repr=False)
class TypedDeclare(TypedStmt):
    """`let` or `var`: the variable starts with this value."""

    variable: Variable
    value: TypedExpr


@dataclass(eq=False, repr=False)
class Place(Shown):
    """The target of an assignment: a variable, field indices (int) and index expressions."""

    variable: Variable
    path: tuple[int | TypedExpr, ...]
    type: Type
    span: Span


@dataclass(eq=False, repr=False)
class TypedAssign(TypedStmt):
    """`place = value;`: index expressions first, left to right, then the value."""

    place: Place
    value: TypedExpr


@dataclass(eq=False, repr=False)
class TypedPush(TypedStmt):
    """`push list, value;`: faults when the list is full. Place indices, then the value."""

    place: Place
    value: TypedExpr


@dataclass(eq=False, repr=False)
class TypedPublish(TypedStmt):
    """`publish topic = value;`: takes effect when the step ends without a fault; the last wins.

    With a `limit`, a step may publish up to `limit` messages, kept in order; more are a fault.
    """

    topic: TopicSymbol
    value: TypedExpr
    limit: int | None = None


@dataclass(eq=False, repr=False)
class TypedReturn(TypedStmt):
    """`return value;`."""

    value: TypedExpr


@dataclass(eq=False, repr=False)
class Assert(TypedStmt):
    """`assert condition;`: a step fault when false."""

    condition: TypedExpr
    message: str | None


@dataclass(eq=False, repr=False)
class TypedIf(TypedStmt):
    """`if c {...} elseif d {...} else {...}`: `arms` in order; `otherwise` may be empty."""

    arms: tuple[tuple[TypedExpr, tuple[TypedStmt, ...]], ...]
    otherwise: tuple[TypedStmt, ...]


@dataclass(eq=False, repr=False)
class ForRange(TypedStmt):
    """`for i in low..high`: i = low, ..., high - 1."""

    variable: Variable
    low: int
    high: int
    body: tuple[TypedStmt, ...]


@dataclass(eq=False, repr=False)
class ForEach(TypedStmt):
    """`for x in sequence`: the sequence is evaluated once, before the loop."""

    variable: Variable
    sequence: TypedExpr
    body: tuple[TypedStmt, ...]


# ---------------------------------------------------------------- symbols


@dataclass(eq=False, repr=False)
class Symbol(Shown):
    """A checked declaration. `name` is the full name: `file.name` for imported ones."""

    name: str
    span: Span


@dataclass(eq=False, repr=False)
class ConstSymbol(Symbol):
    """A constant with its value."""

    type: Type
    value: Value


@dataclass(eq=False, repr=False)
class ParamSymbol(Symbol):
    """A parameter; `default`, `low`, `high` are constant expressions."""

    type: Type
    default: TypedExpr
    low: TypedExpr | None
    high: TypedExpr | None


@dataclass(eq=False, repr=False)
class FunSymbol(Symbol):
    """A function; an extern one has `body` None, and `source` may name its binding."""

    parameters: tuple[Variable, ...]
    result: Type
    body: tuple[TypedStmt, ...] | None
    extern: bool
    source: str | None
    prelude: bool = False


@dataclass(eq=False, repr=False)
class RangeSet(Shown):
    """The bounds of one or more leaves: expressions over constants and parameters."""

    low: TypedExpr
    high: TypedExpr
    span: Span


@dataclass(eq=False, repr=False)
class TopicSymbol(Symbol):
    """A topic; `values` maps paths of leaves (or prefixes, () for all leaves) to bounds.

    `static`: the topic describes a part of the world that never changes.
    """

    type: Type
    input: bool
    values: dict[tuple[str, ...], RangeSet]
    default: TypedExpr | None
    max_age: TypedExpr | None
    static: bool = False


@dataclass(eq=False, repr=False)
class Subscribed(Shown):
    """A subscription to a topic, with a queue if the program asks for a queue."""

    topic: TopicSymbol
    queue: int | None
    policy: str
    span: Span


@dataclass(eq=False, repr=False, kw_only=True)
class NodeSymbol(Symbol):
    """A node; `initial` has each local's first value: an expression, or None for the default."""

    period: TypedExpr
    phase: TypedExpr | None
    extern: bool
    source: str | None
    subscribes: tuple[Subscribed, ...]
    publishes: tuple[TopicSymbol, ...]
    failsafe: dict[TopicSymbol, TypedExpr]
    locals: tuple[Variable, ...]
    initial: tuple[TypedExpr | None, ...]
    assumes: tuple[TypedExpr, ...]
    guarantees: tuple[TypedExpr, ...]
    takeover: tuple[TypedStmt, ...] | None
    step: tuple[TypedStmt, ...]
    bursts: dict[TopicSymbol, int] = field(default_factory=dict)
    """Topic of which a step may publish several messages -> how many at most."""
    takes: tuple[TypedExpr, TypedExpr] | None = None
    """How long a step lasts, at least and at most; None: its publications take effect at once."""
    wcet: TypedExpr | None = None
    jitter: TypedExpr | None = None
    """How much of its processor's time a step needs at most; how late its release may be."""

    @property
    def answers(self) -> list[tuple[str, Type]]:
        """Gives (short name, type) of each output of an extern node; a burst has a list type."""
        return [(t.name.rpartition(".")[2], self.answer_type(t)) for t in self.publishes]

    def answer_type(self, topic: TopicSymbol) -> Type:
        """Gives the type of what a step publishes on a topic: its own, or a list for a burst."""
        limit = self.bursts.get(topic)
        return topic.type if limit is None else ListType(topic.type, limit)

    def node_with_step(
        self, step: tuple[TypedStmt, ...], subscribes: tuple[Subscribed, ...] = ()
    ) -> NodeSymbol:
        """Gives a copy of this node that has another step, and no locals and conditions."""
        return replace(
            self,
            extern=False,
            source=None,
            subscribes=subscribes,
            failsafe={},
            locals=(),
            initial=(),
            assumes=(),
            guarantees=(),
            takeover=None,
            step=step,
            bursts={},
        )


@dataclass(eq=False, repr=False, kw_only=True)
class TypedGridAxis(Shown):
    """One axis of a verification grid: a leaf of a topic, or of the state of a plant instance.

    Exactly one of `topic` and `instance` is set. With `instance`, `path` begins with a state's
    name, and `plant` is the type of the instance. `open` adds a cell from `high` up to this value,
    beyond which nothing is claimed. `unbounded` adds a cell at either end that has no outer end.
    """

    topic: TopicSymbol | None
    path: tuple[str, ...]
    low: TypedExpr
    high: TypedExpr
    cells: TypedExpr
    span: Span
    instance: str = ""
    plant: PlantSymbol | None = None
    open: TypedExpr | None = None
    unbounded: bool = False


@dataclass(eq=False, repr=False)
class TypedAxisGroup(Shown):
    """States that are analysed together on a grid."""

    axes: tuple[TypedGridAxis, ...]
    span: Span


@dataclass(eq=False, repr=False)
class TypedCommandSet(Shown):
    """The values that a synthesized controller may publish on one leaf of an output."""

    topic: TopicSymbol
    path: tuple[str, ...]
    values: tuple[TypedExpr, ...]
    span: Span


@dataclass(eq=False, repr=False)
class TypedVerifyBlock(Shown):
    """The parts of a `verify` block, None or empty if absent; times are durations."""

    groups: tuple[TypedAxisGroup, ...] = ()
    abstracts: tuple[AbstractionLink, ...] = ()
    commands: tuple[TypedCommandSet, ...] = ()
    core: TypedExpr | None = None
    horizon: TypedExpr | None = None
    levels: TypedExpr | None = None
    late_dm: TypedExpr | None = None
    late_sc: TypedExpr | None = None
    response_dm: TypedExpr | None = None
    response_sc: TypedExpr | None = None
    acts_least: TypedExpr | None = None
    """`acts within a to b`: a; None: 0."""
    acts: TypedExpr | None = None
    recover: TypedExpr | None = None
    stays: Span | None = None
    """`recover never`: SC may keep control for ever."""
    late_of: dict[str, TypedExpr] = field(default_factory=dict)
    """Node between plant and module, by its name in the flying system -> how late it starts."""
    response_of: dict[str, TypedExpr] = field(default_factory=dict)
    dropout: TypedExpr | None = None
    """How long a sensor may be silent beyond its period."""
    age: TypedExpr | None = None
    """How old at most SC reads a topic whose sensor is not silent; None: as its `max_age` says."""
    views: tuple[ViewSymbol, ...] = ()
    """Views, each with groups and abstractions of its own; this block then has none."""
    induction: Span | None = None
    """The place of `induction;`, which asks for a proof by it (`verify/induction/`); or None."""
    lemmas: tuple[TypedExpr, ...] = ()
    progress: tuple[TypedExpr, ...] = ()
    """Conditions that P2b assumes to hold at all times; nothing proves them."""
    enters: TypedExpr | None = None
    """Holds in every step in which a node changes a topic that the map of a view reads."""
    span: Span | None = None


@dataclass(eq=False, repr=False)
class ViewSymbol(Shown):
    """`view name { ... }`; `block` has its groups and abstractions, and the times of all views."""

    name: str
    block: TypedVerifyBlock
    span: Span


@dataclass(eq=False, repr=False)
class AbstractionLink(Shown):
    """`abstracts instance by name: Plant = expr`; `expr` reads `instance.truth`."""

    instance: str
    name: str
    plant: PlantSymbol
    value: TypedExpr | None
    span: Span


@dataclass(eq=False, repr=False)
class ClauseSymbol(Symbol):
    """`assumes name: e;` or `guarantees name: e;` of a module; `text` is `e` as it is written."""

    kind: str
    condition: TypedExpr
    text: str


@dataclass(eq=False, repr=False)
class Latch(Shown):
    """`returns after topic;` (the topic of the acknowledgement), or `returns never;` (no topic)."""

    topic: TopicSymbol | None
    span: Span


@dataclass(eq=False, repr=False)
class RestMove(Shown):
    """A leaf that SC moves by at most `by` once `rest` holds; `way`: "", "up" or "down"."""

    topic: TopicSymbol
    path: tuple[str, ...]
    by: TypedExpr
    way: str
    span: Span


@dataclass(eq=False, repr=False)
class RestSymbol(Shown):
    """`rest e moves x by d, ... within T;`: SC reaches `e` within T, and then only moves these."""

    condition: TypedExpr
    moves: tuple[RestMove, ...]
    within: TypedExpr
    span: Span


@dataclass(eq=False, repr=False, kw_only=True)
class ModuleSymbol(Symbol):
    """An `rta` module: (N_ac, N_sc, N_dm, Delta, phi_safe, phi_safer) of the paper.

    `ttf` and `safer` may be None. They are then computed before a run or a build
    (`verify/deploy/missing_predicates.py`); if this fails, AC never gets control. `clean` is the
    number of clean outputs that AC needs after a fault.
    """

    ac: NodeSymbol
    sc: NodeSymbol
    period: TypedExpr
    safe: TypedExpr
    safer: TypedExpr | None
    ttf: TypedExpr | None
    clean: TypedExpr | None
    verify: TypedVerifyBlock
    topics_read: tuple[TopicSymbol, ...] = ()
    """Topics that `ttf` and `safer` read, in order of first use: the DM's inputs."""
    ac_span: Span | None = None
    sc_span: Span | None = None
    """Where the module names its controllers, AC and SC."""
    contract: tuple[ClauseSymbol, ...] = ()
    """Its `assumes` and `guarantees`, which are judged when its controllers step."""
    failsafe: dict[TopicSymbol, TypedExpr] = field(default_factory=dict)
    """The fail-safe law: a value for each output, which actuators hold once the lease has ended."""
    wcet: TypedExpr | None = None
    jitter: TypedExpr | None = None
    """The execution time and the jitter of its decision module, as `NodeSymbol` has them."""
    latch: Latch | None = None
    """Keeps its decision module from giving control back by itself; None: it may."""
    shield: TypedExpr | None = None
    """If single commands are judged: into how many cells each number of them is cut."""
    toward_sc: bool = False
    """Whether a command that is not permitted is moved toward SC's before it is judged."""
    candidates: TopicSymbol | None = None
    """A topic with an array of commands that are tried in its place, before SC's."""
    rest: RestSymbol | None = None
    """Replaces `ttf` and `safer`: the DM follows SC from each estimate to where it rests."""
    plans: tuple[NodeSymbol, ...] = ()
    """`sc Brake, Left;`: the nodes of which `sc` is made, which does what one of them does."""
    plan: TopicSymbol | None = None
    """With `plans`: the topic that tells `sc` which one, by its number."""

    @property
    def controllers(self) -> tuple[NodeSymbol, ...]:
        """Gives the two controllers of the module: AC and SC."""
        return self.ac, self.sc

    @property
    def named_nodes(self) -> tuple[NodeSymbol, ...]:
        """Gives the nodes that the program names for the module: its controllers, or its plans."""
        return (self.ac, *(self.plans or (self.sc,)))

    @property
    def acknowledgements(self) -> tuple[TopicSymbol, ...]:
        """Gives (topic,): the topic whose press releases the module's latch; () without one."""
        topic = None if self.latch is None else self.latch.topic
        return () if topic is None else (topic,)

    @property
    def moved_topics(self) -> tuple[TopicSymbol, ...]:
        """Gives the topics that SC still moves once `rest` holds."""
        return () if self.rest is None else tuple(m.topic for m in self.rest.moves)

    @property
    def stay_clause(self) -> str:
        """Gives the clause by which SC may keep control for ever; "" if the module has none."""
        if self.latch is not None and self.latch.topic is None:
            return "returns never"
        return "recover never" if self.verify.stays is not None else ""

    @property
    def synthesized(self) -> bool:
        """Whether SC is still to be found: `sc synthesized period d;`."""
        return self.sc.name == SYNTHESIZED

    @property
    def predicates(self) -> tuple[TypedExpr, ...]:
        """Gives the predicates that the module has, out of `safe`, `ttf`, `safer` and `core`."""
        predicates = (self.safe, self.ttf, self.safer, self.verify.core)
        return tuple(e for e in predicates if e is not None)

    @property
    def predicates_and_lemmas(self) -> tuple[TypedExpr, ...]:
        """Gives the `predicates`, and the conditions of lemmas, `progress`, `enters`, `rest`."""
        verify = self.verify
        enters = () if verify.enters is None else (verify.enters,)
        rest = () if self.rest is None else (self.rest.condition,)
        return (*self.predicates, *verify.lemmas, *verify.progress, *enters, *rest)

    @property
    def expressions(self) -> tuple[TypedExpr, ...]:
        """Gives `predicates_and_lemmas`, and the conditions of the contract."""
        return (*self.predicates_and_lemmas, *(c.condition for c in self.contract))


@dataclass(eq=False, repr=False)
class MeasuredSymbol(Shown):
    """The greatest error of an estimator on the leaves of a driven topic below `path`."""

    topic: TopicSymbol
    path: tuple[str, ...]
    within: TypedExpr
    span: Span


@dataclass(eq=False, repr=False)
class DisturbanceSymbol(Shown):
    """A bounded disturbance, every leaf in [low, high], redrawn every `hold` (None: each step)."""

    variable: Variable
    low: TypedExpr
    high: TypedExpr
    hold: TypedExpr | None


@dataclass(eq=False, repr=False, kw_only=True)
class PlantSymbol(Symbol):
    """A plant; each state has `der`, `next` or neither (a constant), unless the plant is extern.

    One step at time t draws the disturbances, evaluates the lets, integrates all `der` states
    together over the period, and evaluates every `next` from the OLD state. It then stores the
    states, evaluates the lets anew and publishes all driven topics with their measurement errors.
    """

    period: TypedExpr
    extern: bool
    source: str | None
    reads: tuple[TopicSymbol, ...]
    drives: tuple[tuple[TopicSymbol, TypedExpr], ...]
    states: tuple[Variable, ...]
    initial: tuple[TypedExpr | None, ...]
    initial_range: tuple[tuple[TypedExpr, TypedExpr] | None, ...]
    disturbances: tuple[DisturbanceSymbol, ...]
    lets: tuple[tuple[Variable, TypedExpr], ...]
    der: dict[Variable, TypedExpr]
    next: dict[Variable, TypedExpr]
    method: str
    substeps: TypedExpr | None
    measured: tuple[MeasuredSymbol, ...]
    truth: RecordType
    read_spans: tuple[Span, ...] = ()
    """Where the plant names the topics of `reads`, in that order."""


@dataclass(eq=False, repr=False)
class InstanceSymbol(Shown):
    """`name: What { topic = other };`: an instance in a system."""

    name: str
    what: PlantSymbol | NodeSymbol | ModuleSymbol | SystemSymbol
    renames: dict[TopicSymbol, TopicSymbol]
    rename_spans: dict[TopicSymbol, Span]
    """Where the inner topic of each wire is written."""
    span: Span


@dataclass(eq=False, repr=False)
class PropertySymbol(Shown):
    """A property of a system or test, of kind always, never, eventually, leadsto or invariant.

    "invariant" (tests only) has no expressions: `module` is the path of the module's instance, None
    for `invariants` (all modules). For people, `whole`, `text` and `asks` are the texts of the
    property, of its condition and of its premise, with the values of loop variables filled in.
    """

    kind: str
    premise: TypedExpr | None
    condition: TypedExpr | None
    within: TypedExpr | None
    text: str
    span: Span
    module: str | None = None
    whole: str = ""
    asks: str = ""


@dataclass(eq=False, repr=False)
class FaultSymbol(Shown):
    """A timing fault of a test: `late N by d;`, `skip N at most k;`, `overrun N by d;`.

    `path` is the component's name in the system; exactly one of `by` and `at_most` is set.
    """

    kind: str
    path: str
    by: TypedExpr | None
    at_most: TypedExpr | None
    span: Span


@dataclass(eq=False, repr=False)
class SystemFaultSymbol(Shown):
    """An item of `faults { ... }`; `path` is "" for an order, and `text` is the item as written."""

    kind: str
    path: str
    by: tuple[TypedExpr, ...]
    rate: TypedExpr | None
    per: TypedExpr | None
    lasts: TypedExpr | None
    text: str
    span: Span


@dataclass(eq=False, repr=False)
class MeasureSymbol(Shown):
    """`measure name = value in [low, high] / bins every d;`."""

    name: str
    value: TypedExpr
    low: TypedExpr
    high: TypedExpr
    bins: TypedExpr
    every: TypedExpr
    span: Span


@dataclass(eq=False, repr=False)
class InputSymbol(Shown):
    """`input topic [in { values }] every d;`: without values the whole set of the topic."""

    path: str
    topic: TopicSymbol
    every: TypedExpr
    span: Span
    values: tuple[TypedExpr, ...] = ()


@dataclass(eq=False, repr=False)
class StatedSymbol(Shown):
    """`guarantees t.x in { values };` or `assumes ...` of a test, for a publisher's stand-in.

    `read` is `t.x`, a read of a topic or of a field of a topic; `text` is the statement as written.
    """

    kind: str
    read: TypedExpr
    values: tuple[TypedExpr, ...]
    text: str
    span: Span


@dataclass(eq=False, repr=False)
class ExternalSymbol(Shown):
    """`external topic t ...;`; `every` and `delayed` are durations, or None if not declared."""

    topic: TopicSymbol
    every: TypedExpr | None
    delayed: TypedExpr | None
    measured: tuple[MeasuredSymbol, ...]
    span: Span


@dataclass(eq=False, repr=False)
class SetSymbol(Shown):
    """`set K = 3;` for the instance `path` of the system; `path` "" means all of the system."""

    path: str
    param: ParamSymbol
    value: Value
    span: Span


@dataclass(eq=False, repr=False)
class ByContract(Symbol):
    """The word `contract` in `replace M by contract;`, in the place of a node or a plant."""


@dataclass(eq=False, repr=False)
class SystemSymbol(Symbol):
    """A system: instances, properties and overrides."""

    default: bool
    instances: tuple[InstanceSymbol, ...]
    until: TypedExpr | None = None
    properties: tuple[PropertySymbol, ...] = ()
    forces: tuple[tuple[str, str, Span], ...] = ()
    replaces: tuple[tuple[str, NodeSymbol | PlantSymbol | ByContract, Span], ...] = ()
    sets: tuple[SetSymbol, ...] = ()
    inputs: tuple[InputSymbol, ...] = ()
    faults: tuple[SystemFaultSymbol, ...] = ()
    measures: tuple[MeasureSymbol, ...] = ()
    inlines: tuple[tuple[str, Span], ...] = ()
    """Nodes that run in the trusted part's thread, each with where the system says so."""
    externals: tuple[ExternalSymbol, ...] = ()
    deploys: SystemSymbol | None = None
    """The system that this one deploys: its modules were proved there; or None."""

    @cached_property
    def by_name(self) -> dict[str, InstanceSymbol]:
        """Maps the name of each instance to the instance."""
        return {i.name: i for i in self.instances}


@dataclass(eq=False, repr=False)
class TestSymbol(Symbol):
    """A `test` block; executed by `soter test`. `order`: where it declares the deployed order."""

    system: SystemSymbol
    replaces: tuple[tuple[str, NodeSymbol | PlantSymbol | ByContract, Span], ...]
    skew: TypedExpr | None
    horizon: TypedExpr | None
    properties: tuple[PropertySymbol, ...]
    quantum: TypedExpr | None = None
    faults: tuple[FaultSymbol, ...] = ()
    inputs: tuple[InputSymbol, ...] = ()
    sets: tuple[SetSymbol, ...] = ()
    stated: tuple[StatedSymbol, ...] = ()
    order: Span | None = None


class Cost(NamedTuple):
    """The cost of one execution at most, as counted by `language/model/tree_walk.py`."""

    operations: int
    bytes: int
    externs: tuple[str, ...]
    """Extern functions it may call, whose own code is not counted."""


@dataclass(eq=False, repr=False)
class TypedProgram(Shown):
    """A whole checked program: the main file and everything it imports."""

    path: str
    sha256: str
    """Hash of the edition, every source text, every data file, in order of loading."""
    consts: dict[str, ConstSymbol] = field(default_factory=dict)
    params: dict[str, ParamSymbol] = field(default_factory=dict)
    funs: dict[str, FunSymbol] = field(default_factory=dict)
    topics: dict[str, TopicSymbol] = field(default_factory=dict)
    nodes: dict[str, NodeSymbol] = field(default_factory=dict)
    modules: dict[str, ModuleSymbol] = field(default_factory=dict)
    plants: dict[str, PlantSymbol] = field(default_factory=dict)
    systems: dict[str, SystemSymbol] = field(default_factory=dict)
    tests: dict[str, TestSymbol] = field(default_factory=dict)
    stand_ins: dict[TopicSymbol, tuple[tuple[str, ...], TopicSymbol]] = field(default_factory=dict)
    """Symbol for a sub-system's topic in the system around it -> instance path, topic itself."""
    damaged: set[object] = field(default_factory=set)
    """Symbols whose declarations have errors, so that others' uses of them report no more."""
    system_sizes: dict[SystemSymbol, tuple[int, int]] = field(default_factory=dict)
    """System -> how many components and levels `SizeCounter` has counted in it."""
    doubted: set[object] = field(default_factory=set)
    """Pairs (node or plant, its parameters) whose steps were already examined for warnings."""
    trials: dict[tuple[object, ...], list[Any]] = field(default_factory=dict)
    """Results of module predicates at values that `contradictory_predicates.py` has tried."""
    costs: dict[NodeSymbol | ModuleSymbol, Cost] = field(default_factory=dict)
    """Costs of the steps of all nodes but externs, and of the decision modules that have their
    predicates."""
    identified: dict[str, int] = field(default_factory=dict)
    """Name of a data file that `soter identify` wrote -> how many episodes were held out."""
    incomplete: bool = False
    """Whether the parser could not read a declaration of the main file at all."""

    @property
    def externs(self) -> tuple[str, ...]:
        """Gives names of the nodes, plants and functions that are written in Python or C."""
        tables: list[dict[str, Any]] = [self.nodes, self.plants, self.funs]
        return tuple([name for table in tables for name, s in table.items() if s.extern])

    def param(self, name: str) -> ParamSymbol | None:
        """Gives the parameter of a name such as `GAIN` or `r[0].GAIN` of an instance; else None."""
        while name not in self.params and "." in name:
            name = name.partition(".")[2]
        return self.params.get(name)

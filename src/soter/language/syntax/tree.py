"""The syntax tree: what the text says, before anything is checked.

Purpose: immutable nodes with spans, one class per construct of `docs/grammar.ebnf`.
Non-goals: names, types, meaning (`language/check/`); comments (the printer reads them from tokens).
"""

from __future__ import annotations

from soter.diagnostics.diagnostic import Span
from soter.language.syntax.node import Node, node


@node()
class Name(Node):
    """An identifier and its place in the text."""

    text: str
    span: Span

    @property
    def word(self) -> Span:
        """Gives the span of the word alone, without the index that an `ElementName` has."""
        return Span(self.span.source, self.span.start, self.span.start + len(self.text))


@node()
class Ref(Node):
    """A name of this file, or `file.name` of an imported file if `qualifier` is set."""

    qualifier: Name | None
    name: Name
    span: Span

    @property
    def text(self) -> str:
        """Gives the reference as written."""
        return f"{self.qualifier.text}.{self.name.text}" if self.qualifier else self.name.text


@node()
class DottedPath(Node):
    """A dotted path such as `motion.x` or `left.cart`."""

    parts: tuple[Name, ...]
    span: Span

    @property
    def text(self) -> str:
        """Gives the path as written."""
        return ".".join(p.text for p in self.parts)


# ---------------------------------------------------------------- expressions


@node()
class ElementName(Name):
    """`r[i]` in a path: an element of an array of instances; `text` is the name of the array."""

    indices: tuple[SyntaxExpr, ...]


@node()
class SyntaxExpr(Node):
    """The base class of expressions."""

    span: Span


@node()
class IntLit(SyntaxExpr):
    """`42`; also stands where a float is expected."""

    value: int


@node()
class FloatLit(SyntaxExpr):
    """`1.5e-3`; `text` is kept for the printer."""

    value: float
    text: str


@node()
class DurationLit(SyntaxExpr):
    """`10ms`; `value_ns` is None if the duration is not a whole number of nanoseconds."""

    value_ns: int | None
    text: str


@node()
class BoolLit(SyntaxExpr):
    """`true` or `false`."""

    value: bool


@node()
class NameExpr(SyntaxExpr):
    """A bare name in an expression."""

    name: Name


@node()
class FieldExpr(SyntaxExpr):
    """`target.field`; also `file.name`, `Enum.member`, `list.len` and `plant.truth`."""

    target: SyntaxExpr
    field: Name


@node()
class IndexExpr(SyntaxExpr):
    """`target[index]`."""

    target: SyntaxExpr
    index: SyntaxExpr


@node()
class CallExpr(SyntaxExpr):
    """`callee(arguments)`; the callee is a NameExpr or a FieldExpr."""

    callee: SyntaxExpr
    arguments: tuple[SyntaxExpr, ...]


@node()
class UnaryExpr(SyntaxExpr):
    """`-e` or `!e`."""

    op: str
    operand: SyntaxExpr


@node()
class BinaryExpr(SyntaxExpr):
    """`left op right` for + - * / % < <= > >= == != && ||."""

    op: str
    left: SyntaxExpr
    right: SyntaxExpr


@node()
class ConditionalExpr(SyntaxExpr):
    """`condition ? then : otherwise`."""

    condition: SyntaxExpr
    then: SyntaxExpr
    otherwise: SyntaxExpr


@node()
class RecordExpr(SyntaxExpr):
    """`{ x: 1.0, y: 2.0 }`."""

    fields: tuple[tuple[Name, SyntaxExpr], ...]


@node()
class ListExpr(SyntaxExpr):
    """`[a, b, c]`: an array or a bounded list, by the expected type."""

    elements: tuple[SyntaxExpr, ...]


@node()
class ChooseExpr(SyntaxExpr):
    """`[fair] choose bool`, `choose Enum`, `choose [a, b]`, `choose { e1, e2 }`.

    At most one of `type` and `interval` is set; if neither is, `options` are the choices.
    """

    fair: bool
    type: TypeExpr | None
    interval: IntervalExpr | None
    options: tuple[SyntaxExpr, ...]


@node()
class ErrorExpr(SyntaxExpr):
    """The place of an expression with a syntax error that was already reported."""


# ---------------------------------------------------------------- types


@node()
class TypeExpr(Node):
    """The base class of type expressions."""

    span: Span


@node()
class IntervalExpr(Node):
    """`[low, high]`."""

    low: SyntaxExpr
    high: SyntaxExpr
    span: Span


@node()
class BuiltinType(TypeExpr):
    """`bool`, `int`, `float` or `duration`."""

    name: str


@node()
class RangedIntType(TypeExpr):
    """`int in [low, high]`."""

    interval: IntervalExpr


@node()
class NamedType(TypeExpr):
    """A declared type."""

    ref: Ref


@node()
class RecordTypeExpr(TypeExpr):
    """`{ x: float, y: float }`."""

    fields: tuple[tuple[Name, TypeExpr], ...]


@node()
class ArrayTypeExpr(TypeExpr):
    """`T[n]`."""

    element: TypeExpr
    size: SyntaxExpr


@node()
class ListTypeExpr(TypeExpr):
    """`T[<=n]`."""

    element: TypeExpr
    capacity: SyntaxExpr


@node()
class UnitTypeExpr(TypeExpr):
    """`T unit "m/s"`: the unit of the numbers of T, shown to people."""

    base: TypeExpr
    unit: str
    unit_span: Span


@node()
class EnumTypeExpr(TypeExpr):
    """`enum { A, B }`; only on the right of a `type` declaration."""

    members: tuple[Name, ...]


@node()
class ErrorTypeExpr(TypeExpr):
    """The place of a type with a syntax error that was already reported."""


# ---------------------------------------------------------------- statements


@node()
class SyntaxStmt(Node):
    """The base class of statements."""

    span: Span


@node()
class Block(Node):
    """`{ statements }`."""

    statements: tuple[SyntaxStmt, ...]
    span: Span


@node()
class LetStmt(SyntaxStmt):
    """`let name [: type] = value;`: a variable that is never assigned again."""

    name: Name
    type: TypeExpr | None
    value: SyntaxExpr


@node()
class VarStmt(SyntaxStmt):
    """`var name [: type] [= value];`, with a type, a value or both."""

    name: Name
    type: TypeExpr | None
    value: SyntaxExpr | None


@node()
class AssignStmt(SyntaxStmt):
    """`place = value;`; the place is a chain of NameExpr, FieldExpr, IndexExpr."""

    place: SyntaxExpr
    value: SyntaxExpr


@node()
class PushStmt(SyntaxStmt):
    """`push list, value;`."""

    place: SyntaxExpr
    value: SyntaxExpr


@node()
class PublishStmt(SyntaxStmt):
    """`publish topic = value;`."""

    topic: Ref
    value: SyntaxExpr


@node()
class ReturnStmt(SyntaxStmt):
    """`return value;`."""

    value: SyntaxExpr


@node()
class AssertStmt(SyntaxStmt):
    """`assert condition [, "message"];`."""

    condition: SyntaxExpr
    message: str | None


@node()
class IfStmt(SyntaxStmt):
    """`if c {...} elseif d {...} else {...}`; `arms` in order."""

    arms: tuple[tuple[SyntaxExpr, Block], ...]
    otherwise: Block | None


@node()
class ForRangeStmt(SyntaxStmt):
    """`for name in low..high {...}`: low, low+1, ..., high-1, both constant."""

    name: Name
    low: SyntaxExpr
    high: SyntaxExpr
    body: Block


@node()
class ForEachStmt(SyntaxStmt):
    """`for name in array_or_list {...}`."""

    name: Name
    sequence: SyntaxExpr
    body: Block


# ---------------------------------------------------------------- declarations


@node()
class Decl(Node):
    """The base class of top-level declarations."""

    name: Name
    span: Span


@node()
class ImportDecl(Decl):
    """`import "path" as name;`."""

    path: str
    path_span: Span


@node()
class TypeDecl(Decl):
    """`type Name = ...;`."""

    type: TypeExpr


@node()
class ConstDecl(Decl):
    """`const NAME: type = value;` or `= data "file";`: exactly one of `value`, `data` is set."""

    type: TypeExpr
    value: SyntaxExpr | None
    data: str | None
    data_span: Span | None


@node()
class ParamDecl(Decl):
    """`param NAME: type = default in [low, high];`."""

    type: TypeExpr
    default: SyntaxExpr
    interval: IntervalExpr | None


@node(kw_only=True)
class FunDecl(Decl):
    """`fun name(parameters): type {...}`; an `extern fun` has no body."""

    parameters: tuple[tuple[Name, TypeExpr], ...]
    result: TypeExpr
    body: Block | None
    extern: bool
    source: str | None
    source_span: Span | None


@node()
class RecordSet(Node):
    """`{ x in [a, b], p in { ... } }`: a set of records by the sets of their fields."""

    fields: tuple[tuple[Name, IntervalExpr | RecordSet], ...]
    span: Span


ValueSet = IntervalExpr | RecordSet


@node()
class TopicDecl(Decl):
    """`[input] topic name: type [in set] [= default] [max_age d] [static];`."""

    input: bool
    type: TypeExpr
    values: ValueSet | None
    default: SyntaxExpr | None
    max_age: SyntaxExpr | None
    static: bool


@node()
class Subscription(Node):
    """A subscribed topic; `queue` is the length of its queue, None without one."""

    topic: Ref
    queue: int | None
    policy: str | None
    span: Span


@node()
class Publication(Node):
    """A published topic; `burst`: how many messages a step may publish, None if not declared."""

    topic: Ref
    burst: int | None
    span: Span


@node()
class LocalVar(Node):
    """`var name: type [= initial];`: a local variable of a node."""

    name: Name
    type: TypeExpr
    initial: SyntaxExpr | None
    span: Span


@node(kw_only=True)
class NodeDecl(Decl):
    """`node` or `extern node`; `step` is None only if it is extern, or after a syntax error."""

    period: SyntaxExpr
    phase: SyntaxExpr | None
    extern: bool
    source: str | None
    source_span: Span | None
    subscribes: tuple[Subscription, ...]
    publishes: tuple[Publication, ...]
    failsafe: tuple[tuple[Ref, SyntaxExpr], ...]
    locals: tuple[LocalVar, ...]
    assumes: tuple[SyntaxExpr, ...]
    guarantees: tuple[SyntaxExpr, ...]
    takeover: Block | None
    step: Block | None
    takes: IntervalExpr | None
    wcet: SyntaxExpr | None = None
    jitter: SyntaxExpr | None = None


@node()
class GridAxis(Node):
    """`motion.x in [a, b] / cells open to c`: an axis in a verify block.

    `unbounded` is true for `open` without an end.
    """

    path: DottedPath
    interval: IntervalExpr
    cells: SyntaxExpr
    open: SyntaxExpr | None = None
    unbounded: bool = False


@node()
class AxisGroup(Node):
    """`grid a ..., b ...;`: axes that are analysed together."""

    axes: tuple[GridAxis, ...]
    span: Span


@node()
class CommandSet(Node):
    """`commands accel in {-1.0, 0.0, 1.0};`: what a synthesized controller may publish."""

    path: DottedPath
    values: tuple[SyntaxExpr, ...]
    span: Span


@node()
class Delays(Node):
    """`late dm D, sc D, Node D;` or `response ...`: times of the DM, of SC and of nodes."""

    dm: SyntaxExpr | None
    sc: SyntaxExpr | None
    nodes: tuple[tuple[DottedPath, SyntaxExpr], ...] = ()


@node()
class Abstraction(Node):
    """`along: Axis = expr`, an item of `abstracts d by ...`."""

    name: Name
    plant: Ref
    value: SyntaxExpr


@node()
class View(Node):
    """`view east { abstracts ...; grid ...; }`: a part of the predicates on separate plants."""

    name: Name
    groups: tuple[AxisGroup, ...]
    abstracts: tuple[tuple[Name, tuple[Abstraction, ...]], ...]
    span: Span


@node(kw_only=True)
class VerifyBlock(Node):
    """`verify { ... }`: used by `soter verify`, but syntax and names are always checked."""

    groups: tuple[AxisGroup, ...]
    abstracts: tuple[tuple[Name, tuple[Abstraction, ...]], ...]
    commands: tuple[CommandSet, ...]
    core: SyntaxExpr | None
    horizon: SyntaxExpr | None
    levels: SyntaxExpr | None
    late: Delays | None
    response: Delays | None
    acts_least: SyntaxExpr | None
    acts: SyntaxExpr | None
    recover: SyntaxExpr | None
    stays: Span | None
    """`recover never;`: SC may keep control for ever."""
    dropout: SyntaxExpr | None
    age: SyntaxExpr | None
    views: tuple[View, ...]
    induction: Span | None
    lemmas: tuple[SyntaxExpr, ...]
    progress: tuple[SyntaxExpr, ...]
    enters: SyntaxExpr | None
    span: Span


@node()
class Synthesized(Node):
    """`sc synthesized period 10ms;`: a controller that `soter verify --synthesize` finds."""

    period: SyntaxExpr
    span: Span


@node()
class Clause(Node):
    """`assumes name: e;` or `guarantees name: e;` of a module."""

    kind: str
    name: Name
    condition: SyntaxExpr
    span: Span


@node()
class Returns(Node):
    """`returns after topic;`, or `returns never;` without a topic."""

    topic: Ref | None
    span: Span


@node()
class Move(Node):
    """`pose.x by 0.1`, `gap by 0.2 down` of a `rest` clause."""

    path: DottedPath
    by: SyntaxExpr
    way: str
    """"" (both ways), "up" or "down"."""


@node()
class Rest(Node):
    """`rest e moves x by d, ... within T;`: where SC ends, and how far it then still moves."""

    condition: SyntaxExpr
    moves: tuple[Move, ...]
    within: SyntaxExpr
    span: Span


@node()
class EachCommand(Node):
    """`shield;`, without a number: SC is followed from each command of AC."""

    span: Span


@node(kw_only=True)
class RtaDecl(Decl):
    """`rta Name {...}`; a missing part is None, which the checker reports."""

    ac: Ref | None
    sc: Ref | Synthesized | None
    period: SyntaxExpr | None
    safe: SyntaxExpr | None
    safer: SyntaxExpr | None
    ttf: SyntaxExpr | None
    clean: SyntaxExpr | None
    verify: VerifyBlock | None
    contract: tuple[Clause, ...] = ()
    failsafe: tuple[tuple[Ref, SyntaxExpr], ...] = ()
    """The fail-safe law: `failsafe speed = 0.0;`."""
    wcet: SyntaxExpr | None = None
    jitter: SyntaxExpr | None = None
    returns: Returns | None = None
    shield: SyntaxExpr | EachCommand | None = None
    """`shield 8;`: into how many cells each number of a command is cut."""
    toward_sc: bool = False
    """`shield 8 toward sc;`: a command that is not permitted is moved toward SC's."""
    candidates: Ref | None = None
    """`shield toward plans, sc;`: a topic with an array of commands that are tried before SC's."""
    rest: Rest | None = None
    plans: tuple[Ref, ...] = ()
    """`sc Brake, Left;`: all named nodes, of which `sc` is the first; () if only one is named."""


@node()
class PlantState(Node):
    """`state name: type [in [a, b]] [= initial];`: drawn uniformly from [a, b] if it is written."""

    name: Name
    type: TypeExpr
    interval: IntervalExpr | None
    initial: SyntaxExpr | None
    span: Span


@node()
class DisturbanceItem(Node):
    """`disturbance name: type in [a, b] [hold d];`."""

    name: Name
    type: TypeExpr
    interval: IntervalExpr
    hold: SyntaxExpr | None
    span: Span


@node()
class PlantLet(Node):
    """`let name = value;` inside a plant; later items of the plant can use the name."""

    name: Name
    type: TypeExpr | None
    value: SyntaxExpr
    span: Span


@node(kw_only=True)
class PlantDecl(Decl):
    """`plant` or `extern plant`; `drives` has no expressions if the plant is extern.

    `integrate` is (name of a scheme, substeps or None), or None if left out (`schemes.py`).
    """

    period: SyntaxExpr
    extern: bool
    source: str | None
    source_span: Span | None
    reads: tuple[Ref, ...]
    drives: tuple[tuple[Ref, SyntaxExpr | None], ...]
    states: tuple[PlantState, ...]
    disturbances: tuple[DisturbanceItem, ...]
    lets: tuple[PlantLet, ...]
    der: tuple[tuple[Name, SyntaxExpr], ...]
    next: tuple[tuple[Name, SyntaxExpr], ...]
    integrate: tuple[str, SyntaxExpr | None] | None
    measured: tuple[tuple[DottedPath, SyntaxExpr], ...]


@node()
class Repeated(Node):
    """`for i in low..high { items }` of a system or test: its items of one kind, in order.

    A loop becomes a `Repeated` for each kind of item, all with the same span. Loops may be nested.
    """

    name: Name
    low: SyntaxExpr
    high: SyntaxExpr
    items: tuple[object, ...]
    span: Span


@node()
class SetParam(Node):
    """`set K = 3;`, `set r[0].K = 3;`."""

    param: DottedPath
    value: SyntaxExpr
    span: Span


@node()
class Instance(Node):
    """An instance `name: What { topic = other, set K = 3 };`, perhaps after `module` or `node`.

    `kind` is this word or None. `name` is an `ElementName` for `r[i]: What;`.
    """

    name: Name
    what: Ref
    kind: str | None
    renames: tuple[tuple[Ref, DottedPath], ...]
    span: Span
    sets: tuple[SetParam, ...] = ()


@node()
class PropertyItem(Node):
    """`always e;`, `never e;`, `eventually e within d;`, `p leadsto e within d;`.

    `in_loop`: the item comes from a loop, and its loop variables are already filled in.
    """

    kind: str
    premise: SyntaxExpr | None
    condition: SyntaxExpr
    within: SyntaxExpr | None
    span: Span
    in_loop: bool = False


@node()
class Inline(Node):
    """`inline M.Fast;`: the node runs in the thread of the trusted part."""

    what: DottedPath
    span: Span


@node()
class Force(Node):
    """`force M ac;`."""

    module: DottedPath
    to: str
    span: Span


@node()
class Replace(Node):
    """`replace A by B;`."""

    what: DottedPath
    by: Ref
    span: Span


@node()
class DriveInput(Node):
    """`input goal [in { a, b }] every 1s;`: draws from { a, b }, or else from the topic's set."""

    topic: DottedPath
    values: tuple[SyntaxExpr, ...] | None
    every: SyntaxExpr
    span: Span


@node()
class StatedValues(Node):
    """`guarantees t.x in { a, b };` or `assumes ...` of a test: the values a stand-in publishes."""

    kind: str
    topic: DottedPath
    values: tuple[SyntaxExpr, ...]
    span: Span


@node()
class ExternalTopic(Node):
    """`external topic motion [every d] [delayed d] [measured motion.x within e, ...];`."""

    topic: DottedPath
    every: SyntaxExpr | None
    delayed: SyntaxExpr | None
    measured: tuple[tuple[DottedPath, SyntaxExpr], ...]
    span: Span


@node()
class TimingFaultItem(Node):
    """`late N by d;`, `skip N [at most k];`, `overrun N by d;` of a test."""

    kind: str
    component: DottedPath
    by: SyntaxExpr | None
    at_most: SyntaxExpr | None
    span: Span


@node()
class SystemFault(Node):
    """One item of `faults { ... }`: `nan M.Fast at 4 per 1h for 1s;`, `order any;`.

    `target` is None for an order. `by` has the amounts: several for a measured lateness.
    """

    kind: str
    target: DottedPath | None
    by: tuple[SyntaxExpr, ...]
    rate: SyntaxExpr | None
    per: SyntaxExpr | None
    lasts: SyntaxExpr | None
    span: Span


@node()
class MeasureItem(Node):
    """`measure name = e in [low, high] / bins every d;`: a number that campaigns report."""

    name: Name
    value: SyntaxExpr
    interval: IntervalExpr
    bins: SyntaxExpr
    every: SyntaxExpr
    span: Span


@node(kw_only=True)
class SystemDecl(Decl):
    """`system Name [default] [deploys Other] {...}`."""

    default: bool
    instances: tuple[Instance | Repeated, ...]
    until: SyntaxExpr | None
    properties: tuple[PropertyItem | Repeated, ...]
    forces: tuple[Force | Repeated, ...]
    replaces: tuple[Replace | Repeated, ...]
    sets: tuple[SetParam | Repeated, ...]
    inputs: tuple[DriveInput | Repeated, ...]
    faults: tuple[SystemFault, ...] = ()
    measures: tuple[MeasureItem, ...] = ()
    inlines: tuple[Inline | Repeated, ...] = ()
    externals: tuple[ExternalTopic, ...] = ()
    deploys: Ref | None = None


@node(kw_only=True)
class TestDecl(Decl):
    """`test Name {...}`: a test that `soter test` runs."""

    system: Ref | None
    replaces: tuple[Replace | Repeated, ...]
    skew: SyntaxExpr | None
    horizon: SyntaxExpr | None
    properties: tuple[PropertyItem | Repeated, ...]
    quantum: SyntaxExpr | None = None
    faults: tuple[TimingFaultItem | Repeated, ...] = ()
    inputs: tuple[DriveInput | Repeated, ...] = ()
    sets: tuple[SetParam | Repeated, ...] = ()
    stated: tuple[StatedValues | Repeated, ...] = ()
    order: Span | None = None
    """The place of `order deployed;`, None if it is not there."""


@node()
class File(Node):
    """One parsed file; `edition` is None if its first line is missing (already reported).

    `broken` has the names of declarations and imports that a syntax error damaged or removed. Later
    passes do not report these names as unknown or incomplete.
    """

    edition: int | None
    imports: tuple[ImportDecl, ...]
    declarations: tuple[Decl, ...]
    span: Span
    broken: frozenset[str] = frozenset()

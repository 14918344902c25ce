"""The syntax tree: what the text says, before anybody asks whether it makes sense.

Purpose: immutable nodes with spans, one class per construct of `docs/grammar.ebnf`.
Non-goals: names, types, meaning (`program/`); comments (the printer reads them from tokens).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.diagnostics.span import Span


@dataclass(frozen=True, slots=True)
class Name:
    """An identifier where it is written."""

    text: str
    span: Span


@dataclass(frozen=True, slots=True)
class Ref:
    """A name of this file, or `file.name` of an imported one (`qualifier` set)."""

    qualifier: Name | None
    name: Name
    span: Span

    @property
    def text(self) -> str:
        """The reference as written."""
        return f"{self.qualifier.text}.{self.name.text}" if self.qualifier else self.name.text


@dataclass(frozen=True, slots=True)
class Path:
    """A dotted path such as `motion.x` or `left.cart`."""

    parts: tuple[Name, ...]
    span: Span

    @property
    def text(self) -> str:
        """The path as written."""
        return ".".join(p.text for p in self.parts)


# ---------------------------------------------------------------- expressions


@dataclass(frozen=True, slots=True)
class ElementName(Name):
    """`r[i]` in a path: an element of an array of instances; `text` is the name of the array."""

    indices: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Expr:
    """Any expression."""

    span: Span


@dataclass(frozen=True, slots=True)
class IntLit(Expr):
    """`42`; also stands where a float is expected."""

    value: int


@dataclass(frozen=True, slots=True)
class FloatLit(Expr):
    """`1.5e-3`; `text` is kept for the printer."""

    value: float
    text: str


@dataclass(frozen=True, slots=True)
class DurationLit(Expr):
    """`10ms`; `value_ns` is None when it is not a whole number of nanoseconds."""

    value_ns: int | None
    text: str


@dataclass(frozen=True, slots=True)
class BoolLit(Expr):
    """`true` or `false`."""

    value: bool


@dataclass(frozen=True, slots=True)
class NameExpr(Expr):
    """A bare name in an expression."""

    name: Name


@dataclass(frozen=True, slots=True)
class FieldExpr(Expr):
    """`target.field`; also `file.name`, `Enum.member`, `list.len` and `plant.truth`."""

    target: Expr
    field: Name


@dataclass(frozen=True, slots=True)
class IndexExpr(Expr):
    """`target[index]`."""

    target: Expr
    index: Expr


@dataclass(frozen=True, slots=True)
class CallExpr(Expr):
    """`callee(arguments)`; the callee is a NameExpr or a FieldExpr."""

    callee: Expr
    arguments: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class UnaryExpr(Expr):
    """`-e` or `!e`."""

    op: str
    operand: Expr


@dataclass(frozen=True, slots=True)
class BinaryExpr(Expr):
    """`left op right` for + - * / % < <= > >= == != && ||."""

    op: str
    left: Expr
    right: Expr


@dataclass(frozen=True, slots=True)
class ConditionalExpr(Expr):
    """`condition ? then : otherwise`."""

    condition: Expr
    then: Expr
    otherwise: Expr


@dataclass(frozen=True, slots=True)
class RecordExpr(Expr):
    """`{ x: 1.0, y: 2.0 }`."""

    fields: tuple[tuple[Name, Expr], ...]


@dataclass(frozen=True, slots=True)
class ListExpr(Expr):
    """`[a, b, c]`: an array or a bounded list, by the expected type."""

    elements: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class ChooseExpr(Expr):
    """`[fair] choose bool`, `choose Enum`, `choose [a, b]`, `choose { e1, e2 }`.

    Exactly one of `type` and `interval` is set, or neither: then `options` are the choices.
    """

    fair: bool
    type: TypeExpr | None
    interval: Interval | None
    options: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class ErrorExpr(Expr):
    """Stands where an expression could not be parsed; already reported, never again."""


# ---------------------------------------------------------------- types


@dataclass(frozen=True, slots=True)
class TypeExpr:
    """Any type expression."""

    span: Span


@dataclass(frozen=True, slots=True)
class Interval:
    """`[low, high]`."""

    low: Expr
    high: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class BuiltinType(TypeExpr):
    """`bool`, `int`, `float` or `duration`."""

    name: str


@dataclass(frozen=True, slots=True)
class RangedIntType(TypeExpr):
    """`int in [low, high]`."""

    interval: Interval


@dataclass(frozen=True, slots=True)
class NamedType(TypeExpr):
    """A declared type."""

    ref: Ref


@dataclass(frozen=True, slots=True)
class RecordTypeExpr(TypeExpr):
    """`{ x: float, y: float }`."""

    fields: tuple[tuple[Name, TypeExpr], ...]


@dataclass(frozen=True, slots=True)
class ArrayTypeExpr(TypeExpr):
    """`T[n]`."""

    element: TypeExpr
    size: Expr


@dataclass(frozen=True, slots=True)
class ListTypeExpr(TypeExpr):
    """`T[<=n]`."""

    element: TypeExpr
    capacity: Expr


@dataclass(frozen=True, slots=True)
class UnitTypeExpr(TypeExpr):
    """`T unit "m/s"`: what the numbers of T count, for people."""

    base: TypeExpr
    unit: str
    unit_span: Span


@dataclass(frozen=True, slots=True)
class EnumTypeExpr(TypeExpr):
    """`enum { A, B }`; only on the right of a `type` declaration."""

    members: tuple[Name, ...]


@dataclass(frozen=True, slots=True)
class ErrorTypeExpr(TypeExpr):
    """Stands where a type could not be parsed; already reported, never again."""


# ---------------------------------------------------------------- statements


@dataclass(frozen=True, slots=True)
class Stmt:
    """Any statement."""

    span: Span


@dataclass(frozen=True, slots=True)
class Block:
    """`{ statements }`."""

    statements: tuple[Stmt, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class LetStmt(Stmt):
    """`let name [: type] = value;`, never assigned again."""

    name: Name
    type: TypeExpr | None
    value: Expr


@dataclass(frozen=True, slots=True)
class VarStmt(Stmt):
    """`var name [: type] [= value];`; at least one of the two stands."""

    name: Name
    type: TypeExpr | None
    value: Expr | None


@dataclass(frozen=True, slots=True)
class AssignStmt(Stmt):
    """`place = value;`; the place is a chain of NameExpr, FieldExpr, IndexExpr."""

    place: Expr
    value: Expr


@dataclass(frozen=True, slots=True)
class PushStmt(Stmt):
    """`push list, value;`."""

    place: Expr
    value: Expr


@dataclass(frozen=True, slots=True)
class PublishStmt(Stmt):
    """`publish topic = value;`."""

    topic: Ref
    value: Expr


@dataclass(frozen=True, slots=True)
class ReturnStmt(Stmt):
    """`return value;`."""

    value: Expr


@dataclass(frozen=True, slots=True)
class AssertStmt(Stmt):
    """`assert condition [, "message"];`."""

    condition: Expr
    message: str | None


@dataclass(frozen=True, slots=True)
class IfStmt(Stmt):
    """`if c {...} elseif d {...} else {...}`; `arms` in order."""

    arms: tuple[tuple[Expr, Block], ...]
    otherwise: Block | None


@dataclass(frozen=True, slots=True)
class ForRangeStmt(Stmt):
    """`for name in low..high {...}`: low, low+1, ..., high-1, both constant."""

    name: Name
    low: Expr
    high: Expr
    body: Block


@dataclass(frozen=True, slots=True)
class ForEachStmt(Stmt):
    """`for name in array_or_list {...}`."""

    name: Name
    sequence: Expr
    body: Block


# ---------------------------------------------------------------- declarations


@dataclass(frozen=True, slots=True)
class Decl:
    """Any top-level declaration."""

    name: Name
    span: Span


@dataclass(frozen=True, slots=True)
class ImportDecl(Decl):
    """`import "path" as name;`."""

    path: str
    path_span: Span


@dataclass(frozen=True, slots=True)
class TypeDecl(Decl):
    """`type Name = ...;`."""

    type: TypeExpr


@dataclass(frozen=True, slots=True)
class ConstDecl(Decl):
    """`const NAME: type = value;` or `= data "file";`: exactly one of `value`, `data` is set."""

    type: TypeExpr
    value: Expr | None
    data: str | None
    data_span: Span | None


@dataclass(frozen=True, slots=True)
class ParamDecl(Decl):
    """`param NAME: type = default in [low, high];`."""

    type: TypeExpr
    default: Expr
    interval: Interval | None


@dataclass(frozen=True, slots=True, kw_only=True)
class FunDecl(Decl):
    """`fun name(parameters): type {...}`; an `extern fun` has no body."""

    parameters: tuple[tuple[Name, TypeExpr], ...]
    result: TypeExpr
    body: Block | None
    extern: bool
    source: str | None
    source_span: Span | None


@dataclass(frozen=True, slots=True)
class RecordSet:
    """`{ x in [a, b], p in { ... } }`: a value set field by field."""

    fields: tuple[tuple[Name, Interval | RecordSet], ...]
    span: Span


ValueSet = Interval | RecordSet


@dataclass(frozen=True, slots=True)
class TopicDecl(Decl):
    """`[input] topic name: type [in set] [= default] [max_age d];`."""

    input: bool
    type: TypeExpr
    values: ValueSet | None
    default: Expr | None
    max_age: Expr | None


@dataclass(frozen=True, slots=True)
class Subscription:
    """A subscribed topic; `queue` is its length when it asks for one."""

    topic: Ref
    queue: int | None
    policy: str | None
    span: Span


@dataclass(frozen=True, slots=True)
class Publication:
    """A published topic; `burst`: how many messages a step may publish, where it is said."""

    topic: Ref
    burst: int | None
    span: Span


@dataclass(frozen=True, slots=True)
class LocalVar:
    """`var name: type [= initial];` of a node."""

    name: Name
    type: TypeExpr
    initial: Expr | None
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeDecl(Decl):
    """`node` or `extern node`; `step` is None exactly when extern (or after a parse error)."""

    period: Expr
    phase: Expr | None
    extern: bool
    source: str | None
    source_span: Span | None
    subscribes: tuple[Subscription, ...]
    publishes: tuple[Publication, ...]
    failsafe: tuple[tuple[Ref, Expr], ...]
    locals: tuple[LocalVar, ...]
    assumes: tuple[Expr, ...]
    guarantees: tuple[Expr, ...]
    takeover: Block | None
    step: Block | None
    takes: Interval | None
    wcet: Expr | None = None
    jitter: Expr | None = None


@dataclass(frozen=True, slots=True)
class GridAxis:
    """`motion.x in [a, b] / cells open to c` of a verify block; a polytope's axes have no cells."""

    path: Path
    interval: Interval | None
    cells: Expr | None
    open: Expr | None = None


@dataclass(frozen=True, slots=True)
class AxisGroup:
    """`grid a ..., b ...;` or `polytope a, b;`: axes that are analysed together."""

    kind: str
    axes: tuple[GridAxis, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class CommandSet:
    """`commands accel in {-1.0, 0.0, 1.0};`: what a synthesized controller may publish."""

    path: Path
    values: tuple[Expr, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Delays:
    """`late dm D, sc D, Node D;` or the same of `response`: times of the DM, of SC, of nodes."""

    dm: Expr | None
    sc: Expr | None
    nodes: tuple[tuple[Path, Expr], ...] = ()


@dataclass(frozen=True, slots=True)
class Abstraction:
    """`along: Axis = expr` of `abstracts d by ...`."""

    name: Name
    plant: Ref
    value: Expr


@dataclass(frozen=True, slots=True)
class View:
    """`view east { abstracts ...; grid ...; }`: a part of the predicates, on plants of its own."""

    name: Name
    groups: tuple[AxisGroup, ...]
    abstracts: tuple[tuple[Name, tuple[Abstraction, ...]], ...]
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class VerifyBlock:
    """`verify { ... }`: read by `soter verify`, syntax and names checked always."""

    groups: tuple[AxisGroup, ...]
    abstracts: tuple[tuple[Name, tuple[Abstraction, ...]], ...]
    commands: tuple[CommandSet, ...]
    core: Expr | None
    horizon: Expr | None
    levels: Expr | None
    late: Delays | None
    response: Delays | None
    acts: Expr | None
    recover: Expr | None
    stays: Span | None
    """`recover never;`: SC may keep control for ever."""
    dropout: Expr | None
    views: tuple[View, ...]
    induction: Span | None
    lemmas: tuple[Expr, ...]
    progress: tuple[Expr, ...]
    enters: Expr | None
    span: Span


@dataclass(frozen=True, slots=True)
class ModuleAsAc:
    """`ac module Keep;`: a whole module in the place of an advanced controller."""

    module: Ref
    span: Span


@dataclass(frozen=True, slots=True)
class Synthesized:
    """`sc synthesized period 10ms;`: a controller that `soter verify --synthesize` finds."""

    period: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class Clause:
    """`assumes name: e;` or `guarantees name: e;` of a module."""

    kind: str
    name: Name
    condition: Expr
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class RtaDecl(Decl):
    """`rta Name {...}`; a part that is missing is None (reported by the checker)."""

    ac: Ref | ModuleAsAc | None
    sc: Ref | Synthesized | None
    period: Expr | None
    safe: Expr | None
    safer: Expr | None
    ttf: Expr | None
    clean: Expr | None
    verify: VerifyBlock | None
    contract: tuple[Clause, ...] = ()
    failsafe: tuple[tuple[Ref, Expr], ...] = ()
    """The fail-safe law: `failsafe speed = 0.0;`."""
    wcet: Expr | None = None
    jitter: Expr | None = None


@dataclass(frozen=True, slots=True)
class PlantState:
    """`state name: type [in [a, b]] [= initial];`: drawn uniformly from the interval if given."""

    name: Name
    type: TypeExpr
    interval: Interval | None
    initial: Expr | None
    span: Span


@dataclass(frozen=True, slots=True)
class Disturbance:
    """`disturbance name: type in [a, b] [hold d];`."""

    name: Name
    type: TypeExpr
    interval: Interval
    hold: Expr | None
    span: Span


@dataclass(frozen=True, slots=True)
class PlantLet:
    """`let name = value;` inside a plant, seen by what follows it."""

    name: Name
    type: TypeExpr | None
    value: Expr
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantDecl(Decl):
    """`plant` or `extern plant`. `drives` has an expression unless the plant is extern.

    `integrate` is (name of a scheme, substeps or None), None when left out (`schemes.py`).
    """

    period: Expr
    extern: bool
    source: str | None
    source_span: Span | None
    reads: tuple[Ref, ...]
    drives: tuple[tuple[Ref, Expr | None], ...]
    states: tuple[PlantState, ...]
    disturbances: tuple[Disturbance, ...]
    lets: tuple[PlantLet, ...]
    der: tuple[tuple[Name, Expr], ...]
    next: tuple[tuple[Name, Expr], ...]
    integrate: tuple[str, Expr | None] | None
    measured: tuple[tuple[Path, Expr], ...]


@dataclass(frozen=True, slots=True)
class Repeated:
    """`for i in low..high { items }` of a system or a test: its items of one kind, in order.

    A loop is a `Repeated` for each kind of item in it, all with the same span; loops nest.
    """

    name: Name
    low: Expr
    high: Expr
    items: tuple[object, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class SetParam:
    """`set K = 3;`, `set r[0].K = 3;`."""

    param: Path
    value: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class Instance:
    """`name: What { topic = other, set K = 3 };`; `kind` is None there, else "module" or "node".

    `name` is an `ElementName` where it is `r[i]: What;`.
    """

    name: Name
    what: Ref
    kind: str | None
    renames: tuple[tuple[Ref, Path], ...]
    span: Span
    sets: tuple[SetParam, ...] = ()


@dataclass(frozen=True, slots=True)
class Property:
    """`always e;`, `never e;`, `eventually e within d;`, `p leadsto e within d;`.

    `in_loop`: it stood in a loop, whose variables are filled in.
    """

    kind: str
    premise: Expr | None
    condition: Expr
    within: Expr | None
    span: Span
    in_loop: bool = False


@dataclass(frozen=True, slots=True)
class Inline:
    """`inline M.Fast;`: it runs in the thread of the trusted part."""

    what: Path
    span: Span


@dataclass(frozen=True, slots=True)
class Force:
    """`force M ac;`."""

    module: Path
    to: str
    span: Span


@dataclass(frozen=True, slots=True)
class Replace:
    """`replace A by B;`."""

    what: Path
    by: Ref
    span: Span


@dataclass(frozen=True, slots=True)
class DriveInput:
    """`input goal [in { a, b }] every 1s;`: drawn from the values, without any from its set."""

    topic: Path
    values: tuple[Expr, ...] | None
    every: Expr
    span: Span


@dataclass(frozen=True, slots=True)
class ExternalTopic:
    """`external topic motion [every d] [delayed d] [measured motion.x within e, ...];`."""

    topic: Path
    every: Expr | None
    delayed: Expr | None
    measured: tuple[tuple[Path, Expr], ...]
    span: Span


@dataclass(frozen=True, slots=True)
class TimingFault:
    """`late N by d;`, `skip N [at most k];`, `overrun N by d;` of a test."""

    kind: str
    component: Path
    by: Expr | None
    at_most: Expr | None
    span: Span


@dataclass(frozen=True, slots=True)
class SystemFault:
    """One item of `faults { ... }`: `nan M.Fast at 4 per 1h for 1s;`, `order any;`.

    `target` is None for an order; `by`: what a fault is given, several for a measured lateness.
    """

    kind: str
    target: Path | None
    by: tuple[Expr, ...]
    rate: Expr | None
    per: Expr | None
    lasts: Expr | None
    span: Span


@dataclass(frozen=True, slots=True)
class Measure:
    """`measure name = e in [low, high] / bins every d;`: what campaigns tell of a run."""

    name: Name
    value: Expr
    interval: Interval
    bins: Expr
    every: Expr
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class SystemDecl(Decl):
    """`system Name [default] [deploys Other] {...}`."""

    default: bool
    instances: tuple[Instance | Repeated, ...]
    until: Expr | None
    properties: tuple[Property | Repeated, ...]
    forces: tuple[Force | Repeated, ...]
    replaces: tuple[Replace | Repeated, ...]
    sets: tuple[SetParam | Repeated, ...]
    inputs: tuple[DriveInput | Repeated, ...]
    faults: tuple[SystemFault, ...] = ()
    measures: tuple[Measure, ...] = ()
    inlines: tuple[Inline | Repeated, ...] = ()
    externals: tuple[ExternalTopic, ...] = ()
    deploys: Ref | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TestDecl(Decl):
    """`test Name {...}`: read by `soter test`."""

    system: Ref | None
    replaces: tuple[Replace | Repeated, ...]
    skew: Expr | None
    horizon: Expr | None
    properties: tuple[Property | Repeated, ...]
    quantum: Expr | None = None
    faults: tuple[TimingFault | Repeated, ...] = ()
    inputs: tuple[DriveInput | Repeated, ...] = ()
    sets: tuple[SetParam | Repeated, ...] = ()
    order: Span | None = None
    """Where it says `order deployed;`."""


@dataclass(frozen=True, slots=True)
class File:
    """One parsed file; `edition` is None when the first line is missing (already reported).

    `broken` holds the names of declarations (and imports) that were dropped or lost a part to
    a syntax error: later passes say nothing about such a name being unknown or incomplete.
    """

    edition: int | None
    imports: tuple[ImportDecl, ...]
    declarations: tuple[Decl, ...]
    span: Span
    broken: frozenset[str] = frozenset()

"""Core: what a checked system is lowered to, and the one thing every back end reads.

Purpose: about twenty kinds of node; typed, structured, single-exit, strict order of evaluation,
with source spans. C over doubles, C over intervals, footprints, costs and stack bounds all
come from here.
Non-goals: names of C things (`codegen/`), storage (`layout.py`).

What Core guarantees:
- expressions are pure and cannot fault: whatever may fault is a statement of its own, in the
  order of strict left-to-right evaluation;
- faults are sticky: the first one is remembered, execution goes on with harmless values to
  the single exit, and nothing is committed there;
- every loop has a constant bound; every function one exit: its `result`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from soter.language.syntax.node import Node, Shown, node

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Span
    from soter.language.evaluate.arithmetic import FaultKind
    from soter.language.model.system import Bound
    from soter.language.model.types import Type, Value


# ---------------------------------------------------------------- state cells


CellKind = Literal["topic", "local", "state"]


@node()
class Cell(Node):
    """A piece of the state. `kind`: "topic", "local" (of a node) or "state" (of a plant)."""

    kind: CellKind
    owner: int
    """Index of the topic or component."""
    name: str


# ---------------------------------------------------------------- expressions


@node()
class Expr(Node):
    """A pure expression."""

    type: Type


@node()
class Const(Expr):
    """A constant; `name` is the name of the constant in the source."""

    value: Value
    name: str | None = None


@node()
class Var(Expr):
    """The value of a temporary of the function, by its unique name."""

    name: str


@node()
class Get(Expr):
    """The content of a state cell."""

    cell: Cell


@node()
class Fact(Expr):
    """A fact of the run: "time" (s), "in_control", "mode" of a module, or "age" (s) of a topic.

    "published" is a fact of the step: it published an output. `index`: module, topic or output.
    """

    fact: str
    index: int = 0


@node()
class Unary(Expr):
    """An operation on one value: neg, sqrt, floor, abs (floats), not (bool), to_float (int)."""

    op: str
    operand: Expr


@node()
class Binary(Expr):
    """An operation on two values: + - * / (floats; / is guarded before), comparisons, && or ||."""

    op: str
    left: Expr
    right: Expr


@node()
class Extreme(Expr):
    """The smaller or larger value; `op` is "min" (b < a ? b : a) or "max" (b > a ? b : a)."""

    op: str
    left: Expr
    right: Expr


@node()
class Select(Expr):
    """The value `condition ? then : otherwise`; all three are pure."""

    condition: Expr
    then: Expr
    otherwise: Expr


@node()
class Field(Expr):
    """The field number `index` of a record."""

    target: Expr
    index: int


@node()
class Element(Expr):
    """An element of an array or list; the index is surely inside."""

    target: Expr
    index: Expr


@node()
class Length(Expr):
    """The length of a bounded list."""

    target: Expr


@node()
class Make(Expr):
    """A record, array or list; `elements` are in declared order."""

    elements: tuple[Expr, ...]


# ---------------------------------------------------------------- statements


@node()
class Stmt(Node):
    """A statement."""

    span: Span


@node()
class Let(Stmt):
    """Defines a new temporary; a `Set` may change it later if it is `mutable`."""

    name: str
    value: Expr
    mutable: bool = False


@node()
class Checked(Stmt):
    """Defines a temporary by an operation that may fault; after a fault the value is harmless.

    int: add sub mul neg abs div mod; to_int (float -> int); narrow (into `type`); index (a safe
    index below `limit`, which is an expression for lists). float: number (an operand that `ttf` or
    `safer` compares; a NaN faults).
    """

    name: str
    type: Type
    op: str
    operands: tuple[Expr, ...]
    limit: Expr | None = None


@node()
class Choose(Stmt):
    """Defines a temporary with value number `low + k`, for some k < `count` that is chosen.

    `ages`: for a fair choice, the temporary of its hidden local, which it updates; else None.
    """

    name: str
    type: Type
    count: int
    low: int
    ages: str | None = None


@node()
class Guard(Stmt):
    """Raises a fault of kind `kind` if the condition does not hold."""

    condition: Expr
    kind: FaultKind


@node()
class Call(Stmt):
    """Defines a temporary with the result of a function; a fault in it is a fault of the caller."""

    name: str
    function: str
    arguments: tuple[Expr, ...]
    type: Type


@node()
class Set(Stmt):
    """Assigns to a mutable temporary, or to its part at `path`, of fields and safe indices."""

    name: str
    type: Type
    path: tuple[int | Expr, ...]
    value: Expr


@node()
class Push(Stmt):
    """Appends to a bounded list, which is a mutable temporary or its part; faults if it is full."""

    name: str
    type: Type
    path: tuple[int | Expr, ...]
    value: Expr


@node()
class If(Stmt):
    """A branch with two sides; both continue after it."""

    condition: Expr
    then: tuple[Stmt, ...]
    otherwise: tuple[Stmt, ...]


@node()
class Loop(Stmt):
    """A loop over `variable` = low, ..., high - 1."""

    variable: str
    low: int
    high: int
    body: tuple[Stmt, ...]


@node()
class Publish(Stmt):
    """Remembers a publication on output number `output` of the step.

    With a `limit`, the value goes behind earlier values; a fault if there are `limit` already.
    """

    output: int
    value: Expr
    limit: int | None = None


# ---------------------------------------------------------------- functions, steps, systems


@node()
class Parameter(Node):
    """A parameter of a Core function."""

    name: str
    type: Type


@dataclass(eq=False, repr=False, kw_only=True)
class Function(Shown):
    """A pure function; `result` is evaluated at its single exit. `source`: an extern's binding.

    `leave`: name of the flag that the function has returned, or None; while it is set, statements
    have no effect. `meaning`: a name that functions share if they differ only in the operands that
    they check for NaN; such functions have the same value if they do not fault.
    """

    name: str
    source_name: str
    parameters: tuple[Parameter, ...]
    result_type: Type
    body: tuple[Stmt, ...]
    result: Expr | None
    span: Span
    source: str | None = None
    can_fault: bool = False
    leave: str | None = None
    meaning: str = ""


@dataclass(eq=False, repr=False)
class LocalCopy(Shown):
    """A state cell that a step uses as a temporary; it is loaded first and stored at the exit."""

    cell: Cell
    name: str
    type: Type
    written: bool


@dataclass(eq=False, repr=False)
class Output(Shown):
    """One output of a step: the topic and the bounds of each leaf (None: any finite value).

    `type` is the type of the topic, or for a `burst`, which may have several messages, of a list of
    them.
    """

    topic: int
    type: Type
    bounds: tuple[Bound | None, ...]
    burst: bool = False


@dataclass(eq=False, repr=False)
class Footprint(Shown):
    """The cells, modes and stamps that a step may touch; the explorer's reduction rests on it."""

    reads: set[Cell] = field(default_factory=set)
    writes: set[Cell] = field(default_factory=set)
    modes: set[int] = field(default_factory=set)
    stamps: set[int] = field(default_factory=set)


def output_name(output: int) -> str:
    """Gives the name of the temporary that holds the value a step publishes on an output."""
    return f"$out {output}"


@dataclass(eq=False, repr=False)
class ShieldStep(Shown):
    """The code after the body; its temporary `name` gets the next value of the topic `cell`.

    The statements for that fault if AC's commands are not permitted. `proposed`: the cell,
    temporary and type of the topic of proposals; with it, statements also move AC's commands.
    """

    body: tuple[Stmt, ...]
    cell: Cell
    name: str
    type: Type
    proposed: tuple[Cell, str, Type] | None = None


@dataclass(eq=False, repr=False)
class NodeStep(Shown):
    """The step of a node: takeover block, body, publications."""

    component: int
    locals: tuple[LocalCopy, ...]
    takeover: tuple[Stmt, ...]
    body: tuple[Stmt, ...]
    outputs: tuple[Output, ...]
    footprint: Footprint
    span: Span
    shield: ShieldStep | None = None


@dataclass(eq=False, repr=False)
class Draw(Shown):
    """The random draw of one leaf: its stream, its bounds, and how long a value holds."""

    stream: str
    low: float
    high: float
    hold_ns: int


@dataclass(eq=False, repr=False, kw_only=True)
class PlantStep(Shown):
    """A release of a plant: it chooses, integrates (not at its first release), then publishes.

    `choose`: statements with the lets that choose, on the states that the step begins with.
    `disturbances`: temporaries, each built from its draws in leaf order. `derivative` is a
    function (states..., disturbances..., ) -> record of the `der` states, None without any.
    `next`: statements computing one temporary per `next` state from the old states.
    `publish`: statements and values for the driven topics, on the new states.
    """

    component: int
    states: tuple[LocalCopy, ...]
    disturbances: tuple[tuple[str, Type, tuple[Draw, ...]], ...]
    choose: tuple[Stmt, ...]
    integrate: tuple[Stmt, ...]
    publish: tuple[Stmt, ...]
    outputs: tuple[Output, ...]
    noise: tuple[tuple[int, int, Draw], ...]
    """(output, leaf, draw): measurement errors."""
    footprint: Footprint
    span: Span
    extern: bool = False


@dataclass(eq=False, repr=False)
class Predicate(Shown):
    """A boolean over the state: first `body` runs, then `value` is evaluated.

    `maybe_nan`: some comparisons check their operands for NaN, and a NaN is then a fault.
    """

    body: tuple[Stmt, ...]
    value: Expr
    footprint: Footprint
    span: Span
    maybe_nan: bool = False


@dataclass(eq=False, repr=False)
class Decision(Shown):
    """The predicates of a module's DM."""

    module: int
    ttf: Predicate
    safer: Predicate
    goods: tuple[Predicate, ...] = ()
    """With several plans of SC, in place of both: for each plan whether the estimate is good."""


@dataclass(eq=False, repr=False)
class Timed(Shown):
    """A timed property of a test; the condition of an invariant is its module's `safe`."""

    premise: Predicate | None
    condition: Predicate


@dataclass(eq=False, repr=False)
class CoreSystem(Shown):
    """The code of one system: all its functions, steps and predicates."""

    functions: tuple[Function, ...]
    nodes: dict[int, NodeStep]
    plants: dict[int, PlantStep]
    decisions: tuple[Decision, ...]
    properties: tuple[Predicate, ...]
    timed: tuple[Timed, ...] = ()
    """The timed properties of a system that was flattened for a test, as in `TestPlan.timed`."""
    premises: tuple[Predicate | None, ...] = ()
    """For such a system, by property: the premise of an implication, None of any other."""
    measures: tuple[Predicate, ...] = ()
    """One for each of `System.measures`, whose value is a float, no truth value."""

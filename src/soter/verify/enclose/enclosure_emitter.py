"""The intermediate form of an enclosure: its operations and values, and their C statements.

Purpose: an `Emitter` collects operations in single-assignment form, with nested blocks for
undecided branches; `without_unread` drops those whose results nothing reads; `c_statements_of`
turns the rest into C. Records, arrays and lists are split into scalars, each of them known now or
held by a variable of the emitted C.
Non-goals: which operations (`core_enclosure.py`), what they do (`verify/engine/soter_form.h`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from fractions import Fraction
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_types import int_number
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    default_value,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.types import Type
    from soter.language.model.types import Value as Plain


FAULT = c.Unary("&", c.Name("fault"))
SIZE = c.Name("n")
"""The C variable that counts the symbols of the inputs that are read."""
MAX_OPERATIONS = 60_000
"""The most operations of one emitted function, with loops and calls written out."""


class EnclosureError(Exception):
    """Raised if a module cannot be enclosed; the text says the reason in words."""


@dataclass(eq=False)
class Op:
    """A call of a C function; `kind` is "form", "ints" or "truth", or "" without a result."""

    kind: str
    result: str
    function: str
    arguments: tuple[c.CExpr, ...]
    kept: bool = False
    """Whether the call is needed even if nothing reads its result, as it may fault."""


@dataclass(eq=False)
class MergedVariable:
    """A variable that both blocks of a branch set."""

    kind: str
    result: str


@dataclass(eq=False)
class MergeStore:
    """The store into a merged variable at the end of a block."""

    target: MergedVariable
    value: c.CExpr
    second: bool
    """Whether this is the otherwise-block, which joins its value to that of the then-block."""


@dataclass(eq=False)
class EmittedBranch:
    """A branch on a condition; a block runs if its side may be taken, so both may run."""

    condition: c.CExpr
    merged: list[MergedVariable]
    then: list[Step]
    otherwise: list[Step]


Step = Op | MergeStore | EmittedBranch


@dataclass
class Emitter:
    """Collects the operations of one emitted function."""

    statics: dict[tuple[str, str], c.VariableDef] = field(default_factory=dict)
    """The constant forms and tables of the whole unit, by type and content."""
    reads: dict[int, c.Name] = field(default_factory=dict)
    """The variable that holds the form of each input that is read."""
    block: list[Step] = field(default_factory=list)
    """The block to which operations are added now."""
    operations: int = 0
    reads_turns: bool = False
    """Whether any operation depends on how many full turns a state has made."""
    _next: int = 0

    def new_variable_name(self, kind: str) -> str:
        """A name for a new variable of this kind, not used before."""
        self._next += 1
        return f"{kind[0]}{self._next}"

    def emit(self, kind: str, function: str, *arguments: c.CExpr, kept: bool = False) -> c.Name:
        """Adds an operation and gives its result's variable; `EnclosureError` if too many."""
        self.operations += 1
        if self.operations > MAX_OPERATIONS:
            msg = f"more than {MAX_OPERATIONS} operations when loops and calls are written out"
            raise EnclosureError(msg)
        result = self.new_variable_name(kind) if kind else ""
        self.block.append(Op(kind, result, function, arguments, kept))
        return c.Name(result)

    def input_variable(self, number: int) -> c.Name:
        """The variable that holds the form of input `number`; notes that the input is read."""
        return self.reads.setdefault(number, c.Name(f"x{number}"))

    def static_name(self, type_: str, stem: str, value: c.Initializer, *, array: bool) -> c.Name:
        """The name of a constant C object with this value; adds the object if it is new."""
        key = (type_ + "[]" * array, repr(value))
        if key not in self.statics:
            name = f"soter_{stem}_{len(self.statics)}"
            self.statics[key] = c.VariableDef(type_, name, value, array)
        return c.Name(self.statics[key].name)

    def name_of_constant(self, type_: str, value: c.Initializer) -> str:
        """The name of the constant C object with this value; "" if none exists."""
        found = self.statics.get((type_, repr(value)))
        return "" if found is None else found.name


def float_literal(x: float) -> c.CExpr:
    """The C literal whose value is exactly this double."""
    if math.isnan(x):
        return c.Cast("double", c.Name("NAN"))
    if math.isinf(x):
        inf = c.Cast("double", c.Name("INFINITY"))
        return inf if x > 0 else c.Unary("-", inf)
    return c.Number(x.hex())


def address(place: c.CExpr) -> c.CExpr:
    """The C expression `&place`."""
    return c.Unary("&", place)


def int_literal(value: int) -> c.CExpr:
    """The C literal of an int64_t with this value."""
    return int_number(value)


def names_in(e: object) -> Iterator[str]:
    """The names that occur in an expression or statement of C, or in a tuple of these."""
    if isinstance(e, c.Name):
        yield e.text
    elif isinstance(e, tuple):
        for x in e:
            yield from names_in(x)
    elif isinstance(e, (c.CExpr, c.CStmt)):
        for f in fields(e):
            yield from names_in(getattr(e, f.name))


def without_unread(block: list[Step], live: set[str], *, faults: bool = True) -> list[Step]:
    """The block without the operations whose results nothing reads.

    `live`: the variables read after the block; the function adds those read in it. `faults`: keep
    all operations that may fault.
    """
    steps: list[Step] = []
    for s in reversed(block):
        if isinstance(s, Op):
            if (s.kept and faults) or s.result in live:
                live.update(names_in(s.arguments))
                steps.append(s)
        elif isinstance(s, MergeStore):
            if s.target.result in live:
                live.update(names_in(s.value))
                steps.append(s)
        else:
            merged = [m for m in s.merged if m.result in live]
            then = without_unread(s.then, live, faults=faults)
            otherwise = without_unread(s.otherwise, live, faults=faults)
            if then or otherwise:
                live.update(names_in(s.condition))
                steps.append(EmittedBranch(s.condition, merged, then, otherwise))
    steps.reverse()
    return steps


def c_statements_of(block: list[Step]) -> list[c.CStmt]:
    """The C statements for a block that has no unread operations any more."""
    c_statements: list[c.CStmt] = []
    for s in block:
        if isinstance(s, Op):
            c_statements += _call_statements(s)
        elif isinstance(s, EmittedBranch):
            c_statements += _branch_statements(s)
    return c_statements


def _call_statements(s: Op) -> list[c.CStmt]:
    if s.kind == "form":
        call = c.CallExpr(s.function, (SIZE, address(c.Name(s.result)), *s.arguments))
        return [c.Declare("soter_form", s.result, None), c.Do(call)]
    call = c.CallExpr(s.function, s.arguments)
    if not s.kind:
        return [c.Do(call)]
    used = c.Declare(f"soter_{s.kind}", s.result, call, const=True)
    return [used, c.Unused(s.result)] if s.kept else [used]


def _branch_statements(s: EmittedBranch) -> list[c.CStmt]:
    c_statements: list[c.CStmt] = []
    for m in s.merged:
        c_statements += _declaration_of_merged(m)
    for block, bit in ((s.then, "2U"), (s.otherwise, "1U")):
        inner = c_statements_of(block)
        inner += [_store_statement(x, s.condition) for x in block if isinstance(x, MergeStore)]
        if inner:
            taken = c.Binary("!=", c.Binary("&", s.condition, c.Number(bit)), c.Number("0U"))
            c_statements.append(c.IfStmt(taken, tuple(inner)))
    return c_statements


def _store_statement(s: MergeStore, condition: c.CExpr) -> c.CStmt:
    target = c.Name(s.target.result)
    if not s.second:
        if s.target.kind == "form":
            arguments = (SIZE, address(target), address(s.value))
            return c.Do(c.CallExpr("soter_n_copy", arguments))
        return c.Assign(target, s.value)
    if s.target.kind == "form":
        merge = (SIZE, address(target), condition, address(s.value))
        return c.Do(c.CallExpr("soter_n_merge", merge))
    return c.Do(c.CallExpr(f"soter_{s.target.kind}_merge", (address(target), condition, s.value)))


def _declaration_of_merged(m: MergedVariable) -> list[c.CStmt]:
    """The declaration of a merged variable, with an arbitrary first value."""
    zero = c.Number("0.0")
    if m.kind == "form":
        first = c.CallExpr("soter_n_range", (SIZE, address(c.Name(m.result)), zero, zero))
        return [c.Declare("soter_form", m.result, None), c.Do(first)]
    none = c.Initializer(((None, c.Number("0")),)) if m.kind == "ints" else c.Number("0U")
    return [c.Declare(f"soter_{m.kind}", m.result, none)]


def function_body(
    block: list[Step], reads: dict[int, c.Name], results: list[c.CStmt], *, faults: bool = True
) -> tuple[c.CStmt, ...]:
    """The body of a C function: it reads inputs, each with its symbol, and gives results.

    Without `faults` it reports faults only of operations on which the results depend.
    """
    live = {n for s in results for n in names_in(s)}
    inner = c_statements_of(without_unread(block, live, faults=faults))
    taken = {k: name for k, name in sorted(reads.items()) if name.text in live}
    numbers = c.Initializer(tuple((None, c.Number(str(k))) for k in taken))
    arguments = (c.Name("in"), c.Name("read"), c.Number(str(len(taken))), c.Name("symbols"))
    prologue: list[c.CStmt] = [c.Declare("unsigned", "fault", c.Number("0U"))]
    prologue.append(c.Declare("int", "symbols[SOTER_INPUTS]", None))
    prologue.append(c.Declare("int", f"read[{max(1, len(taken))}]", numbers, const=True))
    prologue.append(c.Declare("int", SIZE.text, c.CallExpr("soter_symbols", arguments), const=True))
    for k, name in taken.items():
        argument = address(c.IndexExpr(c.Name("in"), c.Number(str(k))))
        take = c.CallExpr("soter_n_take", (SIZE, address(name), argument, c.Name("symbols")))
        prologue += [c.Declare("soter_form", name.text, None), c.Do(take)]
    unused = [c.Unused(n) for n in (SIZE.text, "in", "param", "out")]
    return (*prologue, *inner, *results, *unused, c.Return(c.Name("fault")))


def result_statement(place: int, form: c.CExpr) -> c.CStmt:
    """The C statement that writes a resulting form to `out[place]`."""
    target = address(c.IndexExpr(c.Name("out"), c.Number(str(place))))
    return c.Do(c.CallExpr("soter_n_give", (SIZE, target, form, c.Name("symbols"))))


LARGEST = math.nextafter(math.inf, 0.0)


@dataclass(frozen=True)
class Form:
    """A float held by a `soter_form` of the emitted C."""

    place: c.CExpr
    turns: int = 0
    """The number of states in it that are read modulo a full turn, and may be turns away."""
    sums: int = 0
    """The number of sums that made it: each rounds by more if a state is many turns away."""


@dataclass(frozen=True)
class FloatRange:
    """A float known to lie in [low, high]; both ends are finite, and equal for a known float."""

    low: float
    high: float


@dataclass(frozen=True)
class EmittedInts:
    """An int or enum held by a `soter_ints` of the emitted C."""

    place: c.CExpr


@dataclass(frozen=True)
class KnownInt:
    """An int or enum whose value is known now."""

    value: int


@dataclass(frozen=True)
class EmittedTruth:
    """A bool held by a `soter_truth` of the emitted C."""

    place: c.CExpr


@dataclass(frozen=True)
class KnownTruth:
    """A bool known now as True or False, or None where it may be either."""

    value: bool | None


@dataclass(frozen=True)
class AggregateParts:
    """A record's fields or an array's elements."""

    items: tuple[Item, ...]


@dataclass(frozen=True)
class Sequence:
    """A bounded list: its length, and as many items as its capacity."""

    length: EmittedInts | KnownInt
    items: tuple[Item, ...]


@dataclass(frozen=True)
class Constant:
    """A constant that is kept in one piece, because tables are large."""

    type: Type
    value: Plain


Scalar = Form | FloatRange | EmittedInts | KnownInt | EmittedTruth | KnownTruth
Item = Scalar | AggregateParts | Sequence | Constant


def element_types(t: Type) -> tuple[Type, ...]:
    """The types of a record's fields, or of an array's or list's elements."""
    if isinstance(t, RecordType):
        return tuple(f for _, f in t.fields)
    if isinstance(t, ArrayType):
        return (t.element,) * t.size
    assert isinstance(t, ListType)
    return (t.element,) * t.capacity


def is_scalar(t: Type) -> bool:
    """Whether values of the type are a single leaf."""
    return isinstance(t, (BoolType, EnumType, FloatType, IntType))


def as_parts(v: Constant) -> Item:
    """A constant split into its direct parts; an infinite or NaN float stays a `Constant`."""
    t, value = v.type, v.value
    if isinstance(t, FloatType):
        x = float(value)
        return FloatRange(x, x) if math.isfinite(x) else v
    if isinstance(t, BoolType):
        return KnownTruth(bool(value))
    if isinstance(t, (IntType, EnumType)):
        return KnownInt(int(value))
    if isinstance(t, ListType):
        rest = (default_value(t.element),) * (t.capacity - len(value))
        items = tuple(Constant(t.element, x) for x in (*value, *rest))
        return Sequence(KnownInt(len(value)), items)
    parts = zip(element_types(t), value, strict=True)
    return AggregateParts(tuple(Constant(f, x) for f, x in parts))


def rounded_down(x: Fraction) -> float:
    """The largest double that is at most `x`; -inf if `x` is below all doubles."""
    if x < -Fraction(LARGEST):
        return -math.inf
    if x >= Fraction(LARGEST):
        return LARGEST
    near = float(x)
    return near if Fraction(near) <= x else math.nextafter(near, -math.inf)


def range_around(values: tuple[Fraction, ...]) -> FloatRange | None:
    """The smallest range of doubles around exact values; it also holds their rounded values.

    Returns None if a value may round to infinity.
    """
    low, high = rounded_down(min(values)), -rounded_down(-max(values))
    return FloatRange(low, high) if math.isfinite(low) and math.isfinite(high) else None


def range_of_binary(op: str, a: FloatRange, b: FloatRange) -> FloatRange | None:
    """The range of `a op b` in exact arithmetic; None if the C code must compute it."""
    left, right = (Fraction(a.low), Fraction(a.high)), (Fraction(b.low), Fraction(b.high))
    if op == "+":
        return range_around((left[0] + right[0], left[1] + right[1]))
    if op == "-":
        return range_around((left[0] - right[1], left[1] - right[0]))
    if op == "*":
        return range_around(tuple(x * y for x in left for y in right))
    if right[0] <= 0 <= right[1]:
        return None
    return range_around(tuple(x / y for x in left for y in right))


def range_of_unary(op: str, a: FloatRange) -> FloatRange | None:
    """The range of neg, abs, floor or sqrt of a range; None if the C code must compute it."""
    if op == "neg":
        return FloatRange(-a.high, -a.low)
    if op == "abs":
        ends = (abs(a.low), abs(a.high))
        return FloatRange(0.0 if a.low <= 0.0 <= a.high else min(ends), max(ends))
    if op == "floor":
        return FloatRange(float(math.floor(a.low)), float(math.floor(a.high)))
    if op == "sqrt" and a.low >= 0.0:
        low, high = math.sqrt(a.low), math.sqrt(a.high)
        exact = low == high and Fraction(low) ** 2 == Fraction(a.low)
        if exact:
            return FloatRange(low, high)
        return FloatRange(max(0.0, math.nextafter(low, -1.0)), math.nextafter(high, math.inf))
    return None


def comparison_of_ranges(op: str, a: tuple[float, float], b: tuple[float, float]) -> bool | None:
    """The truth of `a op b` for numbers from two closed ranges; None if it may be true or false."""
    if op in {">", ">="}:
        return comparison_of_ranges("<" if op == ">" else "<=", b, a)
    if op == "!=":
        equal = comparison_of_ranges("==", a, b)
        return None if equal is None else not equal
    if op == "==":
        if a[0] == a[1] == b[0] == b[1]:
            return True
        return None if a[0] <= b[1] and b[0] <= a[1] else False
    if op == "<":
        may_hold, may_fail = a[0] < b[1], a[1] >= b[0]
    else:
        may_hold, may_fail = a[0] <= b[1], a[1] > b[0]
    return None if may_hold and may_fail else may_hold

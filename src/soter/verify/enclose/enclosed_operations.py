"""Operations on the values of an enclosure: computed now where values are known, else emitted as C.

Purpose: `EnclosureOperations` has a method for each kind of scalar operation, and methods that
select and join whole values.
Non-goals: Core (`core_enclosure.py`), rounding at run time (`verify/engine/soter_form.h`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.language.evaluate import arithmetic
from soter.language.model.types import (
    INT_MAX,
    INT_MIN,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    default_value,
)
from soter.verify.enclose.enclosure_emitter import (
    FAULT,
    SIZE,
    AggregateParts,
    Constant,
    EmittedInts,
    EmittedTruth,
    FloatRange,
    Form,
    KnownInt,
    KnownTruth,
    MergedVariable,
    MergeStore,
    Sequence,
    address,
    compared,
    element_types,
    float_literal,
    is_scalar,
    opened,
    span_binary,
    span_unary,
    whole_literal,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.types import Type
    from soter.verify.enclose.enclosure_emitter import Emitter, Item, Step

BINARY = {"+": "add", "-": "sub", "*": "mul", "/": "div"}
SWAPPED = {">": "<", ">=": "<="}
FORM_COMPARE = {"<": "soter_n_less", "<=": "soter_n_no_more"}
INTS_COMPARE = {"<": "soter_ints_less", "<=": "soter_ints_at_most", "==": "soter_ints_equal"}
INT_OPS: dict[str, Callable[..., int]] = {
    "add": arithmetic.add_int,
    "sub": arithmetic.sub_int,
    "mul": arithmetic.mul_int,
    "div": arithmetic.div_int,
    "mod": arithmetic.mod_int,
    "neg": arithmetic.neg_int,
    "abs": arithmetic.abs_int,
}
UNKNOWN = KnownTruth(None)
TURN = 2.0 * math.pi
FARTHEST = 2.0**14
"""The largest angle, 2,607 turns: an estimate beyond is in no table."""
FAR_TURNS = 2.0**-33
"""As `SOTER_FAR_TURNS`; bringing an estimate back by whole turns also rounds by less."""
TURNS_MAX, SUMS_MAX = 4, 8
"""The most states any turns off, and the most sums, in an argument of `soter_n_any_turn`."""


class EnclosureOperations:
    """Emits operations on values."""

    def __init__(self, emitter: Emitter) -> None:
        self.emitter = emitter

    def form(self, v: Item) -> c.CExpr:
        """A float as an operand of type `const soter_form *`."""
        if isinstance(v, Form):
            self.emitter.reads_turns |= v.turns > 0
            return address(v.place)
        if isinstance(v, FloatRange):
            return address(self._static_form(v.low, v.high))
        assert isinstance(v, Constant)  # infinite or NaN
        x = float(v.value)
        low, high = (-math.inf, math.inf) if math.isnan(x) else (x, x)
        return address(self._static_form(low, high))

    def _static_form(self, low: float, high: float) -> c.Name:
        value = _form_between(low, high)
        return self.emitter.static("soter_form", "constant", value, array=False)

    @property
    def anything(self) -> str:
        """The variable for a number of which nothing is known; "" where none was emitted."""
        return self.emitter.known("soter_form", _form_between(-math.inf, math.inf))

    def is_anything(self, v: Item) -> bool:
        """Whether nothing at all is known of a number."""
        return isinstance(v, Form) and isinstance(v.place, c.Name) and v.place.text == self.anything

    def ints(self, v: Item) -> c.CExpr:
        """An int as an operand of type `soter_ints`."""
        if isinstance(v, EmittedInts):
            return v.place
        assert isinstance(v, KnownInt)
        n = whole_literal(v.value)
        return c.CallExpr("soter_ints_of", (n, n))

    def truth(self, v: Item) -> c.CExpr:
        """A bool as an operand of type `soter_truth`."""
        if isinstance(v, EmittedTruth):
            return v.place
        assert isinstance(v, KnownTruth)
        return c.Number("3U" if v.value is None else "2U" if v.value else "1U")

    def any_value(self, t: Type) -> Item:
        """An enclosure of any value of a type."""
        if isinstance(t, FloatType):
            return Form(self._static_form(-math.inf, math.inf))
        if isinstance(t, BoolType):
            return UNKNOWN
        if isinstance(t, IntType):
            return self.whole_range(t.low, t.high)
        if isinstance(t, EnumType):
            return self.whole_range(0, len(t.members) - 1)
        items = tuple(self.any_value(f) for f in element_types(t))
        if isinstance(t, ListType):
            return Sequence(self.whole_range(0, t.capacity), items)
        return AggregateParts(items)

    def whole_range(self, low: int, high: int) -> EmittedInts | KnownInt:
        """Any int of a range."""
        if low == high:
            return KnownInt(low)
        ends = (whole_literal(low), whole_literal(high))
        return EmittedInts(self.emitter.emit("ints", "soter_ints_of", *ends))

    def float_range(self, low: float, high: float) -> Form | FloatRange:
        """Any float of a range; an infinite end: no bound there; both infinite: also NaN."""
        if math.isfinite(low) and math.isfinite(high):
            return FloatRange(low, high)
        return Form(self._static_form(low, high))

    def _form(self, function: str, *arguments: c.CExpr) -> Form:
        return Form(self.emitter.emit("form", function, *arguments))

    def unary(self, op: str, v: Item) -> Item:
        """The operations neg, abs, floor and sqrt of a float."""
        if op == "neg" and isinstance(v, Form) and v.turns:
            return self._turned(self.unary(op, Form(v.place)), v.turns, v.sums)
        if isinstance(v, FloatRange):
            known = span_unary(op, v)
            if known is not None:
                return known
        return self._form(f"soter_n_{op}", self.form(v))

    def binary(self, op: str, a: Item, b: Item) -> Item:
        """The operations `+`, `-`, `*` and `/` of floats."""
        if op in "+-" and (turned := self._sum_of_turns(op, a, b)) is not None:
            return turned
        if isinstance(a, FloatRange) and isinstance(b, FloatRange):
            known = span_binary(op, a, b)
            if known is not None:
                return known
        if isinstance(a, FloatRange) and op in "+*":
            a, b = b, a
        if isinstance(b, FloatRange):
            if op == "-":
                op, b = "+", FloatRange(-b.high, -b.low)
            if op in {"*", "+"} or not b.low <= 0.0 <= b.high:
                return self._beside_range(op, a, b)
        if op == "*" and a == b:
            return self._form("soter_n_square", self.form(a))
        return self._form(f"soter_n_{BINARY[op]}", self.form(a), self.form(b))

    def _sum_of_turns(self, op: str, a: Item, b: Item) -> Form | None:
        """A sum or difference with angles that may be turns off; None: it has none, or too many."""
        turning = [x for x in (a, b) if isinstance(x, Form) and x.turns]
        turns, sums = sum(x.turns for x in turning), sum(x.sums for x in turning) + 1
        if not turning or turns > TURNS_MAX or sums > SUMS_MAX:
            return None
        plain = (Form(x.place) if isinstance(x, Form) else x for x in (a, b))
        return self._turned(self.binary(op, *plain), turns, sums)

    def _beside_range(self, op: str, a: Item, b: FloatRange) -> Form:
        """The operation `+`, `*` or `/` of a float and one that is known to lie in a range."""
        name = {"+": "shift", "*": "scale", "/": "over"}[op]
        ends = float_literal(b.low), float_literal(b.high)
        return self._form(f"soter_n_{name}", self.form(a), *ends)

    def extreme(self, op: str, a: Item, b: Item) -> Item:
        """The operations min and max, of floats or ints: b < a ? b : a."""
        if isinstance(a, (EmittedInts, KnownInt)):
            if isinstance(a, KnownInt) and isinstance(b, KnownInt):
                return KnownInt(min(a.value, b.value) if op == "min" else max(a.value, b.value))
            return EmittedInts(
                self.emitter.emit("ints", f"soter_ints_{op}", self.ints(a), self.ints(b))
            )
        if isinstance(a, FloatRange) and isinstance(b, FloatRange):
            pick = min if op == "min" else max
            return FloatRange(pick(a.low, b.low), pick(a.high, b.high))
        for k, x in ((b, a), (a, b)):
            if isinstance(k, FloatRange) and k.low == k.high:
                name = "soter_n_at_most" if op == "min" else "soter_n_at_least"
                return self._form(name, self.form(x), float_literal(k.low))
        return self._form(f"soter_n_{op}", self.form(a), self.form(b))

    @staticmethod
    def _turned(v: Item, turns: int, sums: int) -> Form:
        assert isinstance(v, Form)
        return replace(v, turns=turns, sums=sums)

    def any_turn(self, v: Form) -> c.CExpr:
        """The argument of a function of a full turn, with the error of being any turns off."""
        return address(self.emitter.emit("form", "soter_n_any_turn", address(v.place)))

    def negated(self, v: Item) -> Item:
        """The operation `!` of a bool."""
        if isinstance(v, KnownTruth):
            return KnownTruth(None if v.value is None else not v.value)
        return EmittedTruth(self.emitter.emit("truth", "soter_not", self.truth(v)))

    def both(self, a: Item, b: Item) -> Item:
        """The operation `&&` of two bools."""
        for x, y in ((a, b), (b, a)):
            if isinstance(x, KnownTruth) and x.value is not None:
                return y if x.value else x
        return EmittedTruth(self.emitter.emit("truth", "soter_both", self.truth(a), self.truth(b)))

    def either(self, a: Item, b: Item) -> Item:
        """The operation `||` of two bools."""
        return self.negated(self.both(self.negated(a), self.negated(b)))

    def compare(self, op: str, a: Item, b: Item) -> Item:
        """A comparison of two floats, ints, enums or bools."""
        if op == "!=":
            return self.negated(self.compare("==", a, b))
        if op in SWAPPED:
            return self.compare(SWAPPED[op], b, a)
        if isinstance(a, (EmittedTruth, KnownTruth)):
            alike = self.both(a, b), self.both(self.negated(a), self.negated(b))
            return self.either(*alike)
        if isinstance(a, KnownInt) and isinstance(b, KnownInt):
            return KnownTruth({"<": a.value < b.value, "<=": a.value <= b.value}.get(op, a == b))
        if isinstance(a, (EmittedInts, KnownInt)):
            arguments = (self.ints(a), self.ints(b))
            return EmittedTruth(self.emitter.emit("truth", INTS_COMPARE[op], *arguments))
        if isinstance(a, FloatRange) and isinstance(b, FloatRange):
            return KnownTruth(compared(op, (a.low, a.high), (b.low, b.high)))
        operands = (self.form(a), self.form(b))
        if op == "==":
            return EmittedTruth(self.emitter.emit("truth", "soter_equal", *operands))
        return EmittedTruth(self.emitter.emit("truth", FORM_COMPARE[op], SIZE, *operands))

    def note_possible_fault(self) -> None:
        """Notes that a fault is possible here."""
        self.note_fault_unless(KnownTruth(False))

    def note_fault_unless(self, condition: Item) -> None:
        """Notes that a fault is possible unless the condition surely holds."""
        if condition != KnownTruth(True):
            self.emitter.emit("", "soter_possible", self.truth(condition), FAULT, kept=True)

    def int_operation(self, op: str, operands: tuple[Item, ...]) -> Item:
        """The operation add, sub, mul, neg, abs, div or mod of ints; notes its faults."""
        if all(isinstance(o, KnownInt) for o in operands):
            try:
                return KnownInt(
                    INT_OPS[op](*(o.value for o in operands if isinstance(o, KnownInt)))
                )
            except arithmetic.StepFault:
                self.note_possible_fault()
                return KnownInt(0)
        arguments = tuple(self.ints(o) for o in operands)
        name = self.emitter.emit("ints", f"soter_ints_{op}", *arguments, FAULT, kept=True)
        return EmittedInts(name)

    def narrowed(self, v: Item, low: int, high: int) -> Item:
        """An int that is assigned to a place with a range; notes a fault if it may lie outside."""
        if isinstance(v, KnownInt):
            if not low <= v.value <= high:
                self.note_possible_fault()
            return KnownInt(min(max(v.value, low), high))
        ends = (whole_literal(low), whole_literal(high))
        return EmittedInts(
            self.emitter.emit("ints", "soter_ints_narrow", self.ints(v), *ends, FAULT, kept=True)
        )

    def index(self, v: Item, limit: Item, capacity: int) -> Item:
        """An index cut to [0, limit); notes a fault if it may lie outside."""
        if isinstance(v, KnownInt) and isinstance(limit, KnownInt):
            if not 0 <= v.value < limit.value:
                self.note_possible_fault()
            return KnownInt(min(max(v.value, 0), max(capacity - 1, 0)))
        most = whole_literal(capacity)
        return EmittedInts(
            self.emitter.emit(
                "ints", "soter_ints_index", self.ints(v), self.ints(limit), most, FAULT, kept=True
            )
        )

    def to_int(self, v: Item) -> Item:
        """The operation `int(x)` of a float; notes its faults."""
        if isinstance(v, FloatRange) and v.low == v.high and INT_MIN <= int(v.low) <= INT_MAX:
            return KnownInt(int(v.low))
        return EmittedInts(
            self.emitter.emit("ints", "soter_ints_to_int", self.form(v), FAULT, kept=True)
        )

    def number(self, v: Item) -> Item:
        """A float that is compared, unchanged; notes a fault if it may be NaN."""
        if not isinstance(v, FloatRange):
            is_number = EmittedTruth(self.emitter.emit("truth", "soter_is_number", self.form(v)))
            self.note_fault_unless(is_number)
        return v

    def to_float(self, v: Item) -> Item:
        """The operation `float(i)` of an int, or of a bool as 0 or 1."""
        if isinstance(v, KnownInt) and abs(v.value) <= 2**53:
            return FloatRange(float(v.value), float(v.value))
        if isinstance(v, (EmittedTruth, KnownTruth)):
            return self._form("soter_n_truth_to_float", self.truth(v))
        return self._form("soter_n_to_float", self.ints(v))

    def select(self, condition: Item, then: Item, otherwise: Item) -> Item:
        """The operation `condition ? then : otherwise`."""
        if isinstance(condition, KnownTruth) and condition.value is not None:
            return then if condition.value else otherwise
        return self.mapped(then, otherwise, lambda a, b: self._select_scalar(condition, a, b))

    def _select_scalar(self, condition: Item, a: Item, b: Item) -> Item:
        t = self.truth(condition)
        kind = kind_of(a)
        if kind == "form":
            return self._form("soter_n_select", t, self.form(a), self.form(b))
        if kind == "ints":
            arguments = (t, self.ints(a), self.ints(b))
            return EmittedInts(self.emitter.emit("ints", "soter_ints_select", *arguments))
        arguments = (t, self.truth(a), self.truth(b))
        return EmittedTruth(self.emitter.emit("truth", "soter_truth_select", *arguments))

    def mapped(self, a: Item, b: Item, leaf: Callable[[Item, Item], Item]) -> Item:
        """A value made by `leaf` from each pair of leaves that differ; equal leaves stay."""
        if a is b or a == b:
            return a
        a = opened(a) if isinstance(a, Constant) else a
        b = opened(b) if isinstance(b, Constant) else b
        if a == b:
            return a
        if isinstance(a, AggregateParts):
            assert isinstance(b, AggregateParts)
            pairs = zip(a.items, b.items, strict=True)
            return AggregateParts(tuple(self.mapped(x, y, leaf) for x, y in pairs))
        if isinstance(a, Sequence):
            assert isinstance(b, Sequence)
            length = self.mapped(a.length, b.length, leaf)
            assert isinstance(length, (EmittedInts, KnownInt))
            pairs = zip(a.items, b.items, strict=True)
            return Sequence(length, tuple(self.mapped(x, y, leaf) for x, y in pairs))
        return leaf(a, b)

    def merged(
        self,
        a: Item,
        b: Item,
        variables: list[MergedVariable],
        then: list[Step],
        otherwise: list[Step],
    ) -> Item:
        """The value of a variable after a branch whose blocks left `a` and `b` in it."""

        def leaf(x: Item, y: Item) -> Item:
            kind = kind_of(x)
            variable = MergedVariable(kind, self.emitter.fresh(kind))
            variables.append(variable)
            then.append(MergeStore(variable, self._stored(kind, x), second=False))
            otherwise.append(MergeStore(variable, self._stored(kind, y), second=True))
            return emitted_value(kind, variable.result)

        return self.mapped(a, b, leaf)

    def value_after_block(
        self, v: Item, variables: list[MergedVariable], block: list[Step]
    ) -> Item:
        """A value that a block computed, for use after the block where it ran."""
        v = opened(v) if isinstance(v, Constant) else v
        if isinstance(v, AggregateParts):
            return AggregateParts(
                tuple(self.value_after_block(x, variables, block) for x in v.items)
            )
        if isinstance(v, Sequence):
            length = self.value_after_block(v.length, variables, block)
            assert isinstance(length, (EmittedInts, KnownInt))
            return Sequence(
                length, tuple(self.value_after_block(x, variables, block) for x in v.items)
            )
        if isinstance(v, (FloatRange, KnownInt, KnownTruth, Constant)):
            return v
        kind = kind_of(v)
        variable = MergedVariable(kind, self.emitter.fresh(kind))
        variables.append(variable)
        block.append(MergeStore(variable, self._stored(kind, v), second=False))
        return emitted_value(kind, variable.result)

    def _stored(self, kind: str, v: Item) -> c.CExpr:
        if kind == "form":
            e = self.form(v)
            assert isinstance(e, c.Unary)
            return e.operand
        return self.ints(v) if kind == "ints" else self.truth(v)

    def element(self, target: Item, at: Item, t: Type) -> Item:
        """The element of an array or list at an index that is inside."""
        if isinstance(at, KnownInt):
            whole = opened(target) if isinstance(target, Constant) else target
            assert isinstance(whole, (AggregateParts, Sequence))
            return whole.items[at.value]
        if isinstance(target, Constant):
            values = tuple(target.value)
            if isinstance(target.type, ListType):
                missing = target.type.capacity - len(values)
                values += (default_value(t),) * missing
            return self._element_of_table(t, values, at)
        assert isinstance(target, (AggregateParts, Sequence))
        return self._element_of_items(target.items, at)

    def _element_of_table(self, t: Type, values: tuple[object, ...], at: Item) -> Item:
        if not is_scalar(t):
            if isinstance(t, ListType):
                return self._element_of_items(tuple(Constant(t, v) for v in values), at)
            parts = element_types(t)
            columns = zip(*values, strict=True) if values else ()
            pairs = zip(parts, columns, strict=True)
            return AggregateParts(
                tuple(self._element_of_table(f, tuple(col), at) for f, col in pairs)
            )
        if isinstance(t, BoolType):
            return self._element_of_items(tuple(Constant(t, v) for v in values), at)
        if isinstance(t, FloatType):
            items = tuple((None, float_literal(float(v))) for v in values)  # type: ignore[arg-type]
            table = self.emitter.static("double", "table", c.Initializer(items), array=True)
            return self._form("soter_n_table", table, self.ints(at))
        items = tuple((None, whole_literal(int(v))) for v in values)  # type: ignore[call-overload]
        table = self.emitter.static("int64_t", "table", c.Initializer(items), array=True)
        return EmittedInts(self.emitter.emit("ints", "soter_ints_table", table, self.ints(at)))

    def _element_of_items(self, items: tuple[Item, ...], at: Item) -> Item:
        """The item at an index: a join of several where the index is undecided."""
        selection = items[-1]
        if len(items) == 1:
            return selection
        for k in range(len(items) - 2, -1, -1):
            below = self.compare("<=", at, KnownInt(k))
            selection = self.select(below, items[k], selection)
        return selection


def emitted_value(kind: str, name: str) -> Form | EmittedInts | EmittedTruth:
    """A variable of the emitted C as a value."""
    if kind == "form":
        return Form(c.Name(name))
    return EmittedInts(c.Name(name)) if kind == "ints" else EmittedTruth(c.Name(name))


def kind_of(v: Item) -> str:
    """The kind of C type of a scalar: `ints`, `truth` or `form`."""
    if isinstance(v, (EmittedInts, KnownInt)):
        return "ints"
    return "truth" if isinstance(v, (EmittedTruth, KnownTruth)) else "form"


def _form_between(low: float, high: float) -> c.Initializer:
    middle, beside = low, 0.0
    if not (math.isfinite(low) and math.isfinite(high)):
        middle, beside = 0.0, math.inf
    elif low != high:
        middle = 0.5 * low + 0.5 * high
        beside = math.nextafter(max(high - middle, middle - low), math.inf)
    zeros = c.Initializer(((None, c.Number("0.0")),))
    items = tuple((None, float_literal(x)) for x in (low, high, middle, beside))
    return c.Initializer((*items, (None, zeros)))

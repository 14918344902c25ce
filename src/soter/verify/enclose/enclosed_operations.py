"""Operations on enclosed values, computed now where values are known, otherwise emitted as C.

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
    as_parts,
    comparison_of_ranges,
    element_types,
    float_literal,
    int_literal,
    is_scalar,
    range_of_binary,
    range_of_unary,
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
"""The largest angle in rad, 2,607 turns: estimates beyond it are in no table."""
FAR_TURNS = 2.0**-33
"""The value of `SOTER_FAR_TURNS`; moving an estimate by whole turns rounds by less, too."""
TURNS_MAX, SUMS_MAX = 4, 8
"""The most states that turn, and the most sums, in an argument of `soter_n_any_turn`."""


class EnclosureOperations:
    """Operations on enclosures; their C code is added to an `Emitter`."""

    def __init__(self, emitter: Emitter) -> None:
        self.emitter = emitter

    def form_of(self, v: Item) -> c.CExpr:
        """The C operand of type `const soter_form *` for a float."""
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
        return self.emitter.static_name("soter_form", "constant", value, array=False)

    @property
    def any_number(self) -> str:
        """The name of the C variable for an unbounded number; "" if none was emitted."""
        return self.emitter.name_of_constant("soter_form", _form_between(-math.inf, math.inf))

    def is_any_number(self, v: Item) -> bool:
        """Whether the value is held by the C variable for an unbounded number."""
        return (
            isinstance(v, Form) and isinstance(v.place, c.Name) and v.place.text == self.any_number
        )

    def ints_of(self, v: Item) -> c.CExpr:
        """The C operand of type `soter_ints` that holds an int."""
        if isinstance(v, EmittedInts):
            return v.place
        assert isinstance(v, KnownInt)
        n = int_literal(v.value)
        return c.CallExpr("soter_ints_of", (n, n))

    def truth_of(self, v: Item) -> c.CExpr:
        """The C operand of type `soter_truth` that holds a bool."""
        if isinstance(v, EmittedTruth):
            return v.place
        assert isinstance(v, KnownTruth)
        return c.Number("3U" if v.value is None else "2U" if v.value else "1U")

    def any_value(self, t: Type) -> Item:
        """An enclosure of all values of a type."""
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
        """An enclosure of all ints from `low` to `high`."""
        if low == high:
            return KnownInt(low)
        ends = (int_literal(low), int_literal(high))
        return EmittedInts(self.emitter.emit("ints", "soter_ints_of", *ends))

    def float_range(self, low: float, high: float) -> Form | FloatRange:
        """An enclosure of all floats from `low` to `high`; if both are infinite, also of NaN."""
        if math.isfinite(low) and math.isfinite(high):
            return FloatRange(low, high)
        return Form(self._static_form(low, high))

    def _form_result(self, function: str, *arguments: c.CExpr) -> Form:
        return Form(self.emitter.emit("form", function, *arguments))

    def unary(self, op: str, v: Item) -> Item:
        """The result of neg, abs, floor or sqrt of a float."""
        if op == "neg" and isinstance(v, Form) and v.turns:
            return self._form_with_turns(self.unary(op, Form(v.place)), v.turns, v.sums)
        if isinstance(v, FloatRange):
            known = range_of_unary(op, v)
            if known is not None:
                return known
        return self._form_result(f"soter_n_{op}", self.form_of(v))

    def binary(self, op: str, a: Item, b: Item) -> Item:
        """The result of `+`, `-`, `*` or `/` on two floats."""
        if op in "+-" and (turned := self._sum_with_turns(op, a, b)) is not None:
            return turned
        if isinstance(a, FloatRange) and isinstance(b, FloatRange):
            known = range_of_binary(op, a, b)
            if known is not None:
                return known
        if isinstance(a, FloatRange) and op in "+*":
            a, b = b, a
        if isinstance(b, FloatRange):
            if op == "-":
                op, b = "+", FloatRange(-b.high, -b.low)
            if op in {"*", "+"} or not b.low <= 0.0 <= b.high:
                return self._operation_with_range(op, a, b)
        if op == "*" and a == b:
            return self._form_result("soter_n_square", self.form_of(a))
        return self._form_result(f"soter_n_{BINARY[op]}", self.form_of(a), self.form_of(b))

    def _sum_with_turns(self, op: str, a: Item, b: Item) -> Form | None:
        """The sum or difference if an angle may be full turns off; None if none, or too many."""
        turning = [x for x in (a, b) if isinstance(x, Form) and x.turns]
        turns, sums = sum(x.turns for x in turning), sum(x.sums for x in turning) + 1
        if not turning or turns > TURNS_MAX or sums > SUMS_MAX:
            return None
        plain = (Form(x.place) if isinstance(x, Form) else x for x in (a, b))
        return self._form_with_turns(self.binary(op, *plain), turns, sums)

    def _operation_with_range(self, op: str, a: Item, b: FloatRange) -> Form:
        """The result of `+`, `*` or `/` on a float and another float that lies in a known range."""
        name = {"+": "shift", "*": "scale", "/": "over"}[op]
        ends = float_literal(b.low), float_literal(b.high)
        return self._form_result(f"soter_n_{name}", self.form_of(a), *ends)

    def min_or_max(self, op: str, a: Item, b: Item) -> Item:
        """The result of min or max (`op`) on two floats or two ints."""
        if isinstance(a, (EmittedInts, KnownInt)):
            if isinstance(a, KnownInt) and isinstance(b, KnownInt):
                return KnownInt(min(a.value, b.value) if op == "min" else max(a.value, b.value))
            return EmittedInts(
                self.emitter.emit("ints", f"soter_ints_{op}", self.ints_of(a), self.ints_of(b))
            )
        if isinstance(a, FloatRange) and isinstance(b, FloatRange):
            pick = min if op == "min" else max
            return FloatRange(pick(a.low, b.low), pick(a.high, b.high))
        for k, x in ((b, a), (a, b)):
            if isinstance(k, FloatRange) and k.low == k.high:
                name = "soter_n_at_most" if op == "min" else "soter_n_at_least"
                return self._form_result(name, self.form_of(x), float_literal(k.low))
        return self._form_result(f"soter_n_{op}", self.form_of(a), self.form_of(b))

    @staticmethod
    def _form_with_turns(v: Item, turns: int, sums: int) -> Form:
        assert isinstance(v, Form)
        return replace(v, turns=turns, sums=sums)

    def angle_of_any_turn(self, v: Form) -> c.CExpr:
        """An angle for a periodic function, widened by the rounding errors of full turns."""
        return address(self.emitter.emit("form", "soter_n_any_turn", address(v.place)))

    def negation(self, v: Item) -> Item:
        """The result of `!` on a bool."""
        if isinstance(v, KnownTruth):
            return KnownTruth(None if v.value is None else not v.value)
        return EmittedTruth(self.emitter.emit("truth", "soter_not", self.truth_of(v)))

    def conjunction(self, a: Item, b: Item) -> Item:
        """The result of `&&` on two bools."""
        for x, y in ((a, b), (b, a)):
            if isinstance(x, KnownTruth) and x.value is not None:
                return y if x.value else x
        operands = (self.truth_of(a), self.truth_of(b))
        return EmittedTruth(self.emitter.emit("truth", "soter_both", *operands))

    def disjunction(self, a: Item, b: Item) -> Item:
        """The result of `||` on two bools."""
        return self.negation(self.conjunction(self.negation(a), self.negation(b)))

    def compare(self, op: str, a: Item, b: Item) -> Item:
        """The truth of a comparison of two floats, ints, enums or bools."""
        if op == "!=":
            return self.negation(self.compare("==", a, b))
        if op in SWAPPED:
            return self.compare(SWAPPED[op], b, a)
        if isinstance(a, (EmittedTruth, KnownTruth)):
            alike = self.conjunction(a, b), self.conjunction(self.negation(a), self.negation(b))
            return self.disjunction(*alike)
        if isinstance(a, KnownInt) and isinstance(b, KnownInt):
            return KnownTruth({"<": a.value < b.value, "<=": a.value <= b.value}.get(op, a == b))
        if isinstance(a, (EmittedInts, KnownInt)):
            arguments = (self.ints_of(a), self.ints_of(b))
            return EmittedTruth(self.emitter.emit("truth", INTS_COMPARE[op], *arguments))
        if isinstance(a, FloatRange) and isinstance(b, FloatRange):
            return KnownTruth(comparison_of_ranges(op, (a.low, a.high), (b.low, b.high)))
        operands = (self.form_of(a), self.form_of(b))
        if op == "==":
            return EmittedTruth(self.emitter.emit("truth", "soter_equal", *operands))
        return EmittedTruth(self.emitter.emit("truth", FORM_COMPARE[op], SIZE, *operands))

    def note_possible_fault(self) -> None:
        """Notes that a fault is possible here."""
        self.note_fault_unless(KnownTruth(False))

    def note_fault_unless(self, condition: Item) -> None:
        """Notes that a fault is possible unless the condition surely holds."""
        if condition != KnownTruth(True):
            self.emitter.emit("", "soter_possible", self.truth_of(condition), FAULT, kept=True)

    def int_operation(self, op: str, operands: tuple[Item, ...]) -> Item:
        """The result of add, sub, mul, neg, abs, div or mod on ints; notes possible faults."""
        if all(isinstance(o, KnownInt) for o in operands):
            try:
                return KnownInt(
                    INT_OPS[op](*(o.value for o in operands if isinstance(o, KnownInt)))
                )
            except arithmetic.StepFault:
                self.note_possible_fault()
                return KnownInt(0)
        arguments = tuple(self.ints_of(o) for o in operands)
        name = self.emitter.emit("ints", f"soter_ints_{op}", *arguments, FAULT, kept=True)
        return EmittedInts(name)

    def narrowed_int(self, v: Item, low: int, high: int) -> Item:
        """An int cut to the range of its new place; notes a fault if it may lie outside."""
        if isinstance(v, KnownInt):
            if not low <= v.value <= high:
                self.note_possible_fault()
            return KnownInt(min(max(v.value, low), high))
        ends = (int_literal(low), int_literal(high))
        return EmittedInts(
            self.emitter.emit("ints", "soter_ints_narrow", self.ints_of(v), *ends, FAULT, kept=True)
        )

    def checked_index(self, v: Item, limit: Item, capacity: int) -> Item:
        """An index cut to [0, limit); notes a fault if it may lie outside."""
        if isinstance(v, KnownInt) and isinstance(limit, KnownInt):
            if not 0 <= v.value < limit.value:
                self.note_possible_fault()
            return KnownInt(min(max(v.value, 0), max(capacity - 1, 0)))
        operands = (self.ints_of(v), self.ints_of(limit), int_literal(capacity))
        name = self.emitter.emit("ints", "soter_ints_index", *operands, FAULT, kept=True)
        return EmittedInts(name)

    def int_of_float(self, v: Item) -> Item:
        """The result of `int(x)` for a float x; notes possible faults."""
        if isinstance(v, FloatRange) and v.low == v.high and INT_MIN <= int(v.low) <= INT_MAX:
            return KnownInt(int(v.low))
        return EmittedInts(
            self.emitter.emit("ints", "soter_ints_to_int", self.form_of(v), FAULT, kept=True)
        )

    def checked_number(self, v: Item) -> Item:
        """The same float for a comparison; notes a possible fault if it may be NaN."""
        if not isinstance(v, FloatRange):
            is_number = EmittedTruth(self.emitter.emit("truth", "soter_is_number", self.form_of(v)))
            self.note_fault_unless(is_number)
        return v

    def float_of_int(self, v: Item) -> Item:
        """The result of `float(i)` for an int, or for a bool as 0 or 1."""
        if isinstance(v, KnownInt) and abs(v.value) <= 2**53:
            return FloatRange(float(v.value), float(v.value))
        if isinstance(v, (EmittedTruth, KnownTruth)):
            return self._form_result("soter_n_truth_to_float", self.truth_of(v))
        return self._form_result("soter_n_to_float", self.ints_of(v))

    def selection(self, condition: Item, then: Item, otherwise: Item) -> Item:
        """The result of `condition ? then : otherwise`."""
        if isinstance(condition, KnownTruth) and condition.value is not None:
            return then if condition.value else otherwise
        return self.leafwise(then, otherwise, lambda a, b: self._select_scalar(condition, a, b))

    def _select_scalar(self, condition: Item, a: Item, b: Item) -> Item:
        t = self.truth_of(condition)
        kind = kind_of(a)
        if kind == "form":
            return self._form_result("soter_n_select", t, self.form_of(a), self.form_of(b))
        if kind == "ints":
            arguments = (t, self.ints_of(a), self.ints_of(b))
            return EmittedInts(self.emitter.emit("ints", "soter_ints_select", *arguments))
        arguments = (t, self.truth_of(a), self.truth_of(b))
        return EmittedTruth(self.emitter.emit("truth", "soter_truth_select", *arguments))

    def leafwise(self, a: Item, b: Item, leaf: Callable[[Item, Item], Item]) -> Item:
        """Applies `leaf` to each pair of leaves that differ, and keeps leaves that are equal."""
        if a is b or a == b:
            return a
        a = as_parts(a) if isinstance(a, Constant) else a
        b = as_parts(b) if isinstance(b, Constant) else b
        if a == b:
            return a
        if isinstance(a, AggregateParts):
            assert isinstance(b, AggregateParts)
            pairs = zip(a.items, b.items, strict=True)
            return AggregateParts(tuple(self.leafwise(x, y, leaf) for x, y in pairs))
        if isinstance(a, Sequence):
            assert isinstance(b, Sequence)
            length = self.leafwise(a.length, b.length, leaf)
            assert isinstance(length, (EmittedInts, KnownInt))
            pairs = zip(a.items, b.items, strict=True)
            return Sequence(length, tuple(self.leafwise(x, y, leaf) for x, y in pairs))
        return leaf(a, b)

    def merged_value(
        self,
        a: Item,
        b: Item,
        variables: list[MergedVariable],
        then: list[Step],
        otherwise: list[Step],
    ) -> Item:
        """The value of a variable after a branch whose two blocks end with `a` and `b` in it."""

        def leaf(x: Item, y: Item) -> Item:
            kind = kind_of(x)
            variable = MergedVariable(kind, self.emitter.new_variable_name(kind))
            variables.append(variable)
            then.append(MergeStore(variable, self._stored_expression(kind, x), second=False))
            otherwise.append(MergeStore(variable, self._stored_expression(kind, y), second=True))
            return emitted_value(kind, variable.result)

        return self.leafwise(a, b, leaf)

    def value_after_block(
        self, v: Item, variables: list[MergedVariable], block: list[Step]
    ) -> Item:
        """A value from a block in a form that can be used after the block, if the block ran."""
        v = as_parts(v) if isinstance(v, Constant) else v
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
        variable = MergedVariable(kind, self.emitter.new_variable_name(kind))
        variables.append(variable)
        block.append(MergeStore(variable, self._stored_expression(kind, v), second=False))
        return emitted_value(kind, variable.result)

    def _stored_expression(self, kind: str, v: Item) -> c.CExpr:
        if kind == "form":
            e = self.form_of(v)
            assert isinstance(e, c.Unary)
            return e.operand
        return self.ints_of(v) if kind == "ints" else self.truth_of(v)

    def element_at(self, target: Item, at: Item, t: Type) -> Item:
        """The element of an array or list at an index that is surely in range."""
        if isinstance(at, KnownInt):
            whole = as_parts(target) if isinstance(target, Constant) else target
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
            table = self.emitter.static_name("double", "table", c.Initializer(items), array=True)
            return self._form_result("soter_n_table", table, self.ints_of(at))
        items = tuple((None, int_literal(int(v))) for v in values)  # type: ignore[call-overload]
        table = self.emitter.static_name("int64_t", "table", c.Initializer(items), array=True)
        return EmittedInts(self.emitter.emit("ints", "soter_ints_table", table, self.ints_of(at)))

    def _element_of_items(self, items: tuple[Item, ...], at: Item) -> Item:
        """The item at an index; if the index is undecided, a join of all items that it may mean."""
        selection = items[-1]
        if len(items) == 1:
            return selection
        for k in range(len(items) - 2, -1, -1):
            below = self.compare("<=", at, KnownInt(k))
            selection = self.selection(below, items[k], selection)
        return selection


def emitted_value(kind: str, name: str) -> Form | EmittedInts | EmittedTruth:
    """The value that a variable of the emitted C holds, by its kind and name."""
    if kind == "form":
        return Form(c.Name(name))
    return EmittedInts(c.Name(name)) if kind == "ints" else EmittedTruth(c.Name(name))


def kind_of(v: Item) -> str:
    """The kind of a scalar's C type, which is `ints`, `truth` or `form`."""
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

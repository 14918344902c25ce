"""Turns Core into emitted C that computes enclosures, with a form in the place of each number.

Purpose: `EnclosureBody` turns Core into operations of the emitted C; where a branch is undecided
both of its sides become blocks of C. A function of the prelude is enclosed by its meaning: `sin`
becomes an enclosure of the sine, widened by the tested bound of
`language/prelude/function_error_bounds.py`, instead of an enclosure of its polynomial.
Non-goals: the walk (`core/execution.py`), inputs (`enclosure_inputs.py`), which functions are
emitted (`compiled_enclosures.py`), the arithmetic (`enclosed_operations.py`); functions of the
prelude without a tested bound, whose bodies are enclosed as they are.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from soter.core import core
from soter.core.execution import Execution
from soter.language.model.types import IntType, ListType, Type, leaf_count
from soter.language.model.values import Table
from soter.language.prelude.function_error_bounds import BOUNDS
from soter.verify.enclose.enclosed_operations import UNKNOWN, EnclosureOperations
from soter.verify.enclose.enclosure_emitter import (
    AggregateParts,
    Constant,
    EmittedBranch,
    EmittedInts,
    EnclosureError,
    Form,
    Item,
    KnownInt,
    KnownTruth,
    MergedVariable,
    Sequence,
    as_parts,
    float_literal,
    is_scalar,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.core.execution import Join
    from soter.verify.enclose.enclosure_emitter import Emitter, Step


ENCLOSED = frozenset(
    "sin cos tan exp log tanh atan asin acos atan2 hypot pow".split()  # noqa: SIM905 - a list of words
)
"""The functions that `soter_n_NAME` of verify/engine/soter_form_math.h encloses."""

PERIODIC = frozenset({"sin", "cos", "tan", "wrap_angle"})
"""Functions with the period of a full turn."""


def is_prelude_function(function: core.Function) -> bool:
    """Whether the function comes from the prelude; a program may declare another `sin`."""
    return function.span.source.name.startswith("<prelude>/")


def prelude_call_enclosure(
    ops: EnclosureOperations, function: core.Function, arguments: tuple[Item, ...]
) -> Item | None:
    """An enclosure of a prelude function's exact value; None if its body must be enclosed."""
    name = function.source_name
    if is_prelude_function(function) and name in PERIODIC:
        (angle,) = arguments
        if isinstance(angle, Form) and angle.turns:
            return _enclosure_of_periodic_call(ops, name, angle)
    if name not in ENCLOSED or not is_prelude_function(function):
        return None
    bound = BOUNDS[name]
    assert not bound.relative
    assert not bound.absolute
    operands = tuple(ops.form_of(a) for a in arguments)
    return Form(ops.emitter.emit("form", f"soter_n_{name}", *operands, float_literal(bound.ulps)))


def _enclosure_of_periodic_call(ops: EnclosureOperations, name: str, angle: Form) -> Item:
    """An enclosure of a function with the period of a turn, at an angle any turns away."""
    bound, near = BOUNDS[name], ops.angle_of_any_turn(angle)
    off = bound.absolute if name == "wrap_angle" else bound.ulps
    return Form(ops.emitter.emit("form", f"soter_n_{name}", near, float_literal(off)))


class EnclosureBody(Execution[Item]):
    """Runs Core and emits operations on enclosures instead of computing values."""

    def __init__(
        self,
        emitter: Emitter,
        functions: Mapping[str, core.Function],
        cell: Callable[[core.Cell, Type], Item],
        prelude: set[str],
    ) -> None:
        super().__init__(functions, math.inf)
        self.ops = EnclosureOperations(emitter)
        self.emitter = emitter
        self.cell = cell
        self.prelude = prelude
        """The names of the prelude functions whose tested error bounds were used."""

    def expr(self, e: core.Expr) -> Item:
        """The enclosure of an expression's value, either already known or held by a C variable."""
        value = super().expr(e)
        return as_parts(value) if isinstance(value, Constant) and is_scalar(value.type) else value

    def _decided_truth(self, condition: Item) -> bool | None:
        return condition.value if isinstance(condition, KnownTruth) else None

    def _operation_value(self, e: core.Expr, *operands: Item) -> Item:
        ops = self.ops
        if isinstance(e, core.Const):
            return self._constant_value(e)
        if isinstance(e, core.Get):
            return self.cell(e.cell, e.type)
        if isinstance(e, core.Fact):
            return self._fact_value(e)
        if isinstance(e, core.Unary):
            return self._unary_operation(e.op, *operands)
        if isinstance(e, core.Binary):
            return self._binary_operation(e.op, *operands)
        if isinstance(e, core.Extreme):
            return ops.min_or_max(e.op, *operands)
        if isinstance(e, core.Select):
            return ops.selection(*operands)
        if isinstance(e, core.Field):
            return self._split_parts(*operands).items[e.index]
        if isinstance(e, core.Element):
            return ops.element_at(operands[0], operands[1], e.type)
        if isinstance(e, core.Length):
            whole = self._split_parts(*operands)
            assert isinstance(whole, Sequence)
            return whole.length
        assert isinstance(e, core.Make), e
        if isinstance(e.type, ListType):
            rest = as_parts(Constant(e.type, ()))
            assert isinstance(rest, Sequence)
            return Sequence(KnownInt(len(operands)), (*operands, *rest.items[len(operands) :]))
        return AggregateParts(operands)

    def _constant_value(self, e: core.Const) -> Item:
        if isinstance(e.value, Table):
            msg = (
                f"the table `{e.name}` of {leaf_count(e.type)} numbers is too large to be enclosed"
            )
            raise EnclosureError(msg)
        return Constant(e.type, e.value)

    def _fact_value(self, e: core.Fact) -> Item:
        if e.fact in {"time", "age"}:
            return self.ops.float_range(0.0, float("inf"))
        return self.ops.whole_range(0, 1) if e.fact == "mode" else UNKNOWN

    def _unary_operation(self, op: str, operand: Item) -> Item:
        if op == "not":
            return self.ops.negation(operand)
        return self.ops.float_of_int(operand) if op == "to_float" else self.ops.unary(op, operand)

    def _binary_operation(self, op: str, left: Item, right: Item) -> Item:
        if op == "&&":
            return self.ops.conjunction(left, right)
        if op == "||":
            return self.ops.disjunction(left, right)
        if op in {"+", "-", "*", "/"}:
            return self.ops.binary(op, left, right)
        return self.ops.compare(op, left, right)

    def _split_parts(self, v: Item) -> AggregateParts | Sequence:
        whole = as_parts(v) if isinstance(v, Constant) else v
        assert isinstance(whole, (AggregateParts, Sequence))
        return whole

    def _checked_value(self, s: core.Checked, operands: list[Item], limit: Item | None) -> Item:
        if s.op == "narrow":
            assert isinstance(s.type, IntType)
            return self.ops.narrowed_int(operands[0], s.type.low, s.type.high)
        if s.op == "index":
            assert limit is not None
            if isinstance(s.limit, core.Length):
                listed = s.limit.target.type
                assert isinstance(listed, ListType)
                return self.ops.checked_index(operands[0], limit, listed.capacity)
            assert isinstance(limit, KnownInt)
            return self.ops.checked_index(operands[0], limit, limit.value)
        if s.op == "to_int":
            return self.ops.int_of_float(operands[0])
        if s.op == "number":
            return self.ops.checked_number(operands[0])
        return self.ops.int_operation(s.op, tuple(operands))

    def _chosen_value(self, s: core.Choose) -> Item:
        where = f"line {s.span.line} of `{s.span.source.name}`"
        msg = f"what `choose` gives (in {where}) cannot be enclosed"
        raise EnclosureError(msg)

    def _guard(self, condition: Item) -> None:
        self.ops.note_fault_unless(condition)

    def result_of(self, f: core.Function, arguments: tuple[Item, ...]) -> Item:
        """The result of a call, with its body emitted in place; `EnclosureError` for an extern."""
        known = prelude_call_enclosure(self.ops, f, arguments)
        if known is not None:
            self.prelude.add(f.source_name)
            return known
        if f.result is None:
            msg = f"`{f.source_name}` is extern: what it computes cannot be enclosed"
            raise EnclosureError(msg)
        return super().result_of(f, arguments)

    def _with_part(
        self, s: core.Set | core.Push, old: Item, path: list[int | Item], value: Item
    ) -> Item:
        if isinstance(s, core.Set):
            return self._with_new_part(old, tuple(path), lambda _: value)
        return self._with_new_part(old, tuple(path), lambda whole: self._with_item(whole, value))

    def _with_item(self, old: Item, value: Item) -> Item:
        whole = self._split_parts(old)
        assert isinstance(whole, Sequence)
        room = self.ops.compare("<", whole.length, KnownInt(len(whole.items)))
        self.ops.note_fault_unless(room)
        items = tuple(
            self.ops.selection(self.ops.compare("==", whole.length, KnownInt(k)), value, x)
            for k, x in enumerate(whole.items)
        )
        longer = self.ops.int_operation("add", (whole.length, KnownInt(1)))
        length = self.ops.min_or_max("min", longer, KnownInt(len(items)))
        assert isinstance(length, (EmittedInts, KnownInt))
        return Sequence(length, items)

    def _with_new_part(
        self, old: Item, path: tuple[int | Item, ...], new: Callable[[Item], Item]
    ) -> Item:
        """`old` with the part at `path` changed; at an undecided index any part may change."""
        if not path:
            return new(old)
        step, rest = path[0], path[1:]
        whole = self._split_parts(old)
        items = list(whole.items)
        if isinstance(step, KnownInt):
            step = step.value
        if isinstance(step, int):
            items[step] = self._with_new_part(items[step], rest, new)
        else:
            for k, item in enumerate(items):
                here = self.ops.compare("==", step, KnownInt(k))
                changed = self._with_new_part(item, rest, new)
                items[k] = self.ops.selection(here, changed, item)
        return replace(whole, items=tuple(items))

    def _run_where(self, condition: core.Expr, body: tuple[core.Stmt, ...], *, truth: bool) -> None:
        """Runs one side of a branch, on which the truth of the condition's variable is known.

        `a && b` is a branch on a variable that already holds `a` (core/lower_expressions.py). If
        `a` is undecided and `b` false, the result would otherwise stay undecided.
        """
        while isinstance(condition, core.Unary) and condition.op == "not":
            condition, truth = condition.operand, not truth
        if isinstance(condition, core.Var) and condition.name in self.frame.variables:
            self.frame.variables[condition.name] = KnownTruth(truth)
        self.run(body)

    @property
    def where(self) -> list[Step]:
        """The block of C to which operations are added."""
        return self.emitter.block

    @where.setter
    def where(self, block: list[Step]) -> None:
        self.emitter.block = block

    def _where_in_side(self, *_: object) -> list[Step]:
        return []

    def _join_function(self, condition: Item, *sides: list[Step]) -> Join[Item]:
        merged: list[MergedVariable] = []
        self.where.append(EmittedBranch(self.ops.truth_of(condition), merged, *sides))

        def join(a: Item | None, b: Item | None, _: Type) -> Item:
            if a is not None and b is not None:
                return self.ops.merged_value(a, b, merged, *sides)
            if a is not None:  # of one block only; it must outlive the block
                return self.ops.value_after_block(a, merged, sides[0])
            assert b is not None
            return self.ops.value_after_block(b, merged, sides[1])

        return join

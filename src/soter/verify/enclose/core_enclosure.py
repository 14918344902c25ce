"""Emits C that computes an enclosure of what Core computes, a form in the place of each number.

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
    float_literal,
    is_scalar,
    opened,
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


def is_prelude(function: core.Function) -> bool:
    """Whether a function is the prelude's (a program may call its own function `sin`)."""
    return function.span.source.name.startswith("<prelude>/")


def enclosed_call(
    ops: EnclosureOperations, function: core.Function, arguments: tuple[Item, ...]
) -> Item | None:
    """An enclosure of the exact value of a prelude function; None: its body has to be enclosed."""
    name = function.source_name
    if is_prelude(function) and name in PERIODIC:
        (angle,) = arguments
        if isinstance(angle, Form) and angle.turns:
            return _periodic_call(ops, name, angle)
    if name not in ENCLOSED or not is_prelude(function):
        return None
    bound = BOUNDS[name]
    assert not bound.relative
    assert not bound.absolute
    operands = tuple(ops.form(a) for a in arguments)
    return Form(ops.emitter.emit("form", f"soter_n_{name}", *operands, float_literal(bound.ulps)))


def _periodic_call(ops: EnclosureOperations, name: str, angle: Form) -> Item:
    """An enclosure of a function of a full turn, at an angle that may be any turns further."""
    bound, near = BOUNDS[name], ops.any_turn(angle)
    off = bound.absolute if name == "wrap_angle" else bound.ulps
    return Form(ops.emitter.emit("form", f"soter_n_{name}", near, float_literal(off)))


class EnclosureBody(Execution[Item]):
    """Encloses bodies of Core."""

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
        """The prelude functions whose tested error bounds were used; they are added here."""

    def expr(self, e: core.Expr) -> Item:
        """The value of an expression."""
        value = super().expr(e)
        return opened(value) if isinstance(value, Constant) and is_scalar(value.type) else value

    def _known(self, condition: Item) -> bool | None:
        return condition.value if isinstance(condition, KnownTruth) else None

    def _operation(self, e: core.Expr, *operands: Item) -> Item:
        ops = self.ops
        if isinstance(e, core.Const):
            return self._const(e)
        if isinstance(e, core.Get):
            return self.cell(e.cell, e.type)
        if isinstance(e, core.Fact):
            return self._fact(e)
        if isinstance(e, core.Unary):
            return self._unary(e.op, *operands)
        if isinstance(e, core.Binary):
            return self._binary(e.op, *operands)
        if isinstance(e, core.Extreme):
            return ops.extreme(e.op, *operands)
        if isinstance(e, core.Select):
            return ops.select(*operands)
        if isinstance(e, core.Field):
            return self._parts(*operands).items[e.index]
        if isinstance(e, core.Element):
            return ops.element(operands[0], operands[1], e.type)
        if isinstance(e, core.Length):
            whole = self._parts(*operands)
            assert isinstance(whole, Sequence)
            return whole.length
        assert isinstance(e, core.Make), e
        if isinstance(e.type, ListType):
            rest = opened(Constant(e.type, ()))
            assert isinstance(rest, Sequence)
            return Sequence(KnownInt(len(operands)), (*operands, *rest.items[len(operands) :]))
        return AggregateParts(operands)

    def _const(self, e: core.Const) -> Item:
        if isinstance(e.value, Table):
            msg = (
                f"the table `{e.name}` of {leaf_count(e.type)} numbers is too large to be enclosed"
            )
            raise EnclosureError(msg)
        return Constant(e.type, e.value)

    def _fact(self, e: core.Fact) -> Item:
        if e.fact in {"time", "age"}:
            return self.ops.float_range(0.0, float("inf"))
        return self.ops.whole_range(0, 1) if e.fact == "mode" else UNKNOWN

    def _unary(self, op: str, operand: Item) -> Item:
        if op == "not":
            return self.ops.negated(operand)
        return self.ops.to_float(operand) if op == "to_float" else self.ops.unary(op, operand)

    def _binary(self, op: str, left: Item, right: Item) -> Item:
        if op == "&&":
            return self.ops.both(left, right)
        if op == "||":
            return self.ops.either(left, right)
        if op in {"+", "-", "*", "/"}:
            return self.ops.binary(op, left, right)
        return self.ops.compare(op, left, right)

    def _parts(self, v: Item) -> AggregateParts | Sequence:
        whole = opened(v) if isinstance(v, Constant) else v
        assert isinstance(whole, (AggregateParts, Sequence))
        return whole

    def _checked(self, s: core.Checked, operands: list[Item], limit: Item | None) -> Item:
        if s.op == "narrow":
            assert isinstance(s.type, IntType)
            return self.ops.narrowed(operands[0], s.type.low, s.type.high)
        if s.op == "index":
            assert limit is not None
            if isinstance(s.limit, core.Length):
                listed = s.limit.target.type
                assert isinstance(listed, ListType)
                return self.ops.index(operands[0], limit, listed.capacity)
            assert isinstance(limit, KnownInt)
            return self.ops.index(operands[0], limit, limit.value)
        if s.op == "to_int":
            return self.ops.to_int(operands[0])
        if s.op == "number":
            return self.ops.number(operands[0])
        return self.ops.int_operation(s.op, tuple(operands))

    def _choose(self, s: core.Choose) -> Item:
        where = f"line {s.span.line} of `{s.span.source.name}`"
        msg = f"what `choose` gives (in {where}) cannot be enclosed"
        raise EnclosureError(msg)

    def _guard(self, condition: Item) -> None:
        self.ops.note_fault_unless(condition)

    def call(self, f: core.Function, arguments: tuple[Item, ...]) -> Item:
        """The result of a call, written out; `EnclosureError` where the function is extern."""
        known = enclosed_call(self.ops, f, arguments)
        if known is not None:
            self.prelude.add(f.source_name)
            return known
        if f.result is None:
            msg = f"`{f.source_name}` is extern: what it computes cannot be enclosed"
            raise EnclosureError(msg)
        return super().call(f, arguments)

    def _changed(
        self, s: core.Set | core.Push, old: Item, path: list[int | Item], value: Item
    ) -> Item:
        if isinstance(s, core.Set):
            return self._replaced(old, tuple(path), lambda _: value)
        return self._replaced(old, tuple(path), lambda whole: self._pushed(whole, value))

    def _pushed(self, old: Item, value: Item) -> Item:
        whole = self._parts(old)
        assert isinstance(whole, Sequence)
        room = self.ops.compare("<", whole.length, KnownInt(len(whole.items)))
        self.ops.note_fault_unless(room)
        items = tuple(
            self.ops.select(self.ops.compare("==", whole.length, KnownInt(k)), value, x)
            for k, x in enumerate(whole.items)
        )
        longer = self.ops.int_operation("add", (whole.length, KnownInt(1)))
        length = self.ops.extreme("min", longer, KnownInt(len(items)))
        assert isinstance(length, (EmittedInts, KnownInt))
        return Sequence(length, items)

    def _replaced(
        self, old: Item, path: tuple[int | Item, ...], new: Callable[[Item], Item]
    ) -> Item:
        """`old` with the part at `path` changed; at an undecided index any may have."""
        if not path:
            return new(old)
        step, rest = path[0], path[1:]
        whole = self._parts(old)
        items = list(whole.items)
        if isinstance(step, KnownInt):
            step = step.value
        if isinstance(step, int):
            items[step] = self._replaced(items[step], rest, new)
        else:
            for k, item in enumerate(items):
                here = self.ops.compare("==", step, KnownInt(k))
                changed = self._replaced(item, rest, new)
                items[k] = self.ops.select(here, changed, item)
        return replace(whole, items=tuple(items))

    def _run_where(self, condition: core.Expr, body: tuple[core.Stmt, ...], *, truth: bool) -> None:
        """Runs one side of a branch, in which the condition and the variable it reads are known.

        `a && b` is a branch on a variable that already holds `a` (core/lower_expressions.py):
        without this an undecided `a` with a false `b` would stay undecided.
        """
        while isinstance(condition, core.Unary) and condition.op == "not":
            condition, truth = condition.operand, not truth
        if isinstance(condition, core.Var) and condition.name in self.frame.variables:
            self.frame.variables[condition.name] = KnownTruth(truth)
        self.run(body)

    @property
    def where(self) -> list[Step]:
        """The block of C to which operations go."""
        return self.emitter.block

    @where.setter
    def where(self, block: list[Step]) -> None:
        self.emitter.block = block

    def _reached(self, *_: object) -> list[Step]:
        return []

    def _join(self, condition: Item, *sides: list[Step]) -> Join[Item]:
        merged: list[MergedVariable] = []
        self.where.append(EmittedBranch(self.ops.truth(condition), merged, *sides))

        def join(a: Item | None, b: Item | None, _: Type) -> Item:
            if a is not None and b is not None:
                return self.ops.merged(a, b, merged, *sides)
            if a is not None:  # of one block only; it must outlive the block
                return self.ops.value_after_block(a, merged, sides[0])
            assert b is not None
            return self.ops.value_after_block(b, merged, sides[1])

        return join

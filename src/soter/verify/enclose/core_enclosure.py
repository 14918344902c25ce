"""Core over forms: one method a kind of node.

Purpose: what statements and expressions of Core come to when every number is an enclosure; loops
and calls are written out, both sides of an undecided branch run on copies and join.
Non-goals: which functions are emitted (`enclosure_code.py`), the arithmetic (`operations.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from soter.core import core
from soter.language.model.data_table import Table
from soter.language.model.types import IntType, ListType, leaf_count
from soter.verify.enclose.c_emitter import EmittedBranch, EnclosureError, MergedVariable
from soter.verify.enclose.enclosed_values import (
    AggregateParts,
    Constant,
    EmittedInts,
    Item,
    KnownInt,
    KnownTruth,
    Sequence,
    is_scalar,
    opened,
)
from soter.verify.enclose.operations import UNKNOWN, EnclosureOperations
from soter.verify.enclose.prelude import enclosed_call

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.language.model.types import Type
    from soter.verify.enclose.c_emitter import Emitter, Step


@dataclass
class EnclosureFrame:
    """Temporaries of one function or step, and what it has published."""

    variables: dict[str, Item] = field(default_factory=dict)
    outputs: dict[int, tuple[Item, Item]] = field(default_factory=dict)
    """Output number -> (whether, value)."""

    def copy(self) -> EnclosureFrame:
        """For one side of a branch."""
        return EnclosureFrame(dict(self.variables), dict(self.outputs))


class EnclosureBody:
    """Encloses bodies of Core."""

    def __init__(
        self,
        emitter: Emitter,
        functions: Mapping[str, core.Function],
        cell: Callable[[core.Cell, Type], Item],
        prelude: set[str],
    ) -> None:
        self.ops = EnclosureOperations(emitter)
        self.emitter = emitter
        self.functions = functions
        self.cell = cell
        self.prelude = prelude
        """Prelude functions whose tested bounds were used; filled here."""
        self.frame = EnclosureFrame()

    # ------------------------------------------------------------ expressions

    def expr(self, e: core.Expr) -> Item:
        """The value of an expression."""
        value = getattr(self, "_" + type(e).__name__.lower())(e)
        if isinstance(value, Constant) and is_scalar(value.type):
            return opened(value)
        return value  # type: ignore[no-any-return]

    def _const(self, e: core.Const) -> Item:
        if isinstance(e.value, Table):
            msg = (
                f"the table `{e.name}` of {leaf_count(e.type)} numbers is too large to be enclosed"
            )
            raise EnclosureError(msg)
        return Constant(e.type, e.value)

    def _var(self, e: core.Var) -> Item:
        return self.frame.variables[e.name]

    def _get(self, e: core.Get) -> Item:
        return self.cell(e.cell, e.type)

    def _fact(self, e: core.Fact) -> Item:
        if e.fact in {"time", "age"}:
            return self.ops.float_range(0.0, float("inf"))
        return self.ops.whole_range(0, 1) if e.fact == "mode" else UNKNOWN

    def _unary(self, e: core.Unary) -> Item:
        operand = self.expr(e.operand)
        if e.op == "not":
            return self.ops.negated(operand)
        if e.op == "to_float":
            return self.ops.to_float(operand)
        return self.ops.unary(e.op, operand)

    def _binary(self, e: core.Binary) -> Item:
        left, right = self.expr(e.left), self.expr(e.right)
        if e.op == "&&":
            return self.ops.both(left, right)
        if e.op == "||":
            return self.ops.either(left, right)
        if e.op in {"+", "-", "*", "/"}:
            return self.ops.binary(e.op, left, right)
        return self.ops.compare(e.op, left, right)

    def _extreme(self, e: core.Extreme) -> Item:
        return self.ops.extreme(e.op, self.expr(e.left), self.expr(e.right))

    def _select(self, e: core.Select) -> Item:
        condition = self.expr(e.condition)
        if isinstance(condition, KnownTruth) and condition.value is not None:
            return self.expr(e.then if condition.value else e.otherwise)
        return self.ops.select(condition, self.expr(e.then), self.expr(e.otherwise))

    def _field(self, e: core.Field) -> Item:
        return self._parts(self.expr(e.target)).items[e.index]

    def _parts(self, v: Item) -> AggregateParts | Sequence:
        whole = opened(v) if isinstance(v, Constant) else v
        assert isinstance(whole, (AggregateParts, Sequence))
        return whole

    def _element(self, e: core.Element) -> Item:
        target, at = self.expr(e.target), self.expr(e.index)
        return self.ops.element(target, at, e.type)

    def _length(self, e: core.Length) -> Item:
        whole = self._parts(self.expr(e.target))
        assert isinstance(whole, Sequence)
        return whole.length

    def _make(self, e: core.Make) -> Item:
        items = tuple(self.expr(x) for x in e.elements)
        if isinstance(e.type, ListType):
            rest = opened(Constant(e.type, ()))
            assert isinstance(rest, Sequence)
            return Sequence(KnownInt(len(items)), (*items, *rest.items[len(items) :]))
        return AggregateParts(items)

    # ------------------------------------------------------------ statements

    def run(self, statements: tuple[core.Stmt, ...]) -> None:
        """A sequence of statements."""
        for s in statements:
            getattr(self, "_do_" + type(s).__name__.lower())(s)

    def _do_let(self, s: core.Let) -> None:
        self.frame.variables[s.name] = self.expr(s.value)

    def _do_checked(self, s: core.Checked) -> None:
        operands = tuple(self.expr(o) for o in s.operands)
        self.frame.variables[s.name] = self._checked(s, operands)

    def _checked(self, s: core.Checked, operands: tuple[Item, ...]) -> Item:
        if s.op == "narrow":
            assert isinstance(s.type, IntType)
            return self.ops.narrowed(operands[0], s.type.low, s.type.high)
        if s.op == "index":
            assert s.limit is not None
            limit = self.expr(s.limit)
            if isinstance(s.limit, core.Length):
                listed = s.limit.target.type
                assert isinstance(listed, ListType)
                return self.ops.index(operands[0], limit, listed.capacity)
            assert isinstance(limit, KnownInt)
            return self.ops.index(operands[0], limit, limit.value)
        if s.op == "to_int":
            return self.ops.to_int(operands[0])
        return self.ops.int_operation(s.op, operands)

    def _do_choose(self, s: core.Choose) -> None:
        where = f"line {s.span.line} of `{s.span.source.name}`"
        msg = f"what `choose` gives (in {where}) cannot be enclosed"
        raise EnclosureError(msg)

    def _do_guard(self, s: core.Guard) -> None:
        self.ops.guard(self.expr(s.condition))

    def _do_call(self, s: core.Call) -> None:
        arguments = tuple(self.expr(a) for a in s.arguments)
        self.frame.variables[s.name] = self.call(self.functions[s.function], arguments)

    def call(self, function: core.Function, arguments: tuple[Item, ...]) -> Item:
        """A call, written out; EnclosureError where the function is extern."""
        known = enclosed_call(self.ops, function, arguments)
        if known is not None:
            self.prelude.add(function.source_name)
            return known
        if function.result is None:
            msg = f"`{function.source_name}` is extern: what it computes cannot be enclosed"
            raise EnclosureError(msg)
        outer = self.frame
        names = (p.name for p in function.parameters)
        self.frame = EnclosureFrame(dict(zip(names, arguments, strict=True)))
        self.run(function.body)
        result = self.expr(function.result)
        self.frame = outer
        return result

    def _do_set(self, s: core.Set) -> None:
        path = tuple(p if isinstance(p, int) else self.expr(p) for p in s.path)
        value = self.expr(s.value)
        old = self.frame.variables[s.name]
        self.frame.variables[s.name] = self._replaced(old, path, lambda _: value)

    def _replaced(
        self, old: Item, path: tuple[int | Item, ...], new: Callable[[Item], Item]
    ) -> Item:
        """`old` with the part at `path` changed; at an undecided index each may have."""
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

    def _do_push(self, s: core.Push) -> None:
        path = tuple(p if isinstance(p, int) else self.expr(p) for p in s.path)
        value = self.expr(s.value)

        def pushed(old: Item) -> Item:
            whole = self._parts(old)
            assert isinstance(whole, Sequence)
            room = self.ops.compare("<", whole.length, KnownInt(len(whole.items)))
            self.ops.guard(room)
            items = tuple(
                self.ops.select(self.ops.compare("==", whole.length, KnownInt(k)), value, x)
                for k, x in enumerate(whole.items)
            )
            longer = self.ops.int_operation("add", (whole.length, KnownInt(1)))
            length = self.ops.extreme("min", longer, KnownInt(len(items)))
            assert isinstance(length, (EmittedInts, KnownInt))
            return Sequence(length, items)

        old = self.frame.variables[s.name]
        self.frame.variables[s.name] = self._replaced(old, path, pushed)

    def _do_if(self, s: core.If) -> None:
        condition = self.expr(s.condition)
        if isinstance(condition, KnownTruth) and condition.value is not None:
            self.run(s.then if condition.value else s.otherwise)
            return
        self.branch(
            condition,
            lambda: self._run_where(s.condition, s.then, truth=True),
            lambda: self._run_where(s.condition, s.otherwise, truth=False),
        )

    def _run_where(self, condition: core.Expr, body: tuple[core.Stmt, ...], *, truth: bool) -> None:
        """One side of a branch: there the condition is known, and so is the variable it reads.

        `a && b` is a branch on a variable that already holds `a` (core/expressions.py): without
        this an undecided `a` with a false `b` would stay undecided.
        """
        while isinstance(condition, core.Unary) and condition.op == "not":
            condition, truth = condition.operand, not truth
        if isinstance(condition, core.Var) and condition.name in self.frame.variables:
            self.frame.variables[condition.name] = KnownTruth(truth)
        self.run(body)

    def branch(
        self, condition: Item, then: Callable[[], None], otherwise: Callable[[], None]
    ) -> None:
        """Both sides on copies of the frame, joined behind."""
        before = self.frame
        sides: list[tuple[EnclosureFrame, list[Step]]] = []
        for action in (then, otherwise):
            self.frame = before.copy()
            with self.emitter.nested() as block:
                action()
            sides.append((self.frame, block))
        (yes, first), (no, second) = sides
        merged: list[MergedVariable] = []

        def join(a: Item, b: Item) -> Item:
            return self.ops.merged(a, b, merged, first, second)

        self.frame = EnclosureFrame(
            {n: join(yes.variables[n], no.variables[n]) for n in before.variables}
        )
        for k in {**yes.outputs, **no.outputs}:
            in_yes, in_no = yes.outputs.get(k), no.outputs.get(k)
            if in_yes is not None and in_no is not None:
                value = join(in_yes[1], in_no[1])
            elif in_yes is not None:  # of one block only; it must outlive the block
                value = self.ops.outlived(in_yes[1], merged, first)
            else:
                assert in_no is not None
                value = self.ops.outlived(in_no[1], merged, second)
            never: Item = KnownTruth(False)
            has = [x[0] if x is not None else never for x in (in_yes, in_no)]
            self.frame.outputs[k] = (join(*has), value)
        self.emitter.block.append(EmittedBranch(self.ops.truth(condition), merged, first, second))

    def _do_loop(self, s: core.Loop) -> None:
        for k in range(s.low, s.high):
            self.frame.variables[s.variable] = KnownInt(k)
            self.run(s.body)

    def _do_publish(self, s: core.Publish) -> None:
        self.frame.outputs[s.output] = (KnownTruth(True), self.expr(s.value))

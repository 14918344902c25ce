"""The inputs of an emitted enclosure: which leaf of a program each of them is.

Purpose: `EnclosureInputs` knows the number of each leaf that is an input, and reads it from `in[]`
or `param[]` of the emitted function. It makes estimates (a driven topic plus its measurement
errors), and gives the declared range to a leaf that is no input of the function. `leaf_values`
goes through the leaves of a value.
Non-goals: which leaves are inputs (`verify/problem/inputs.py`), what reads them
(`enclosed_steps.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    default_value,
    leaves,
)
from soter.verify.enclose.enclosed_operations import UNKNOWN
from soter.verify.enclose.enclosure_emitter import (
    AggregateParts,
    Constant,
    EmittedInts,
    EmittedTruth,
    Form,
    Item,
    Sequence,
    address,
    element_types,
    opened,
    whole_literal,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.system import Bound, Disturbance, Topic
    from soter.language.model.types import Type
    from soter.verify.enclose.enclosed_operations import EnclosureOperations
    from soter.verify.problem.problem import Leaf, Quantities


Path = tuple[str, ...]
Key = tuple[int, str, Path]


def leaf_values(t: Type, v: Item) -> Iterator[tuple[Path, Type, Item]]:
    """The leaves of a value, with paths and types; the type has no lists."""
    if isinstance(v, Constant):
        v = opened(v)
    if isinstance(v, AggregateParts):
        for name, f, item in zip(part_names(t), element_types(t), v.items, strict=True):
            for path, leaf, x in leaf_values(f, item):
                yield (name, *path), leaf, x
    else:
        yield (), t, v


def part_names(t: Type) -> tuple[str, ...]:
    """The names of the parts of a record or array, as they stand in paths."""
    if isinstance(t, RecordType):
        return tuple(n for n, _ in t.fields)
    assert isinstance(t, ArrayType)
    return tuple(f"[{i}]" for i in range(t.size))


class EnclosureInputs:
    """Reads leaves of `in[]` and `param[]` in one emitted function."""

    def __init__(self, ops: EnclosureOperations, quantities: Quantities) -> None:
        self.ops = ops
        groups: list[dict[Key, int]] = []
        first = 0
        q = quantities
        for group in (q.states, q.controls, q.disturbances, q.errors, q.others):
            groups.append({leaf_key(x): first + i for i, x in enumerate(group)})
            first += len(group)
        self.states, self.controls, self.disturbances, self.errors, self.others = groups
        self.parameter = {leaf_key(x): i for i, x in enumerate(q.parameters)}
        self.turning = q.turning

    def leaf(self, number: int, t: Type) -> Item:
        """Input number `number` as a value of a scalar type."""
        if isinstance(t, FloatType):
            return Form(self.ops.emitter.read(number), turns=int(number in self.turning))
        place = c.IndexExpr(c.Name("in"), c.Number(str(number)))
        emit = self.ops.emitter.emit
        if isinstance(t, BoolType):
            return EmittedTruth(emit("truth", "soter_truth_input", address(place)))
        if isinstance(t, EnumType):
            low, high = 0, len(t.members) - 1
        else:
            assert isinstance(t, IntType)
            low, high = t.low, t.high
        ends = (whole_literal(low), whole_literal(high))
        return EmittedInts(emit("ints", "soter_ints_input", address(place), *ends))

    def parameter_leaf(self, number: int, t: Type) -> Item:
        """Parameter number `number`, of which the function is given the exact value."""
        place = c.IndexExpr(c.Name("param"), c.Number(str(number)))
        emit = self.ops.emitter.emit
        if isinstance(t, BoolType):
            tests = (c.Binary(op, place, c.Number("0")) for op in ("!=", "=="))
            return EmittedTruth(emit("truth", "soter_truth_of", *tests))
        return EmittedInts(emit("ints", "soter_ints_of", place, place))

    def build(self, t: Type, known: dict[Path, Item]) -> Item:
        """A value of a type, made of known leaves; a missing leaf is any value of its type."""

        def at(t: Type, path: Path) -> Item:
            if path in known:
                return known[path]
            if isinstance(t, (RecordType, ArrayType)):
                below = zip(part_names(t), element_types(t), strict=True)
                return AggregateParts(tuple(at(f, (*path, n)) for n, f in below))
            return self.ops.any_value(t)

        return at(t, ())

    def state(self, owner: int, name: str, t: Type) -> Item:
        """The value of a plant's state."""
        known: dict[Path, Item] = {}
        for path, leaf in leaves(t, whole_lists=True):
            k = (owner, name, path)
            if k in self.states:
                known[path] = self.leaf(self.states[k], leaf)
            elif k in self.parameter:
                known[path] = self.parameter_leaf(self.parameter[k], leaf)
        return self.build(t, known)

    def disturbance(self, owner: int, d: Disturbance, *, read: bool) -> Item:
        """A disturbance: an input if the function reads it, else its whole range."""
        t, known = d.variable.type, {}
        for path, leaf in leaves(t, whole_lists=True):
            number = self.disturbances.get((owner, d.variable.name, path))
            if read and number is not None:
                known[path] = self.leaf(number, leaf)
            else:
                known[path] = self.ops.float_range(d.low, d.high)
        return self.build(t, known)

    def topic(self, topic: Topic, numbers: dict[Key, int]) -> Item:
        """A topic that no plant drives: the inputs that `numbers` has, else its declared set."""
        known = self._declared_ranges(topic)
        for path, leaf in leaves(topic.type, whole_lists=True):
            number = numbers.get((topic.index, "", path))
            if number is not None:
                known[path] = self.leaf(number, leaf)
        return self.build(topic.type, known)

    def _declared_ranges(self, topic: Topic) -> dict[Path, Item]:
        """The declared range of each leaf of a topic."""
        bounds = dict(zip((p for p, _ in leaves(topic.type)), topic.bounds, strict=True))
        return {p: self.any_within(t, p, bounds) for p, t in leaves(topic.type, whole_lists=True)}

    def any_within(self, t: Type, path: Path, bounds: dict[Path, Bound | None]) -> Item:
        """Any value of a type within bounds."""
        if isinstance(t, ListType):
            inner = {
                q: self.any_within(f, (*path, "[]", *q), bounds)
                for q, f in leaves(t.element, whole_lists=True)
            }
            length = self.ops.whole_range(0, t.capacity)
            zero = Constant(t.element, default_value(t.element))
            item = self.ops.select(UNKNOWN, self.build(t.element, inner), zero)
            return Sequence(length, (item,) * t.capacity)
        bound = bounds[path]
        if bound is None:
            return self.ops.any_value(t)
        if isinstance(t, FloatType):
            return self.ops.float_range(bound.low, bound.high)
        if isinstance(t, IntType):
            return self.ops.whole_range(math.ceil(bound.low), math.floor(bound.high))
        return self.ops.any_value(t)

    def measured(self, topic: int, t: Type, true: Item, *, bounds: dict[Path, float]) -> Item:
        """A driven topic as it is read: `true` plus its errors, which are inputs or ranges."""

        def seen(t: Type, path: Path, v: Item) -> Item:
            if path in bounds:
                number = self.errors.get((topic, "", path))
                limit = bounds[path]
                error = (
                    self.leaf(number, t)
                    if number is not None
                    else self.ops.float_range(-limit, limit)
                )
                return self.ops.binary("+", v, error)
            if isinstance(v, AggregateParts) and isinstance(t, (RecordType, ArrayType)):
                below = zip(part_names(t), element_types(t), v.items, strict=True)
                return AggregateParts(tuple(seen(f, (*path, n), x) for n, f, x in below))
            return v

        return seen(t, (), true)


def leaf_key(leaf: Leaf) -> Key:
    """The key by which a leaf is looked up: its owner and path."""
    return leaf.owner, leaf.member, leaf.path

"""The inputs of an emitted function, each of which is a leaf of the program.

Purpose: `EnclosureInputs` knows the number of each leaf that is an input, and reads it from `in[]`
or `param[]` of the emitted function. It makes estimates (a driven topic plus its measurement
errors), and gives the declared range to a leaf that is no input of the function. `leaf_values`
lists the leaves of a value.
Non-goals: the choice of inputs (`verify/problem/inputs.py`), their readers (`enclosed_steps.py`).
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
    as_parts,
    element_types,
    int_literal,
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
    """The path, type and value of each leaf of a value whose type has no lists."""
    if isinstance(v, Constant):
        v = as_parts(v)
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
    """Reads leaves from `in[]` and `param[]` in one emitted function."""

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

    def input_leaf(self, number: int, t: Type) -> Item:
        """The value of input `number`, which has a scalar type."""
        if isinstance(t, FloatType):
            return Form(self.ops.emitter.input_variable(number), turns=int(number in self.turning))
        place = c.IndexExpr(c.Name("in"), c.Number(str(number)))
        emit = self.ops.emitter.emit
        if isinstance(t, BoolType):
            return EmittedTruth(emit("truth", "soter_truth_input", address(place)))
        if isinstance(t, EnumType):
            low, high = 0, len(t.members) - 1
        else:
            assert isinstance(t, IntType)
            low, high = t.low, t.high
        ends = (int_literal(low), int_literal(high))
        return EmittedInts(emit("ints", "soter_ints_input", address(place), *ends))

    def parameter_leaf(self, number: int, t: Type) -> Item:
        """The value of parameter `number`, which the caller passes exactly."""
        place = c.IndexExpr(c.Name("param"), c.Number(str(number)))
        emit = self.ops.emitter.emit
        if isinstance(t, BoolType):
            tests = (c.Binary(op, place, c.Number("0")) for op in ("!=", "=="))
            return EmittedTruth(emit("truth", "soter_truth_of", *tests))
        return EmittedInts(emit("ints", "soter_ints_of", place, place))

    def value_of_leaves(self, t: Type, known: dict[Path, Item]) -> Item:
        """A value of type `t` with these known leaves; every other leaf may have any value."""

        def part_at(t: Type, path: Path) -> Item:
            if path in known:
                return known[path]
            if isinstance(t, (RecordType, ArrayType)):
                below = zip(part_names(t), element_types(t), strict=True)
                return AggregateParts(tuple(part_at(f, (*path, n)) for n, f in below))
            return self.ops.any_value(t)

        return part_at(t, ())

    def state_value(self, owner: int, name: str, t: Type) -> Item:
        """The value of a plant's state."""
        known: dict[Path, Item] = {}
        for path, leaf in leaves(t, whole_lists=True):
            k = (owner, name, path)
            if k in self.states:
                known[path] = self.input_leaf(self.states[k], leaf)
            elif k in self.parameter:
                known[path] = self.parameter_leaf(self.parameter[k], leaf)
        return self.value_of_leaves(t, known)

    def disturbance_value(self, owner: int, d: Disturbance, *, read: bool) -> Item:
        """The value of a disturbance; with `read` it is an input, otherwise its whole range."""
        t, known = d.variable.type, {}
        for path, leaf in leaves(t, whole_lists=True):
            number = self.disturbances.get((owner, d.variable.name, path))
            if read and number is not None:
                known[path] = self.input_leaf(number, leaf)
            else:
                known[path] = self.ops.float_range(d.low, d.high)
        return self.value_of_leaves(t, known)

    def topic_value(self, topic: Topic, numbers: dict[Key, int]) -> Item:
        """The value of a topic; leaves without an input in `numbers` have their declared range."""
        known = self._declared_ranges(topic)
        for path, leaf in leaves(topic.type, whole_lists=True):
            number = numbers.get((topic.index, "", path))
            if number is not None:
                known[path] = self.input_leaf(number, leaf)
        return self.value_of_leaves(topic.type, known)

    def _declared_ranges(self, topic: Topic) -> dict[Path, Item]:
        """The declared range of each leaf of a topic."""
        bounds = dict(zip((p for p, _ in leaves(topic.type)), topic.bounds, strict=True))
        return {p: self.value_within(t, p, bounds) for p, t in leaves(topic.type, whole_lists=True)}

    def value_within(self, t: Type, path: Path, bounds: dict[Path, Bound | None]) -> Item:
        """An enclosure of all values of a type whose leaves lie within the bounds."""
        if isinstance(t, ListType):
            inner = {
                q: self.value_within(f, (*path, "[]", *q), bounds)
                for q, f in leaves(t.element, whole_lists=True)
            }
            length = self.ops.whole_range(0, t.capacity)
            zero = Constant(t.element, default_value(t.element))
            item = self.ops.selection(UNKNOWN, self.value_of_leaves(t.element, inner), zero)
            return Sequence(length, (item,) * t.capacity)
        bound = bounds[path]
        if bound is None:
            return self.ops.any_value(t)
        if isinstance(t, FloatType):
            return self.ops.float_range(bound.low, bound.high)
        if isinstance(t, IntType):
            return self.ops.whole_range(math.ceil(bound.low), math.floor(bound.high))
        return self.ops.any_value(t)

    def measured_value(self, topic: int, t: Type, true: Item, *, bounds: dict[Path, float]) -> Item:
        """The measured value of a driven topic: the true value plus errors, as inputs or ranges."""

        def measured_part(t: Type, path: Path, v: Item) -> Item:
            if path in bounds:
                number = self.errors.get((topic, "", path))
                limit = bounds[path]
                error = (
                    self.input_leaf(number, t)
                    if number is not None
                    else self.ops.float_range(-limit, limit)
                )
                return self.ops.binary("+", v, error)
            if isinstance(v, AggregateParts) and isinstance(t, (RecordType, ArrayType)):
                below = zip(part_names(t), element_types(t), v.items, strict=True)
                return AggregateParts(tuple(measured_part(f, (*path, n), x) for n, f, x in below))
            return v

        return measured_part(t, (), true)


def leaf_key(leaf: Leaf) -> Key:
    """The key by which a leaf is looked up: its owner, member and path."""
    return leaf.owner, leaf.member, leaf.path

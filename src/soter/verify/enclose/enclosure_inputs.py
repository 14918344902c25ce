"""What cells hold while a module is enclosed: states, topics, disturbances, parameters.

Purpose: which input is which leaf, estimates (a driven topic plus its measurement errors), and the
range of what is no input of the function being emitted.
Non-goals: steps (`enclosure_code.py`).
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
    Type,
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
    whole_literal,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.system import Bound, Disturbance, Topic
    from soter.verify.enclose.enclosed_operations import EnclosureOperations
    from soter.verify.problem.problem import Leaf, Quantities

Path = tuple[str, ...]
Key = tuple[int, str, Path]


def paths(t: Type, path: Path = ()) -> Iterator[tuple[Path, Type]]:
    """All leaves with their paths; lists stay whole."""
    if isinstance(t, RecordType):
        for n, f in t.fields:
            yield from paths(f, (*path, n))
    elif isinstance(t, ArrayType):
        for i in range(t.size):
            yield from paths(t.element, (*path, f"[{i}]"))
    else:
        yield path, t


def parts(t: Type, v: Item) -> Iterator[tuple[Path, Type, Item]]:
    """Leaves of a value of a type without lists."""
    if isinstance(v, AggregateParts):
        for name, f, item in zip(names(t), types_of(t), v.items, strict=True):
            for path, leaf, x in parts(f, item):
                yield (name, *path), leaf, x
    else:
        yield (), t, v


def names(t: Type) -> tuple[str, ...]:
    """Path steps of a record or array."""
    if isinstance(t, RecordType):
        return tuple(n for n, _ in t.fields)
    assert isinstance(t, ArrayType)
    return tuple(f"[{i}]" for i in range(t.size))


def types_of(t: Type) -> tuple[Type, ...]:
    """Types below a record or array."""
    if isinstance(t, RecordType):
        return tuple(f for _, f in t.fields)
    assert isinstance(t, ArrayType)
    return (t.element,) * t.size


class EnclosureInputs:
    """Reads leaves of `in[]` and `param[]` in one emitted function."""

    def __init__(self, ops: EnclosureOperations, quantities: Quantities) -> None:
        self.ops = ops
        groups: list[dict[Key, int]] = []
        first = 0
        q = quantities
        for group in (q.states, q.controls, q.disturbances, q.errors, q.others):
            groups.append({key(x): first + i for i, x in enumerate(group)})
            first += len(group)
        self.states, self.controls, self.disturbances, self.errors, self.others = groups
        self.parameter = {key(x): i for i, x in enumerate(q.parameters)}
        self.turning = q.turning

    # ------------------------------------------------------------ leaves

    def leaf(self, number: int, t: Type) -> Item:
        """Input number `number` as a value of a scalar type."""
        if isinstance(t, FloatType):
            return Form(self.ops.emitter.read(number), turns=int(number in self.turning))
        place = c.IndexExpr(c.Name("in"), c.Number(str(number)))
        emit = self.ops.emitter.emit
        if isinstance(t, BoolType):
            return EmittedTruth(emit("truth", "soter_truth_input", address(place)))
        low, high = (t.low, t.high) if isinstance(t, IntType) else (0, members(t) - 1)
        ends = (whole_literal(low), whole_literal(high))
        return EmittedInts(emit("ints", "soter_ints_input", address(place), *ends))

    def parameter_leaf(self, number: int, t: Type) -> Item:
        """Parameter number `number`: exactly known when the function runs."""
        place = c.IndexExpr(c.Name("param"), c.Number(str(number)))
        emit = self.ops.emitter.emit
        if isinstance(t, BoolType):
            tests = (c.Binary(op, place, c.Number("0")) for op in ("!=", "=="))
            return EmittedTruth(emit("truth", "soter_truth_of", *tests))
        return EmittedInts(emit("ints", "soter_ints_of", place, place))

    def build(self, t: Type, known: dict[Path, Item]) -> Item:
        """A value of a type from leaves; what is missing may be anything of its type."""

        def at(t: Type, path: Path) -> Item:
            if path in known:
                return known[path]
            if isinstance(t, (RecordType, ArrayType)):
                below = zip(names(t), types_of(t), strict=True)
                return AggregateParts(tuple(at(f, (*path, n)) for n, f in below))
            return self.ops.top(t)

        return at(t, ())

    # ------------------------------------------------------------ cells

    def state(self, owner: int, name: str, t: Type) -> Item:
        """A plant's state."""
        known: dict[Path, Item] = {}
        for path, leaf in paths(t):
            k = (owner, name, path)
            if k in self.states:
                known[path] = self.leaf(self.states[k], leaf)
            elif k in self.parameter:
                known[path] = self.parameter_leaf(self.parameter[k], leaf)
        return self.build(t, known)

    def disturbance(self, owner: int, d: Disturbance, *, read: bool) -> Item:
        """A disturbance: the input where the function reads it, else its whole range."""
        t, known = d.variable.type, {}
        for path, leaf in paths(t):
            number = self.disturbances.get((owner, d.variable.name, path))
            if read and number is not None:
                known[path] = self.leaf(number, leaf)
            else:
                known[path] = self.ops.float_range(d.low, d.high)
        return self.build(t, known)

    def topic(self, topic: Topic, numbers: dict[Key, int]) -> Item:
        """A topic nobody here drives: inputs where `numbers` has them, else its declared set."""
        known = self._bounded(topic)
        for path, leaf in paths(topic.type):
            number = numbers.get((topic.index, "", path))
            if number is not None:
                known[path] = self.leaf(number, leaf)
        return self.build(topic.type, known)

    def _bounded(self, topic: Topic) -> dict[Path, Item]:
        """The declared set, leaf by leaf."""
        bounds = dict(zip((p for p, _ in leaves(topic.type)), topic.bounds, strict=True))
        return {p: self.ranged(t, p, bounds) for p, t in paths(topic.type)}

    def ranged(self, t: Type, path: Path, bounds: dict[Path, Bound | None]) -> Item:
        """Any value of a type within bounds."""
        if isinstance(t, ListType):
            inner = {q: self.ranged(f, (*path, "[]", *q), bounds) for q, f in paths(t.element)}
            length = self.ops.whole_range(0, t.capacity)
            zero = Constant(t.element, default_value(t.element))
            item = self.ops.select(UNKNOWN, self.build(t.element, inner), zero)
            return Sequence(length, (item,) * t.capacity)
        bound = bounds[path]
        if bound is None:
            return self.ops.top(t)
        if isinstance(t, FloatType):
            return self.ops.float_range(bound.low, bound.high)
        if isinstance(t, IntType):
            return self.ops.whole_range(math.ceil(bound.low), math.floor(bound.high))
        return self.ops.top(t)

    def measured(self, topic: int, t: Type, true: Item, *, bounds: dict[Path, float]) -> Item:
        """A driven topic as it is seen: with its errors, as inputs or as ranges."""

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
                below = zip(names(t), types_of(t), v.items, strict=True)
                return AggregateParts(tuple(seen(f, (*path, n), x) for n, f, x in below))
            return v

        return seen(t, (), true)


def members(t: Type) -> int:
    """How many members an enumeration has."""
    assert isinstance(t, EnumType)
    return len(t.members)


def key(leaf: Leaf) -> Key:
    """What a leaf is found by."""
    return leaf.owner, leaf.member, leaf.path

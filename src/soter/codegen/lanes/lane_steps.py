"""Steps and predicates over states of several worlds.

Purpose: what is loaded, computed (`lane_code.py`), checked by the gate and stored.
Non-goals: which have lanes (`lanes.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.codegen.body import stream_key
from soter.codegen.c import tree as c
from soter.codegen.c.names import Unique, field_name
from soter.codegen.c.types import float_number, int_number
from soter.codegen.faults import leaf_of
from soter.codegen.lanes.lane_code import CT, MASK, LaneCode
from soter.codegen.lanes.lane_values import BOOL, NOWHERE, NotStraight, Place
from soter.core import core
from soter.core.layout import scalar
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.codegen.lanes.lane_values import LaneValues
    from soter.language.model.system import Bound, Component
    from soter.language.model.types import Type

VERDICTS, LANE = c.Name("given_verdicts"), c.Name("given_lane")
ZERO = c.Number("0U")


class LaneVerdict(LaneCode):
    """A predicate over states."""

    def statements(self, p: core.Predicate, *, negate: bool) -> list[c.CStmt]:
        """What it is in each state; false where one faults."""
        self.in_state = self.certain = True
        inner = self.block(p.body)
        value = self.lane(p.value)
        body: list[c.CStmt] = [*inner, c.Declare(BOOL, "given_verdict", value, const=True)]
        body.append(self.given_up())
        each = c.IndexExpr(c.Name("given_verdict"), LANE)
        op = "==" if negate else "!="
        told = c.Assign(c.IndexExpr(VERDICTS, LANE), c.Binary(op, each, c.Number("0")))
        body.append(c.For("given_lane", c.Number("0"), c.Name("SOTER_LANES"), (told,)))
        return [*self.opened("const "), *body, c.Return(c.Name("true"))]


class LaneStep(LaneCode):
    """A step over states."""

    def __init__(
        self, lanes: LaneValues, component: Component, step: core.NodeStep | core.PlantStep
    ) -> None:
        super().__init__(lanes)
        self.component = component
        self.step = step
        self.in_state = self.certain = True
        self.always = lanes.frame.certain(component, step)

    def has(self, output: int) -> c.Name | None:
        """In which lanes the step published an output; None where it always does."""
        if output in self.always:
            return None
        return c.Name("has_" + self.outputs[output].removeprefix("out_"))

    def enabled(self) -> c.CExpr:
        """In which lanes the outputs of the step are enabled."""
        return c.CallExpr("SOTER_LANE_ENABLED", (c.Name("flags"),))

    def statements(self) -> list[c.CStmt]:
        """Load, compute, check, store."""
        step = self.step
        plant = isinstance(step, core.PlantStep)
        copies = step.states if isinstance(step, core.PlantStep) else step.locals
        inner: list[c.CStmt] = []
        for x in copies:
            there = Place(self.cell(x.cell))
            if not self.lanes.has_lanes(x.type):
                self.places[x.name] = there
                continue
            name = self.local(x.name)
            self.varying.add(x.name)
            value = self.load(there, x.type)
            inner += [c.Declare(self.lanes.type(x.type), name, value), c.Unused(name)]
        if isinstance(step, core.PlantStep):
            inner += self._disturbances(step)
        unique = Unique()
        topics = [self.lanes.frame.system.topics[o.topic].name for o in step.outputs]
        self.outputs = tuple(f"out_{unique(n.rpartition('.')[2])}" for n in topics)
        for name, o in zip(self.outputs, step.outputs, strict=True):
            if self.lanes.has_lanes(o.type):
                default = self.lanes.spread(o.type, self.types.default(o.type))
                inner.append(c.Declare(self.lanes.type(o.type), name, default))
        for k in range(len(step.outputs)):
            has = self.has(k)
            if has is not None:
                inner.append(c.Declare(BOOL, has.text, NOWHERE))
        if isinstance(step, core.PlantStep):
            inner += self.block((*step.choose, *step.integrate, *step.publish))
            inner += self._noise(step)
        else:
            inner += self.block(step.body)
        for k, o in enumerate(step.outputs):
            if self.lanes.has_lanes(o.type):
                with self._under(self.has(k) or MASK):
                    inner += self._checks(o.type, list(o.bounds), c.Name(self.outputs[k]))
        inner.append(self.given_up())
        for x in copies:
            if x.written and x.name not in self.places:
                inner += self._stored(
                    c.Name("soter_lane_always"),
                    self.cell(x.cell),
                    x.type,
                    c.Name(self.local(x.name)),
                    canonical=True,
                )
        inner += self._published(gated=not plant and self.component.role != "node")
        return [*self.opened(""), *inner, c.Return(c.Name("true"))]

    def _draws(self, draws: tuple[core.Draw, ...], at: c.CExpr) -> Iterator[c.CExpr]:
        for d in draws:
            hold = d.hold_ns if d.hold_ns > 0 else self.component.period_ns
            index = c.Binary("/", at, int_number(hold))
            low, high = float_number(d.low), float_number(d.high)
            key = c.CallExpr("SOTER_LANE_BITS", (c.Name("header.seed_key"),))
            yield c.CallExpr("soter_lane_draw", (key, stream_key(d.stream), index, low, high))

    def _disturbances(self, step: core.PlantStep) -> list[c.CStmt]:
        began = c.Binary("-", CT, int_number(self.component.period_ns))
        statements: list[c.CStmt] = []
        for name, t, draws in step.disturbances:
            own = self.local(name)
            self.varying.add(name)
            value = self._assembled(t, iter(list(self._draws(draws, began))))
            statements += [c.Declare(self.lanes.type(t), own, value, const=True), c.Unused(own)]
        return statements

    def _assembled(self, t: Type, values: Iterator[c.CExpr]) -> c.CExpr:
        if isinstance(t, FloatType):
            return next(values)
        items: list[tuple[str | None, c.CExpr]] = []
        if isinstance(t, RecordType):
            items = [(field_name(n), self._assembled(f, values)) for n, f in t.fields]
        elif isinstance(t, ArrayType):
            each = tuple((None, self._assembled(t.element, values)) for _ in range(t.size))
            items = [("at", c.Initializer(each))]
        else:
            raise NotStraight
        return c.Initializer(tuple(items), self.lanes.type(t))

    def _noise(self, step: core.PlantStep) -> list[c.CStmt]:
        statements: list[c.CStmt] = []
        for output, leaf, draw in step.noise:
            target = leaf_of(c.Name(self.outputs[output]), step.outputs[output].type, leaf)
            (error,) = self._draws((core.Draw(draw.stream, draw.low, draw.high, -1),), CT)
            statements.append(c.Assign(target, c.Binary("+", target, error)))
        return statements

    def _checks(self, t: Type, bounds: list[Bound | None], e: c.CExpr) -> Iterator[c.CStmt]:
        """The gate; it takes the bounds of its leaves off the list."""
        if isinstance(t, FloatType):
            bound = bounds.pop(0)
            yield self.fails(c.CallExpr("soter_lane_not_finite", (e,)))
            if bound is not None:
                ends = (float_number(bound.low), float_number(bound.high))
                yield self.fails(c.CallExpr("soter_lane_outside", (e, *ends)))
        elif isinstance(t, IntType):
            bound = bounds.pop(0)
            if bound is not None:
                ends = (int_number(math.ceil(bound.low)), int_number(math.floor(bound.high)))
                yield self.fails(c.CallExpr("soter_lane_outside_int", (e, *ends)))
        elif isinstance(t, (BoolType, EnumType)):
            bounds.pop(0)
        elif isinstance(t, RecordType):
            for n, f in t.fields:
                yield from self._checks(f, bounds, c.Member(e, field_name(n)))
        else:
            assert isinstance(t, ArrayType)
            for k in range(t.size):
                at = c.IndexExpr(c.Member(e, "at"), c.Number(str(k)))
                yield from self._checks(t.element, bounds, at)

    def _stored(
        self, on: c.CExpr, path: str, t: Type, e: c.CExpr, *, canonical: bool
    ) -> Iterator[c.CStmt]:
        """Values on their way into the states."""
        stored = scalar(t)
        if stored is not None:
            if canonical and isinstance(t, FloatType):
                e = c.CallExpr("soter_lane_canonical", (e,))
            if isinstance(t, FloatType):
                yield c.Do(c.CallExpr("SOTER_LANE_PUT", (on, c.Name(path), e)))
                return
            whole = c.Unary("-", e) if isinstance(t, BoolType) else e
            parts = (on, c.Name(path), whole, c.Name(stored.c_type))
            yield c.Do(c.CallExpr("SOTER_LANE_PUT_INT", parts))
        elif isinstance(t, RecordType):
            for n, f in t.fields:
                own_field = field_name(n)
                yield from self._stored(
                    on, f"{path}.{own_field}", f, c.Member(e, own_field), canonical=canonical
                )
        else:
            assert isinstance(t, ArrayType)
            for k in range(t.size):
                at = c.IndexExpr(c.Member(e, "at"), c.Number(str(k)))
                yield from self._stored(on, f"{path}.at[{k}]", t.element, at, canonical=canonical)

    def _published(self, *, gated: bool) -> Iterator[c.CStmt]:
        """Publications (n1: only if OE), and which there were."""
        told: c.CExpr = c.Number(f"{sum(1 << k for k in self.always)}U")
        for k in range(len(self.step.outputs)):
            has = self.has(k)
            if has is not None:
                one = c.Ternary(_not_zero(c.IndexExpr(has, LANE)), c.Number(f"{1 << k}U"), ZERO)
                told = c.Binary("|", told, one)
        body = (c.Assign(c.IndexExpr(c.Name("published"), LANE), told),)
        yield c.For(LANE.text, c.Number("0"), c.Name("SOTER_LANES"), body)
        gate = c.Name("given_gate")
        if gated:
            yield c.Declare(BOOL, gate.text, self.enabled())
        else:
            yield c.Unused("flags")
        for k, o in enumerate(self.step.outputs):
            if not self.lanes.has_lanes(o.type):
                continue
            has = self.has(k)
            where: list[c.CExpr] = [*([gate] if gated else []), *([] if has is None else [has])]
            on: c.CExpr = where[0] if where else c.Name("soter_lane_always")
            if len(where) > 1:
                on = c.Binary("&", *where)
            topic = f"topics.{self.lanes.frame.topic_field(o.topic)}"
            yield from self._stored(on, topic, o.type, c.Name(self.outputs[k]), canonical=False)
            stamp = c.Name(f"stamps[{o.topic}]")
            now = c.CallExpr("soter_lane_all_int", (CT,))
            yield c.Do(c.CallExpr("SOTER_LANE_PUT_INT", (on, stamp, now, c.Name("int64_t"))))


def _not_zero(e: c.CExpr) -> c.CExpr:
    return c.Binary("!=", e, c.Number("0"))

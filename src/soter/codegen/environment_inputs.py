"""Functions of a generated program through which the environment sets topics.

Purpose: what `publish` and `draw` of the kernel's tables are: a value from outside, checked before
anything reads it, and a drawn one, which goes the same way.
Non-goals: when inputs change (drivers).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.c import tree as c
from soter.codegen.c.types import int_number
from soter.codegen.extern_results import received, to_ends
from soter.codegen.function_context import CT, OK, S
from soter.codegen.random_draws import DRAW_PARAMETERS, assemble, in_order, uniform, whom
from soter.language.model.types import BoolType, EnumType, FloatType, IntType, leaves

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.codegen.function_context import Frame
    from soter.language.model.system import Bound, InputDrive, System, Topic
    from soter.language.model.types import Type

VALUE, TIME, STATUS = c.Name("value"), c.Name("time"), c.Name("status")
PUBLISH_PARAMETERS = (("void *", "state"), ("const void *", "given"), ("int64_t", "time"))


class InputEmitter:
    """Emits the setters and the draws of one system."""

    def __init__(self, system: System, frame: Frame) -> None:
        self.system = system
        self.frame = frame
        self.types = frame.types

    def setter(self, topic: int) -> str:
        """The function through which a topic takes a value of the environment's."""
        return f"{self.frame.prefix}_publish_{topic}"

    def publish(self, topic: Topic) -> c.FunctionDef:
        """Stores a value that is of the topic's type and set; refuses any other."""
        stored = self.types.stored(topic.type)
        stamp = c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(topic.index)))
        size = c.CallExpr("sizeof", (VALUE,))
        copied = c.CallExpr("memcpy", (c.Unary("&", VALUE), c.Name("given"), size))
        body = (
            self.frame.state_pointer(),
            *self.frame.fault_pointer(),
            c.Unused("fault"),
            c.Declare(stored, VALUE.text, None),
            c.Do(c.Cast("void", copied)),
            *received(topic.type, VALUE),
            *to_ends(topic.type, topic.bounds, VALUE),
            *self.types.check(topic.type, topic.bounds, VALUE),
            c.IfStmt(c.Binary("!=", STATUS, OK), (c.Return(STATUS),)),
            c.Assign(self.frame.topic(topic.index), VALUE),
            c.Assign(stamp, TIME),
            *self.frame.push_on(topic.index),
            c.Return(OK),
        )
        doc = f"{topic.name}, from the environment"
        return c.FunctionDef("soter_fault", self.setter(topic.index), PUBLISH_PARAMETERS, body, doc)

    def draw(self, drive: InputDrive, name: str) -> c.FunctionDef:
        """A change of an environment input, by chance or as a driver answers."""
        info = self.system.topics[drive.topic]
        index = c.Binary("/", CT, int_number(drive.every_ns))
        stream = f"input.{info.name}"
        before: Sequence[c.CStmt]
        if drive.values:
            before, value = self._one_of(drive, stream, index)
        else:
            drawn = [
                self._leaf(t, bound, ".".join((stream, *path)), index)
                for (path, t), bound in zip(leaves(info.type), info.bounds, strict=True)
            ]
            before, values = in_order(drawn, "drawn")
            value = assemble(self.types, info.type, iter(values))
        given = (S, c.Unary("&", VALUE), CT)
        body = (
            self.frame.state_pointer(),
            *before,
            c.Declare(self.types.stored(info.type), VALUE.text, value, const=True),
            c.Do(c.Cast("void", c.CallExpr(self.setter(drive.topic), given))),
            c.Unused("answer"),
        )
        return c.FunctionDef("void", name, DRAW_PARAMETERS, body, f"environment input {info.name}")

    def _one_of(
        self, drive: InputDrive, stream: str, index: c.CExpr
    ) -> tuple[list[c.CStmt], c.CExpr]:
        """One of the declared values of an input."""
        t = self.system.topics[drive.topic].type
        last = len(drive.values) - 1
        pick = c.CallExpr(
            "soter_drawn_int", (*whom(stream), index, int_number(0), int_number(last))
        )
        name = c.Name("drawn_pick")
        value = self.types.constant(t, drive.values[last], "value")
        for k in range(last - 1, -1, -1):
            this = self.types.constant(t, drive.values[k], "value")
            value = c.Ternary(c.Binary("==", name, c.Number(str(k))), this, value)
        declared = c.Declare("int64_t", name.text, pick, const=True)
        return [declared, c.Unused(name.text)], self.types.to_store(t, value)

    def _leaf(
        self, t: Type, bound: Bound | None, stream: str, index: c.CExpr
    ) -> tuple[str, c.CExpr]:
        """One leaf of an input: its C type, and the draw."""
        if isinstance(t, FloatType):
            assert bound is not None
            return "double", uniform(stream, index, bound.low, bound.high)
        if isinstance(t, BoolType):
            drawn = c.CallExpr("soter_drawn_bool", (*whom(stream), index))
            return "uint8_t", c.Cast("uint8_t", drawn)
        if isinstance(t, EnumType):
            low, high = 0, len(t.members) - 1
        else:
            assert isinstance(t, IntType)
            low, high = (int(bound.low), int(bound.high)) if bound else (t.low, t.high)
        limits = (int_number(low), int_number(high))
        drawn = c.CallExpr("soter_drawn_int", (*whom(stream), index, *limits))
        return self.types.stored(t), self.types.to_store(t, drawn)

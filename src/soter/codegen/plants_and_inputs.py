"""Plants and inputs in generated C: steps of plants, topics set from outside, draws.

Purpose: the step function of a plant (disturbances, integration, measurement errors), and the
functions `publish` and `draw` of the kernel's tables. `publish` checks a value from outside before
anything reads it; `draw` draws a value and hands it to `publish`.
Non-goals: integration itself (`core/plants.py`), when inputs change (drivers).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.body import BranchChoices, stream_key
from soter.codegen.c_names import field_name
from soter.codegen.c_types import float_number, int_number
from soter.codegen.externs import clean_answer, move_to_ends
from soter.codegen.faults import disturb_outputs, leaf_place, scaled_draw
from soter.codegen.state_access import (
    CT,
    HEADER,
    OK,
    STEP_PARAMETERS,
    S,
    flag_is_set,
    place_text,
    stamp_place,
)
from soter.core import core
from soter.core.core_walks import walk
from soter.language.model.types import (
    BOOL,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.codegen.c_types import TypeTable
    from soter.codegen.state_access import Frame
    from soter.language.model.system import Bound, Component, InputDrive, System, Topic
    from soter.language.model.types import Type


DRAW_PARAMETERS = (("void *", "state"), ("const void *", "answer"))


def draw_arguments(stream: str) -> tuple[c.CExpr, ...]:
    """The first arguments, in C, of a draw that a driver may answer."""
    return (HEADER, c.Name("answer"), stream_key(stream))


def uniform_draw(
    stream: str, index: c.CExpr, low: float, high: float, *, chance: bool = False
) -> c.CExpr:
    """The C that draws a float from [low, high]; a driver may answer it unless `chance`."""
    bounds = (float_number(low), float_number(high))
    if chance:
        return c.CallExpr("soter_draw", (HEADER, stream_key(stream), index, *bounds))
    return c.CallExpr("soter_drawn", (*draw_arguments(stream), index, *bounds))


def declare_draws(
    drawn: list[tuple[str, c.CExpr]], name: str
) -> tuple[list[c.CStmt], list[c.CExpr]]:
    """Declares draws one after the other, as C may evaluate an initializer in any order."""
    if len(drawn) == 1:
        return [], [drawn[0][1]]
    names = [f"{name}_{k}" for k in range(len(drawn))]
    before: list[c.CStmt] = [
        c.Declare(t, n, e, const=True) for n, (t, e) in zip(names, drawn, strict=True)
    ]
    return before, [c.Name(n) for n in names]


def assemble(types: TypeTable, t: Type, values: object) -> c.CExpr:
    """The C of a value of type `t`; `values`: an iterator over the C of its leaves, in order."""
    if isinstance(t, RecordType):
        return c.Initializer(
            tuple((field_name(n), assemble(types, f, values)) for n, f in t.fields),
            types.stored_type(t),
        )
    if isinstance(t, ArrayType):
        items = c.Initializer(
            tuple((None, assemble(types, t.element, values)) for _ in range(t.size))
        )
        return c.Initializer((("at", items),), types.stored_type(t))
    value = next(values)  # type: ignore[call-overload]
    assert isinstance(value, c.CExpr)
    return value


def declare_choices(component: Component, statements: tuple[core.Stmt, ...]) -> list[c.CStmt]:
    """Declares the variables by which choices are drawn: their count, the release's number."""
    if not any(isinstance(n, core.Choose) for n in walk(statements)):
        return []
    since = c.Binary("-", CT, int_number(component.phase_ns)) if component.phase_ns else CT
    release = c.Binary("/", since, int_number(component.period_ns))
    return [
        c.Declare("uint32_t", "made", c.Number("0U")),
        c.Declare("int64_t", "release", release, const=True),
    ]


VALUE, TIME, STATUS = c.Name("value"), c.Name("time"), c.Name("status")
PUBLISH_PARAMETERS = (("void *", "state"), ("const void *", "given"), ("int64_t", "time"))


class InputEmitter:
    """Emits the C function that sets each topic from outside, and the one that draws each input."""

    def __init__(self, system: System, frame: Frame) -> None:
        self.system = system
        self.frame = frame
        self.types = frame.types

    def setter_name(self, topic: int) -> str:
        """The name of the C function that sets a topic from outside."""
        return f"{self.frame.prefix}_publish_{topic}"

    def publish_function(self, topic: Topic) -> c.FunctionDef:
        """The C function that stores a value in a topic, if its type and set allow the value."""
        stored = self.types.stored_type(topic.type)
        stamp = stamp_place(topic.index)
        size = c.CallExpr("sizeof", (VALUE,))
        copied = c.CallExpr("memcpy", (c.Unary("&", VALUE), c.Name("given"), size))
        body = (
            self.frame.state_pointer(),
            *self.frame.fault_pointer(),
            c.Unused("fault"),
            c.Declare(stored, VALUE.text, None),
            c.Do(c.Cast("void", copied)),
            *clean_answer(topic.type, VALUE),
            *move_to_ends(topic.type, topic.bounds, VALUE),
            *self.types.check_value(topic.type, topic.bounds, VALUE),
            c.IfStmt(c.Binary("!=", STATUS, OK), (c.Return(STATUS),)),
            c.Assign(self.frame.topic_place(topic.index), VALUE),
            c.Assign(stamp, TIME),
            *self.frame.push_to_queues(topic.index),
            c.Return(OK),
        )
        doc = f"{topic.name}, from the environment"
        return c.FunctionDef(
            "soter_fault", self.setter_name(topic.index), PUBLISH_PARAMETERS, body, doc
        )

    def draw_function(self, drive: InputDrive, name: str) -> c.FunctionDef:
        """The C function that changes an input, at random or to the value a driver answers."""
        info = self.system.topics[drive.topic]
        index = c.Binary("/", CT, int_number(drive.every_ns))
        stream = f"input.{info.name}"
        before: Sequence[c.CStmt]
        if drive.values:
            before, value = self._draw_value(drive, stream, index)
        else:
            drawn = [
                self._draw_leaf(t, bound, ".".join((stream, *path)), index)
                for (path, t), bound in zip(leaves(info.type), info.bounds, strict=True)
            ]
            before, values = declare_draws(drawn, "drawn")
            value = assemble(self.types, info.type, iter(values))
        arguments = (S, c.Unary("&", VALUE), CT)
        body = (
            self.frame.state_pointer(),
            *before,
            c.Declare(self.types.stored_type(info.type), VALUE.text, value, const=True),
            c.Do(c.Cast("void", c.CallExpr(self.setter_name(drive.topic), arguments))),
            c.Unused("answer"),
        )
        return c.FunctionDef("void", name, DRAW_PARAMETERS, body, f"environment input {info.name}")

    def _draw_value(
        self, drive: InputDrive, stream: str, index: c.CExpr
    ) -> tuple[list[c.CStmt], c.CExpr]:
        """Statements and C expression that draw one of the declared values of an input."""
        t = self.system.topics[drive.topic].type
        last = len(drive.values) - 1
        pick = c.CallExpr(
            "soter_drawn_int", (*draw_arguments(stream), index, int_number(0), int_number(last))
        )
        name = c.Name("drawn_pick")
        value = self.types.constant(t, drive.values[last], "value")
        for k in range(last - 1, -1, -1):
            this = self.types.constant(t, drive.values[k], "value")
            value = c.Ternary(c.Binary("==", name, c.Number(str(k))), this, value)
        declared = c.Declare("int64_t", name.text, pick, const=True)
        return [declared, c.Unused(name.text)], self.types.as_stored(t, value)

    def _draw_leaf(
        self, t: Type, bound: Bound | None, stream: str, index: c.CExpr
    ) -> tuple[str, c.CExpr]:
        """The C type of one leaf of an input, and the C that draws it."""
        if isinstance(t, FloatType):
            assert bound is not None
            return "double", uniform_draw(stream, index, bound.low, bound.high)
        if isinstance(t, BoolType):
            drawn = c.CallExpr("soter_drawn_bool", (*draw_arguments(stream), index))
            return "uint8_t", c.Cast("uint8_t", drawn)
        if isinstance(t, EnumType):
            low, high = 0, len(t.members) - 1
        else:
            assert isinstance(t, IntType)
            low, high = (int(bound.low), int(bound.high)) if bound else (t.low, t.high)
        limits = (int_number(low), int_number(high))
        drawn = c.CallExpr("soter_drawn_int", (*draw_arguments(stream), index, *limits))
        return self.types.stored_type(t), self.types.as_stored(t, drawn)


def plant_step_function(
    frame: Frame, component: Component, step: core.PlantStep, name: str
) -> c.FunctionDef:
    """The C function of one release of a plant."""
    once = core.If(step.span, core.Const(BOOL, True), step.integrate, ())
    task = frame.body_to_plan((*step.choose, once, *step.publish), step.states)
    with frame.body.plan_body(None if step.extern else task, frame.sure_outputs(component, step)):
        body = tuple(_step_statements(frame, component, step, name))
    assert component.plant is not None
    doc = f"plant {component.plant.name}, {place_text(step.span)}"
    return c.FunctionDef("soter_fault", f"{name}_step", STEP_PARAMETERS, body, doc)


def _step_statements(
    frame: Frame, component: Component, step: core.PlantStep, name: str
) -> list[c.CStmt]:
    first = c.Name("first")
    is_first = c.Declare("bool", "first", flag_is_set("SOTER_FIRST"), const=True)
    code = (*step.choose, *step.integrate, *step.publish)
    used = frame.body.names_used(code)
    frame.body.choices = BranchChoices(component.name, chance=step.extern)
    body = frame.load_locals(step.states, used)
    body += _draw_disturbances(frame, component, step, used)
    body += frame.declare_outputs(step.outputs)
    body += declare_choices(component, code)
    body += frame.body.translate_block(step.choose, step.integrate, step.publish)
    if step.extern:
        body += _take_new_states(frame, step, name)
    elif step.integrate:
        inner = frame.body.translate_block(step.integrate, step.publish)
        body.append(c.IfStmt(c.Unary("!", first), tuple(inner)))
    body += frame.body.translate_block(step.publish)
    body += _add_noise(frame, component, step)
    body += disturb_outputs(frame, component, step.outputs)
    body += frame.check_outputs(step.outputs)
    unused = [c.Unused(n) for n in ("s", "flags", "answer", "published", "first")]
    body = [frame.state_pointer(), is_first, *unused, *frame.checked_code(body)]
    body += frame.store_locals(step.states)
    body += frame.publish_outputs(step.outputs, gated=False)
    body.append(c.Return(OK))
    frame.body.choices = None
    return body


def _draw_disturbances(
    frame: Frame, component: Component, step: core.PlantStep, used: set[str]
) -> list[c.CStmt]:
    if not any(n in used for n, _, _ in step.disturbances):
        return []
    began = c.Ternary(
        c.Name("first"), c.Number("0"), c.Binary("-", CT, int_number(component.period_ns))
    )
    statements: list[c.CStmt] = [c.Declare("int64_t", "began", began, const=True)]
    for number, (name, t, draws) in enumerate(step.disturbances):
        if name in used:
            chance = [_disturbance_draw(d, component, c.Name("began")) for d in draws]
            drawn = [scaled_draw(frame, component, number, e) for e in chance]
            c_name = frame.body.c_name(name)
            before, values = declare_draws([("double", e) for e in drawn], f"drawn_{c_name}")
            value = assemble(frame.types, t, iter(values))
            statements += [*before, c.Declare(frame.types.work_type(t), c_name, value, const=True)]
    return statements


def _disturbance_draw(draw: core.Draw, component: Component, at: c.CExpr) -> c.CExpr:
    """The C of a draw; no driver answers it if the value is held or the plant is extern."""
    hold = draw.hold_ns if draw.hold_ns > 0 else component.period_ns
    index = c.Binary("/", at, int_number(hold))
    chance = draw.hold_ns > 0 or component.extern
    return uniform_draw(draw.stream, index, draw.low, draw.high, chance=chance)


def _take_new_states(frame: Frame, step: core.PlantStep, name: str) -> list[c.CStmt]:
    """Takes the new states of an extern plant from the driver's answer, if the driver answers."""
    got = c.Name("got")
    statements: list[c.CStmt] = [c.Declare(f"const {name}_out *const ", "got", c.Name("answer"))]
    assigns = tuple(
        c.Assign(c.Name(frame.body.c_name(x.name)), c.Arrow(got, field_name(x.cell.name)))
        for x in step.states
    )
    statements.append(c.IfStmt(c.Binary("!=", got, c.Name("NULL")), assigns))
    return statements


def _add_noise(frame: Frame, component: Component, step: core.PlantStep) -> list[c.CStmt]:
    """Adds a drawn measurement error to each output leaf that has one."""
    statements: list[c.CStmt] = []
    index = c.Binary("/", CT, int_number(component.period_ns))
    for output, leaf, draw in step.noise:
        target = leaf_place(frame.body.output_place(output), step.outputs[output].type, leaf)
        error = uniform_draw(draw.stream, index, draw.low, draw.high, chance=component.extern)
        statements.append(c.Assign(target, c.Binary("+", target, error)))
    return statements

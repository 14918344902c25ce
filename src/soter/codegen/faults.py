"""Faults of a run, in generated C.

Purpose: the tables of a system's faults, and functions that move releases, change publications and
disturbances, and choose which node steps next (they share `runtime/soter_faults.h`).
Non-goals: which faults a system has (`language/elaborate/faults.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.body import stream_key
from soter.codegen.c_names import field_name
from soter.codegen.c_types import float_number, int_number
from soter.codegen.state_access import CT, HEADER
from soter.language.model.types import ArrayType, FloatType, RecordType, leaves

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.codegen.state_access import Frame
    from soter.core import core
    from soter.language.model.system import Bound, Component, Fault, System
    from soter.language.model.types import Type

LEAVES = 256
"""How many indices of the stream of amounts belong to one slot, or to one step."""
ORDERS = 64
"""How many indices of the stream of orders belong to one instant (`semantics/faults.py`)."""
SLOT, TIME = c.Name("slot"), c.Name("t")


def fault_names(system: System) -> list[str]:
    """The names of the fault tables of a system, without the program's prefix."""
    numbers = range(len(system.faults))
    return [f"fault_{i}" for i in numbers] + [f"lateness_{i}" for i in numbers]


# ---------------------------------------------------------------- tables and times


def fault_definitions(frame: Frame, names: Mapping[int, str]) -> list[c.CTop]:
    """The tables of faults, and the functions about time and order that the kernel calls."""
    declarations: list[c.CTop] = []
    for i, f in enumerate(frame.system.faults):
        if f.on is not None:
            continue
        fields = (
            *((n, stream_key(f"{f.stream}{end}")) for n, end in _STREAMS),
            ("slot_ns", int_number(f.slot_ns)),
            ("probability", float_number(f.probability)),
            ("apart", c.Name("true" if f.apart else "false")),
        )
        declarations.append(c.VariableDef("soter_chance", _chance(frame, i), c.Initializer(fields)))
        if _is_unslotted_lateness(f):
            times = c.Initializer(tuple((None, int_number(int(x))) for x in f.amount))
            declarations.append(c.VariableDef("int64_t", _lateness(frame, i), times, array=True))
    moved = sorted({f.component for f in frame.system.faults if f.changes_releases})
    declarations += [
        _release_time_function(frame, frame.system.components[k], names) for k in moved
    ]
    lasting = sorted({f.component for f in frame.system.faults if f.kind == "overrun"})
    declarations += [
        _overrun_function(frame, frame.system.components[k], names[k]) for k in lasting
    ]
    return [*declarations, *([_order_function(frame)] if frame.system.shuffled else [])]


_STREAMS = (("stream", ""), ("at", ".at"), ("by", ".by"))


def _chance(frame: Frame, number: int) -> str:
    return f"{frame.prefix}_fault_{number}"


def _lateness(frame: Frame, number: int) -> str:
    return f"{frame.prefix}_lateness_{number}"


def _is_unslotted_lateness(f: Fault) -> bool:
    return f.kind == "late" and f.slot_ns == 0


def _fault_call(frame: Frame, number: int, function: str, *more: c.CExpr) -> c.CExpr:
    return c.CallExpr(function, (HEADER, c.Unary("&", c.Name(_chance(frame, number))), *more))


def _release_time_function(
    frame: Frame, component: Component, names: Mapping[int, str]
) -> c.FunctionDef:
    """The C function that gives the time of a component's release; SOTER_NEVER if it is lost."""
    nominal, release = c.Name("nominal"), c.Name("release")
    period = int_number(component.period_ns)
    since = c.Binary("*", release, period)
    if component.phase_ns:
        since = c.Binary("+", int_number(component.phase_ns), since)
    lost = c.Return(c.Name("SOTER_NEVER"))
    every = c.Name("SOTER_ON_TIME")
    last = c.Binary("-", every, c.Number("1"))
    on_time = c.Binary("==", c.Binary("%", release, every), last)
    faults = [(i, f) for i, f in enumerate(frame.system.faults) if f.changes_releases]
    faults = [(i, f) for i, f in faults if f.component == component.index]
    body: list[c.CStmt] = [
        *([frame.state_pointer(const=True)] if any(f.on is None for _, f in faults) else []),
        c.Declare("int64_t", "nominal", since, const=True),
        c.Declare("int64_t", "t", nominal),
        c.IfStmt(on_time, (c.Return(nominal),)),
    ]
    for i, f in faults:
        if f.on is not None:
            body += _wait_statements(frame.system.components[f.on], names[f.on])
        elif f.kind == "skip":
            active = _fault_call(frame, i, "soter_fault_active", nominal, period)
            body.append(c.IfStmt(active, (lost,)))
        elif _is_unslotted_lateness(f):
            times = (c.Name(_lateness(frame, i)), c.Number(f"{len(f.amount)}U"))
            late = _fault_call(frame, i, "soter_fault_late", *times, release)
            body.append(c.Assign(TIME, c.Binary("+", TIME, late)))
        else:
            body.append(c.Assign(TIME, _fault_call(frame, i, "soter_fault_held", TIME, period)))
    too_late = c.Binary(">=", TIME, c.Binary("+", nominal, period))
    moved = c.Binary("&&", c.Binary("!=", TIME, nominal), too_late)
    body += [c.IfStmt(moved, (lost,)), c.Return(TIME)]
    doc = f"when a release of {component.name} happens"
    parameters = (("const void *", "state"), ("int64_t", "release"))
    name = f"{names[component.index]}_happens"
    return c.FunctionDef("int64_t", name, parameters, tuple(body), doc)


def _wait_statements(other: Component, name: str) -> list[c.CStmt]:
    """Delays `t` until the last release of `other` that is nominally no later than this release."""
    phase, period, since = int_number(other.phase_ns), int_number(other.period_ns), c.Name("since")
    happens = c.CallExpr(f"{name}_happens", (c.Name("state"), c.Binary("/", since, period)))
    since_then = c.Binary(">=", since, c.Number("0"))
    waited = c.Name("waited")
    later = c.IfStmt(c.Binary(">", waited, TIME), (c.Assign(TIME, waited),))
    return [
        c.Declare("int64_t", "since", c.Binary("-", c.Name("nominal"), phase), const=True),
        c.IfStmt(since_then, (c.Declare("int64_t", "waited", happens, const=True), later)),
    ]


def _overrun_function(frame: Frame, component: Component, name: str) -> c.FunctionDef:
    """The C function that gives by how many ns a step that begins now takes longer."""
    longer, period = c.Name("longer"), int_number(component.period_ns)
    body: list[c.CStmt] = [
        frame.state_pointer(const=True),
        c.Declare("int64_t", "longer", c.Number("0")),
    ]
    for i, f in enumerate(frame.system.faults):
        if f.component == component.index and f.kind == "overrun":
            more = c.Assign(longer, c.Binary("+", longer, int_number(int(f.amount[0]))))
            active = _fault_call(frame, i, "soter_fault_active", CT, period)
            body.append(c.IfStmt(active, (more,)))
    body.append(c.Return(longer))
    doc = f"how much longer a step of {component.name} lasts"
    return c.FunctionDef(
        "int64_t", f"{name}_overrun", (("const void *", "state"),), tuple(body), doc
    )


def _order_function(frame: Frame) -> c.FunctionDef:
    """The C function that draws which of `waiting` nodes steps next."""
    waiting = c.Name("waiting")
    first = c.Binary("*", c.Cast("uint64_t", CT), c.Number(f"{ORDERS}U"))
    index = c.Binary("+", first, c.Binary("%", waiting, c.Number(f"{ORDERS}U")))
    arguments = (HEADER, stream_key("fault.order"), c.Cast("int64_t", index))
    body = (
        frame.state_pointer(const=True),
        c.Return(c.Cast("uint32_t", c.Binary("%", c.CallExpr("soter_bits", arguments), waiting))),
    )
    parameters = (("const void *", "state"), ("uint32_t", "waiting"))
    doc = "which of the nodes that wait steps next"
    return c.FunctionDef("uint32_t", f"{frame.prefix}_order", parameters, body, doc)


# ---------------------------------------------------------------- values


def disturb_outputs(
    frame: Frame, component: Component, outputs: tuple[core.Output, ...]
) -> list[c.CStmt]:
    """The C that changes outputs just before publication, by the faults of the component."""
    statements: list[c.CStmt] = []
    places = {o.topic: k for k, o in enumerate(outputs)}
    period = int_number(component.period_ns)
    for i, f in enumerate(frame.system.faults):
        if f.component != component.index or f.topic not in places or f.topic is None:
            continue
        k = places[f.topic]
        active = _fault_call(frame, i, "soter_fault_active", CT, period)
        changes: list[c.CStmt]
        if f.kind == "silent":
            changes = [c.Assign(frame.body.flag_of(k), c.Name("false"))]
            if component.plant is not None:  # a sensor speaks at its first release
                active = c.Binary("&&", active, c.Unary("!", c.Name("first")))
        else:
            slot = _fault_call(frame, i, "soter_fault_slot", CT, period)
            changes = [c.Declare("int64_t", "slot", slot, const=True), c.Unused("slot")]
            bounds = frame.system.topics[f.topic].bounds
            kinds = [t for _, t in leaves(outputs[k].type)]
            for leaf in f.leaves:
                target = leaf_place(frame.body.output_place(k), outputs[k].type, leaf)
                now = leaf_place(frame.topic_place(f.topic), outputs[k].type, leaf)
                is_float, bound = isinstance(kinds[leaf], FloatType), bounds[leaf]
                new = _faulty_leaf(frame, (i, leaf), f, (target, now), bound, is_float=is_float)
                changes.append(c.Assign(target, new))
                if component.plant is not None and bound is not None and is_float:
                    changes.append(c.Assign(target, _clipped(target, bound)))
        applies = (
            active if k in frame.body.certain else c.Binary("&&", frame.body.flag_of(k), active)
        )
        statements.append(c.IfStmt(applies, tuple(changes)))
    return statements


def _faulty_leaf(
    frame: Frame,
    fault_and_leaf: tuple[int, int],
    f: Fault,
    values: tuple[c.CExpr, c.CExpr],
    bound: Bound | None,
    *,
    is_float: bool,
) -> c.CExpr:
    """The C of a leaf's new value; `values`: the C of the output's, and of the topic's so far."""
    i, leaf = fault_and_leaf
    old, now = values
    if f.kind == "stuck":
        return now
    if f.kind == "nan":
        return float_number(float("nan"))
    slot = c.Binary("*", CT if f.kind == "noise" else SLOT, c.Number(str(LEAVES)))
    index = c.Binary("+", slot, c.Number(str(leaf % LEAVES)))
    if f.kind == "saturated":
        assert bound is not None
        ends = [
            float_number(x) if is_float else int_number(int(x)) for x in (bound.high, bound.low)
        ]
        return c.Ternary(_fault_call(frame, i, "soter_fault_high", index), *ends)
    (x,) = f.amount
    if f.kind == "scale":
        return c.Binary("*", old, float_number(x))
    by = _fault_call(frame, i, "soter_fault_by", index, float_number(abs(x)))
    return c.Binary("+", old, by)


def _clipped(target: c.CExpr, bound: Bound) -> c.CExpr:
    inner = c.CallExpr("soter_min", (float_number(bound.high), target))
    return c.CallExpr("soter_max", (float_number(bound.low), inner))


def scaled_draw(frame: Frame, component: Component, disturbance: int, drawn: c.CExpr) -> c.CExpr:
    """A drawn leaf of a disturbance, multiplied by the factors of all active faults."""
    by: c.CExpr | None = None
    period = int_number(component.period_ns)
    for i, f in enumerate(frame.system.faults):
        if f.component == component.index and f.disturbance == disturbance:
            active = _fault_call(frame, i, "soter_fault_active", CT, period)
            one = c.Ternary(active, float_number(f.amount[0]), float_number(1.0))
            by = one if by is None else c.Binary("*", by, one)
    return drawn if by is None else c.Binary("*", drawn, by)


def leaf_place(e: c.CExpr, t: Type, index: int) -> c.CExpr:
    """The C place of leaf number `index` in the value `e` of type `t`."""
    if isinstance(t, RecordType):
        for n, f in t.fields:
            count = sum(1 for _ in leaves(f))
            if index < count:
                return leaf_place(c.Member(e, field_name(n)), f, index)
            index -= count
    if isinstance(t, ArrayType):
        count = sum(1 for _ in leaves(t.element))
        at = c.IndexExpr(c.Member(e, "at"), c.Number(str(index // count)))
        return leaf_place(at, t.element, index % count)
    return e

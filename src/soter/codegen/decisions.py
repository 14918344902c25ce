"""Decision modules (DM), properties and other predicates over the state, in generated C.

Purpose: the functions that stand as `decide` and `violated` in the kernel's tables.
Non-goals: when they are called (the kernel).
"""

from __future__ import annotations

from functools import partial, reduce
from math import nan
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_types import float_number, int_number
from soter.codegen.state_access import CT, OK, S, place_text, stamp_place
from soter.codegen.storage_plan import PlannedBody
from soter.core import core
from soter.language.model.read_together import allowed_stamp_differences
from soter.language.model.typed import TypedUnary

if TYPE_CHECKING:
    from soter.codegen.state_access import Frame
    from soter.language.model.system import Module, System


def switch_function(frame: Frame) -> c.FunctionDef:
    """The C function of the switching logic, over facts; `verify/deploy/dm_check.py` tries all."""
    ac, sc = c.Name("SOTER_AC"), c.Name("SOTER_SC")
    ttf, stale, safer = c.Name("ttf"), c.Name("stale"), c.Name("safer")
    unsafe = c.Binary("||", c.Binary("||", ttf, stale), c.Name("gate_fault"))
    fine = c.Binary("&&", c.Binary("&&", safer, c.Unary("!", stale)), c.Name("clean"))
    parameters = (
        ("soter_mode", "mode"),
        *(("bool", n) for n in ("stale", "ttf", "safer", "gate_fault", "clean")),
    )
    body = (
        c.IfStmt(c.Binary("==", c.Name("mode"), ac), (c.Return(c.Ternary(unsafe, sc, ac)),)),
        c.Return(c.Ternary(fine, ac, sc)),
    )
    doc = "the mode after a DM step: the switching logic of the paper"
    return c.FunctionDef("soter_mode", f"{frame.prefix}_switch", parameters, body, doc)


def decision_functions(frame: Frame, decision: core.Decision, name: str) -> list[c.FunctionDef]:
    """The C functions of a decision module: `ttf`, `safer` and `decide`."""
    module = frame.system.modules[decision.module]
    made = [
        predicate_function(
            frame, good, f"{name}_good_{k}", f"plan {k} of {module.name}", unsafe=False
        )
        for k, good in enumerate(decision.goods)
    ]
    if not made:
        doc = f"ttf of {module.name}"
        made.append(predicate_function(frame, decision.ttf, f"{name}_ttf", doc, unsafe=True))
    if not _is_ttf_not_safer(module):
        doc = f"safer of {module.name}"
        made.append(predicate_function(frame, decision.safer, f"{name}_safer", doc, unsafe=False))
    m = c.Name("m")
    module_state = c.IndexExpr(c.Arrow(S, "modules"), c.Number(str(module.index)))
    set_fact = [
        c.Assign(c.Arrow(m, n), c.Ternary(c.Name(n), c.Number("1U"), c.Number("0U")))
        for n in ("stale", "ttf", "safer")
    ]
    gate_fault = c.Binary("!=", c.Arrow(m, "gate_fault"), c.Number("0U"))
    clean = c.Binary("==", c.Arrow(m, "clean_needed"), c.Number("0U"))
    mode = c.Cast("soter_mode", c.Arrow(m, "mode"))
    names = ("stale", "ttf", "safer", "gate_fault", "clean")
    facts = (mode, *(c.Name(n) for n in names))
    body: list[c.CStmt] = [
        frame.state_pointer(),
        c.Declare("soter_module *const ", "m", c.Unary("&", module_state)),
        c.Declare("bool", "stale", _stale_condition(frame.system, module), const=True),
        *_compute_predicates(frame, decision, name, module),
        *set_fact,
        c.Declare("bool", "gate_fault", gate_fault, const=True),
        c.Declare("bool", "clean", clean, const=True),
        *_store_look(frame, module),
        *_return_mode(frame, module, facts),
    ]
    doc = f"decision module of {module.name}, {place_text(module.symbol.span)}"
    made.append(
        c.FunctionDef("soter_mode", f"{name}_decide", (("void *", "state"),), tuple(body), doc)
    )
    return made


def _stale_condition(system: System, module: Module) -> c.CExpr:
    """The C condition that an input is too old, or that two inputs are too far apart in time."""

    def is_later_by(one: c.CExpr, other: c.CExpr, most: int) -> c.CExpr:
        return c.Binary(">", c.Binary("-", one, other), int_number(most))

    stamps = {i: stamp_place(i) for i in module.inputs}
    ages = {i: system.topics[i].max_age_ns for i in module.inputs}
    stale = [is_later_by(CT, stamps[i], age) for i, age in ages.items() if age is not None]
    for i, j, most in allowed_stamp_differences(system, module.inputs):
        apart = [is_later_by(stamps[a], stamps[b], most) for a, b in ((i, j), (j, i))]
        stale += apart if most else [c.Binary("!=", stamps[i], stamps[j])]
    return reduce(partial(c.Binary, "||"), stale) if stale else c.Name("false")


def _is_ttf_not_safer(module: Module) -> bool:
    """Whether `ttf` is `!safer`; C then computes only one of the two, as both may be slow."""
    ttf, safer = module.symbol.ttf, module.symbol.safer
    return isinstance(ttf, TypedUnary) and ttf.op == "!" and ttf.operand is safer


def _compute_predicates(
    frame: Frame, decision: core.Decision, name: str, module: Module
) -> list[c.CStmt]:
    """Computes `ttf` and `safer`; `nan_looks` counts the steps in which either met a NaN."""
    opposite = _is_ttf_not_safer(module)
    parts = [("ttf", decision.ttf), ("safer", decision.safer)][: 1 if opposite else 2]
    if decision.goods:
        parts = [(f"good_{k}", p) for k, p in enumerate(decision.goods)]
    nan = [n for n, p in parts if p.maybe_nan]

    def predicate_call(n: str) -> c.CExpr:
        more = (c.Unary("&", c.Name("nan_seen")),) if n in nan else ()
        return c.CallExpr(f"{name}_{n}", (c.Name("state"), *more))

    body: list[c.CStmt] = [c.Declare("bool", "nan_seen", c.Name("false"))] if nan else []
    if decision.goods:
        body += _find_good_plan(frame, module, [predicate_call(n) for n, _ in parts])
    else:
        body += [c.Declare("bool", n, predicate_call(n), const=True) for n, _ in parts]
    if opposite:
        body.append(c.Declare("bool", "safer", c.Unary("!", c.Name("ttf")), const=True))
    if nan:
        looks = c.Arrow(c.Name("m"), "nan_looks")
        counts = c.Binary("&&", c.Name("nan_seen"), c.Binary("<", looks, c.Name("UINT16_MAX")))
        more_looks = c.Cast("uint16_t", c.Binary("+", looks, c.Number("1U")))
        body.append(c.IfStmt(counts, (c.Assign(looks, more_looks),)))
    return body


def _find_good_plan(frame: Frame, module: Module, calls: list[c.CExpr]) -> list[c.CStmt]:
    """Tries the plan of the last verdict, then others, until a call is true; else `ttf` is true."""
    assert module.plan is not None
    last, plan, ttf = c.Name("last"), c.Name("plan"), c.Name("ttf")
    numbers = [int_number(k) for k in range(len(calls))]
    body: list[c.CStmt] = [
        c.Declare("int64_t", "last", frame.topic_place(module.plan), const=True),
        c.Declare("int64_t", "plan", last),
        c.Declare("bool", "ttf", c.Name("true")),
    ]
    for op, every in (("==", "the plan of the last verdict AC"), ("!=", "every other one")):
        body.append(c.Comment(every))
        for number, good in zip(numbers, calls, strict=True):
            due = c.Binary("&&", ttf, c.Binary(op, last, number))
            found = c.Assign(ttf, c.Unary("!", good)), c.Assign(plan, number)
            body.append(c.IfStmt(due, found))
    return body


def _store_plan(frame: Frame, module: Module) -> list[c.CStmt]:
    """Stores the plan that was found good, if the DM gives control to AC."""
    if module.plan is None or not module.goods or module.forced is not None:
        return []
    to_ac = c.Binary("==", c.Name("after"), c.Name("SOTER_AC"))
    return [c.IfStmt(to_ac, (c.Assign(frame.topic_place(module.plan), c.Name("plan")),))]


def _return_mode(frame: Frame, module: Module, facts: tuple[c.CExpr, ...]) -> list[c.CStmt]:
    """Returns the mode after the step, and updates a latch, which may keep SC in control."""
    switch = f"{frame.prefix}_switch"
    chosen = _store_plan(frame, module)
    if module.latch is None and not chosen:
        return [c.Return(c.CallExpr(switch, facts))]
    after = c.Name("after")
    if module.latch is None:
        decided = c.Declare("soter_mode", "after", c.CallExpr(switch, facts), const=True)
        return [decided, *chosen, c.Return(after)]
    latch = frame.topic_place(module.latch)
    stamps = c.Arrow(S, "stamps")
    since = c.IndexExpr(stamps, c.Number(str(module.latch)))
    before, zero = facts[0], c.Number("0")
    in_sc = c.Binary("==", before, c.Name("SOTER_SC"))
    if module.acknowledgement is None:
        lets: c.CExpr = c.Binary("==", latch, zero)
        remembered = [c.Assign(latch, c.Number("1"))]
    else:
        max_age = frame.system.topics[module.acknowledgement].max_age_ns
        assert max_age is not None, "M028"
        stamp = c.IndexExpr(stamps, c.Number(str(module.acknowledgement)))
        pressed = frame.topic_place(module.acknowledgement)
        arguments = (c.Unary("&", latch), c.Unary("&", since), pressed, stamp, CT)
        lets = c.CallExpr("soter_acknowledged", (*arguments, int_number(max_age)))
        to_ac = c.Binary("==", after, c.Name("SOTER_AC"))
        remembered = [
            c.Assign(latch, zero),
            c.Assign(since, c.Ternary(to_ac, c.Name("SOTER_NEVER"), CT)),
        ]
    facts = (*facts[:-1], c.Binary("&&", facts[-1], c.Name("returns")))
    return [
        c.Declare("bool", "returns", c.Name("true")),
        c.IfStmt(in_sc, (c.Assign(c.Name("returns"), lets),)),
        c.Declare("soter_mode", "after", c.CallExpr(switch, facts), const=True),
        c.IfStmt(c.Binary("!=", after, before), tuple(remembered)),
        *chosen,
        c.Return(after),
    ]


def _store_look(frame: Frame, module: Module) -> list[c.CStmt]:
    """Stores the values that `margin` is computed from: looks left, and the time of this step."""
    if module.looked is None:
        return []
    unsafe: c.CExpr = c.Name("ttf")
    for name in ("stale", "gate_fault"):
        unsafe = c.Binary("||", unsafe, c.Name(name))
    left = c.Ternary(c.Name("safer"), int_number(module.looks), int_number(1))
    stamp = stamp_place(module.looked)
    looks = c.Ternary(unsafe, int_number(0), left)
    return [c.Assign(frame.topic_place(module.looked), looks), c.Assign(stamp, CT)]


def predicate_function(
    frame: Frame, p: core.Predicate, name: str, doc: str, *, unsafe: bool, negate: bool = False
) -> c.FunctionDef:
    """The C function of a predicate over the state; it returns `unsafe` after a fault."""
    failed = c.Name("true" if unsafe else "false")
    return _state_function(frame, p, name, doc, ("bool", failed), negate=negate)


def number_function(frame: Frame, p: core.Predicate, name: str, doc: str) -> c.FunctionDef:
    """The C function of a float over the state; it returns NaN after a fault."""
    return _state_function(frame, p, name, doc, ("double", float_number(nan)))


def _state_function(
    frame: Frame,
    p: core.Predicate,
    name: str,
    doc: str,
    result_and_default: tuple[str, c.CExpr],
    *,
    negate: bool = False,
) -> c.FunctionDef:
    result, otherwise = result_and_default
    body: list[c.CStmt] = [frame.state_pointer(const=True), c.Unused("s")]
    parameters = (("const void *", "state"), *((("bool *", "nan_seen"),) if p.maybe_nan else ()))
    faults = p.body and any(
        isinstance(x, (core.Checked, core.Guard, core.Call, core.If, core.Loop)) for x in p.body
    )
    if faults:
        body += [*frame.fault_pointer(), c.Unused("fault")]
    task = PlannedBody(code=p.body, is_large=frame.types.is_large, result=p.value)
    with frame.body.plan_body(task):
        body += frame.body.translate_block(p.body, p.value)
        value = frame.body.expr(p.value)
    if faults:
        failed = c.Binary("!=", c.Name("status"), OK)
        body.append(c.IfStmt(failed, (*_note_nan(p), c.Return(otherwise))))
    body.append(c.Return(c.Unary("!", value) if negate else value))
    return c.FunctionDef(result, name, parameters, tuple(body), f"{doc}, {place_text(p.span)}")


def _note_nan(p: core.Predicate) -> list[c.CStmt]:
    """Sets `nan_seen` after a NONFINITE fault, which in a predicate only a compared NaN raises."""
    if not p.maybe_nan:
        return []
    was = c.Binary("==", c.Name("status"), c.Name("SOTER_NONFINITE"))
    return [c.IfStmt(was, (c.Assign(c.Unary("*", c.Name("nan_seen")), c.Name("true")),))]

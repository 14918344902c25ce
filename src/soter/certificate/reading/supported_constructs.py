"""What the re-checker understands of a program: a positive list.

Purpose: `require_supported`: every construct of SC, module, plants and the functions they call is
on the list, with every field that it has; whatever is not, is not rechecked. A construct or field
that is added to the language is refused until somebody puts it here.
Non-goals: what the constructs mean (`symbolic_reading.py`, `problem.py`); AC, of which nothing is
assumed but what the gate enforces.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

from soter.certificate.extras import extras
from soter.certificate.report import FOLLOWED, NotRecheckedError
from soter.language.model import system as model
from soter.language.model import typed as t

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.certificate.reading.module_facts import Facts
    from soter.language.model.system import Component

_EXPR = "type span"
CODE: dict[type, str] = {
    t.Literal: f"{_EXPR} value name",
    t.ParamRead: f"{_EXPR} param",
    t.VarRead: f"{_EXPR} variable",
    t.TopicRead: f"{_EXPR} topic",
    t.PeriodRead: _EXPR,
    t.ModeRead: f"{_EXPR} module",
    t.TypedUnary: f"{_EXPR} op operand",
    t.TypedBinary: f"{_EXPR} op left right",
    t.Vector: f"{_EXPR} op left right",
    t.Conditional: f"{_EXPR} condition then otherwise",
    t.TypedCall: f"{_EXPR} fun arguments",
    t.Builtin: f"{_EXPR} name arguments",
    t.TypedField: f"{_EXPR} target index",
    t.Index: f"{_EXPR} target index",
    t.TypedLength: f"{_EXPR} target",
    t.Aggregate: f"{_EXPR} elements order",
    t.Narrow: f"{_EXPR} operand",
    t.Place: "variable path type span",
    t.TypedDeclare: "span variable value",
    t.TypedAssign: "span place value",
    t.TypedPublish: "span topic value limit",
    t.TypedReturn: "span value",
    t.Assert: "span condition message",
    t.TypedIf: "span arms otherwise",
    t.ForRange: "span variable low high body",
    t.ForEach: "span variable sequence body",
    t.FunSymbol: "name span parameters result body extern source prelude",
    t.Variable: "name type kind span used",
}
"""Expressions, statements and functions, each with its fields.

Not on it: `in_control` (SC steps while it is not in control, too), `time`, `age`, `truth`,
`choose`, `push`. `mode` is that of another module, and stands in SC, `ttf` and `safer` alone
(`sc_locals_and_modes.py`).
"""
DECLARATIONS: dict[type, str] = {
    t.NodeSymbol: "name span period phase extern source subscribes publishes failsafe locals "
    "initial assumes guarantees takeover step bursts takes wcet jitter",
    t.Subscribed: "topic queue policy span",
    t.TopicSymbol: "name span type input values default max_age static",
    t.ModuleSymbol: "name span ac sc period safe safer ttf clean verify topics_read ac_span "
    "sc_span contract failsafe wcet jitter latch shield toward_sc candidates rest plans plan",
    t.Latch: "topic span",
    t.RestSymbol: "condition moves within span",
    t.RestMove: "topic path by way span",
    t.TypedVerifyBlock: "groups abstracts commands core horizon levels late_dm late_sc response_dm "
    "response_sc acts_least acts recover stays late_of response_of dropout age views induction "
    "lemmas progress enters span",
    t.ViewSymbol: "name block span",
    t.AbstractionLink: "instance name plant value span",
    t.TypedAxisGroup: "axes span",
    t.TypedGridAxis: "topic path low high cells span instance plant open unbounded",
    t.PlantSymbol: "name span period extern source reads drives states initial initial_range "
    "disturbances lets der next method substeps measured truth read_spans",
    t.DisturbanceSymbol: "variable low high hold",
    t.MeasuredSymbol: "topic path within span",
}
"""What they are declared with; each field is read by this room, judged below, or without effect on
a state: names, spans, hints (`core`, `commands`), and what only a simulator does (`method`,
`substeps`, `hold`: an assumption)."""
ELABORATED: dict[type, str] = {
    model.Topic: "index name symbol type bounds set_declared default max_age_ns driver queue_of "
    "policy queues held",
    model.Scope: "topics params plants modules",
    model.Disturbance: "variable low high hold_ns streams",
    model.Measurement: "topic leaf bound stream",
    model.Component: "index name role period_ns phase_ns scope span module node plant initial "
    "initial_range failsafe disturbances measured substeps binding stands_for takes_ns held "
    "wcet_ns jitter_ns inline",
    model.Shield: "cells topic held permits proposed moved",
    model.Module: "index name symbol dm ac sc period_ns scope clean inputs outputs forced around "
    "view whole law late_ns levels computed grid_ends unshown looks looked latch "
    "acknowledgement shield plan goods",
}
"""What instances of these are in a system whose modules, instances and parameters are resolved."""
ROLES = ("plant", "dm", "sc", "ac", "node")


def require_supported(facts: Facts, *, followed: bool = False) -> None:
    """Raises NotRecheckedError for an unlisted construct; with `followed`, `rest` is listed."""
    for declared in (*CODE, *DECLARATIONS, *ELABORATED):
        _require_known_fields(declared)
    module = facts.flying_module
    if facts.symbol.rest is not None and not followed:
        raise NotRecheckedError(FOLLOWED)
    if module.forced is not None:
        raise NotRecheckedError(
            f"`{module.name}` is forced to {module.forced}: its DM never decides"
        )
    assert facts.sc.node is not None
    _require_supported_sc(facts.sc.node, followed=followed)
    if facts.reads_any_mode:
        extras.sc_locals_and_modes.require_modes_of_others(facts)
    _require_unshared_topics(facts)
    rest = () if facts.symbol.rest is None else (facts.symbol.rest.condition,)
    for expr in (*facts.symbol.predicates, *rest):
        read = facts.ttf if expr is facts.symbol.ttf else expr
        _require_known_code(read, "the predicates of the module")
    for c in facts.plants:
        _require_known_plant(c)
    _require_known_components(facts)


def _require_known_components(facts: Facts) -> None:
    for c in facts.flying.components:
        if c.plant and any(isinstance(x, t.TypedChoose) for x in code_parts(plant_code(c.plant))):
            raise NotRecheckedError(f"the plant `{c.name}` chooses")
        if c.role not in ROLES:
            raise NotRecheckedError(f"`{c.name}` is a {c.role}, which is not known here")


def _require_known_fields(declared: type) -> None:
    known = {**CODE, **DECLARATIONS, **ELABORATED}.get(declared)
    field_names = {f.name for f in fields(declared)} if is_dataclass(declared) else set()
    if known is None or field_names - set(known.split()):
        name = declared.__name__.removeprefix("Typed")
        raise NotRecheckedError(f"`{name}` is not known here as this language has it")


# ---------------------------------------------------------------- declarations


def _require_supported_sc(sc: t.NodeSymbol, *, followed: bool = False) -> None:
    """Raises NotRecheckedError unless SC only makes its step, from parts that are on the list."""
    if sc.extern:
        raise NotRecheckedError("SC is not Soter source: nothing is known about its commands")
    if sc.takeover and not followed:
        raise NotRecheckedError("an SC with `on takeover` is not rechecked yet")
    for subscribed in sc.subscribes:
        if subscribed.queue is not None:
            raise NotRecheckedError(f"SC has a queue of `{subscribed.topic.name}`")
    if sc.bursts:
        raise NotRecheckedError("SC publishes several messages a step")
    for s in (*(sc.takeover or ()), *sc.step):
        _require_known_code(s, "SC")


def _require_unshared_topics(facts: Facts) -> None:
    """Raises NotRecheckedError if others publish the module's outputs or SC reads a queue."""
    outputs = set(facts.flying_module.outputs)
    controllers = facts.controllers
    for c in (c for c in facts.flying.components if c not in controllers):
        written = [t for t, _ in c.plant.drives] if c.plant else c.node.publishes if c.node else ()
        for topic in written:
            if c.scope.topics[topic] in outputs:
                raise NotRecheckedError(f"`{topic.name}` is not published by the module alone")
    if outputs & {drawn.topic for drawn in facts.flying.inputs}:
        raise NotRecheckedError("an output of the module is drawn as an input, too")
    component = facts.flying.components[facts.flying_module.sc]
    for index in component.scope.topics.values():
        if facts.flying.topics[index].queue_of is not None:
            raise NotRecheckedError(f"`{facts.flying.topics[index].name}` is a queue")


def _require_known_plant(c: Component) -> None:
    assert c.plant is not None
    if c.plant.extern:
        raise NotRecheckedError(f"the plant `{c.name}` is extern")
    if c.phase_ns != 0:
        raise NotRecheckedError(f"the plant `{c.name}` does not publish at the start")
    for root in plant_code(c.plant):
        _require_known_code(root, f"the plant `{c.name}`")


def plant_code(plant: t.PlantSymbol) -> list[object]:
    """All expressions of a plant."""
    pairs = (*plant.drives, *plant.lets, *plant.der.items(), *plant.next.items())
    return [expr for _, expr in pairs]


# ---------------------------------------------------------------- code


def _require_known_code(root: object, where: str) -> None:
    """Raises NotRecheckedError unless code and functions it calls have only parts on the list."""
    for part in code_parts([root]):
        if type(part) not in CODE:
            name = _WORDS.get(type(part), type(part).__name__.removeprefix("Typed").lower())
            raise NotRecheckedError(f"`{name}` in {where} is not rechecked yet")
        if isinstance(part, t.FunSymbol) and (part.extern or part.body is None):
            raise NotRecheckedError(f"`{part.name}` is an extern function: its values are unknown")


def code_parts(roots: list[object]) -> Iterator[object]:
    """Yields each piece of code, its parts, and the functions that it calls, without types."""
    seen: set[int] = set()
    todo = list(roots)
    while todo:
        part = todo.pop()
        if id(part) in seen:
            continue
        seen.add(id(part))
        yield part
        names = [f.name for f in fields(part) if f.name not in ("type", "span")]  # type: ignore[arg-type]  # dataclasses
        stack: list[Any] = [getattr(part, name) for name in names]
        while stack:
            v = stack.pop()
            if isinstance(v, tuple) and not isinstance(part, t.Literal):
                stack.extend(v)
            elif isinstance(v, (t.TypedExpr, t.TypedStmt, t.Place, t.FunSymbol)):
                todo.append(v)


_WORDS: dict[type, str] = {
    t.InControl: "in_control",
    t.TimeRead: "time",
    t.AgeRead: "age",
    t.TruthRead: "truth",
    t.TypedChoose: "choose",
    t.TypedPush: "push",
}

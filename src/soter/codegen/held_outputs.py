"""The outputs of a step that takes time, in generated C.

Purpose: they are held in a topic of their own until they take effect; one function publishes them,
another exchanges them with the values of the topics.
Non-goals: when they take effect (the kernel); steps that take no time (`nodes.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_names import field_name
from soter.codegen.state_access import CT, S, flag_is_set, stamp_place

if TYPE_CHECKING:
    from soter.codegen.state_access import Frame
    from soter.core import core
    from soter.language.model.system import Component

PARAMETERS = (("void *", "state"),)


def hold_outputs(
    frame: Frame, component: Component, outputs: tuple[core.Output, ...]
) -> list[c.CStmt]:
    """Stores a step's outputs in `held`; the kernel draws when they take effect."""
    statements: list[c.CStmt] = [_empty_held_topic(frame, component)]
    published = c.Unary("*", c.Name("published"))
    for k, output in enumerate(outputs):
        note = c.Assign(published, c.Binary("|", published, c.Number(f"{1 << k}U")))
        keep = (
            c.Assign(_held_field(frame, component, "has", k), c.Number("1")),
            c.Assign(_held_field(frame, component, "at", k), CT),
            c.Assign(
                _held_field(frame, component, "out", k),
                frame.types.as_stored(output.type, frame.body.output_place(k)),
            ),
        )
        stores = c.IfStmt(flag_is_set("SOTER_ENABLED"), keep)
        statements += frame.code_if_published(k, [note, stores])
    return statements


def effect_function(
    frame: Frame, component: Component, outputs: tuple[core.Output, ...], name: str
) -> c.FunctionDef:
    """The C function that publishes held outputs, if OE is set, and empties `held`."""
    assert component.held is not None
    component_state = c.IndexExpr(c.Arrow(S, "components"), c.Number(str(component.index)))
    stores = [
        c.IfStmt(
            _is_held_condition(frame, component, k),
            (
                c.Assign(frame.topic_place(output.topic), _held_field(frame, component, "out", k)),
                c.Assign(stamp_place(output.topic), CT),
                *frame.push_to_queues(output.topic),
            ),
        )
        for k, output in enumerate(outputs)
    ]
    body = (
        frame.state_pointer(),
        c.IfStmt(c.Binary("!=", c.Member(component_state, "oe"), c.Number("0U")), tuple(stores)),
        _empty_held_topic(frame, component),
        c.Assign(stamp_place(component.held), c.Name("SOTER_NEVER")),
    )
    doc = f"what {component.name} held takes effect"
    return c.FunctionDef("void", f"{name}_effect", PARAMETERS, body, doc)


def exchange_function(
    frame: Frame, component: Component, outputs: tuple[core.Output, ...], name: str
) -> c.FunctionDef:
    """The C function that exchanges held values and stamps with those of the topics."""
    body: list[c.CStmt] = [frame.state_pointer()]
    for k, output in enumerate(outputs):
        pairs = (
            (frame.types.stored_type(output.type), "value", frame.topic_place(output.topic), "out"),
            ("int64_t", "stamp", stamp_place(output.topic), "at"),
        )
        swaps: list[c.CStmt] = []
        for type_, kept, topic, part in pairs:
            held = _held_field(frame, component, part, k)
            swaps.append(c.Declare(type_, kept, topic, const=True))
            swaps += [c.Assign(topic, held), c.Assign(held, c.Name(kept))]
        body.append(c.IfStmt(_is_held_condition(frame, component, k), tuple(swaps)))
    doc = f"what {component.name} holds and what the topics have change places"
    return c.FunctionDef("void", f"{name}_exchange", PARAMETERS, tuple(body), doc)


def _empty_held_topic(frame: Frame, component: Component) -> c.CStmt:
    assert component.held is not None
    t = frame.system.topics[component.held].type
    return c.Assign(frame.topic_place(component.held), frame.types.default_constant(t))


def _held_field(frame: Frame, component: Component, purpose: str, k: int) -> c.CExpr:
    assert component.held is not None
    return c.Member(frame.topic_place(component.held), field_name(f"{purpose}_{k}"))


def _is_held_condition(frame: Frame, component: Component, k: int) -> c.CExpr:
    return c.Binary("!=", _held_field(frame, component, "has", k), c.Number("0U"))

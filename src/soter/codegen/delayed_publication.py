"""Steps that take time, in generated C.

Purpose: what such a step publishes is held in a topic of its own
(`language/elaborate/execution_times.py`); the functions that let it take effect, and swap it with
what the topics have.
Non-goals: when that is (the kernel).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.c import tree as c
from soter.codegen.c.names import field_name
from soter.codegen.function_context import CT, S, enabled

if TYPE_CHECKING:
    from soter.codegen.function_context import Frame
    from soter.core import core
    from soter.language.model.system import Component

PARAMETERS = (("void *", "state"),)


def hold(frame: Frame, component: Component, outputs: tuple[core.Output, ...]) -> list[c.CStmt]:
    """At the end of a step: keep what it publishes; the kernel draws until when."""
    statements: list[c.CStmt] = [_nothing(frame, component)]
    published = c.Unary("*", c.Name("published"))
    for k, output in enumerate(outputs):
        note = c.Assign(published, c.Binary("|", published, c.Number(f"{1 << k}U")))
        keep = (
            c.Assign(_part(frame, component, "has", k), c.Number("1")),
            c.Assign(_part(frame, component, "at", k), CT),
            c.Assign(
                _part(frame, component, "out", k),
                frame.types.to_store(output.type, frame.body.out(k)),
            ),
        )
        stores = c.IfStmt(enabled("SOTER_ENABLED"), keep)
        statements += frame.if_published(k, [note, stores])
    return statements


def effect(
    frame: Frame, component: Component, outputs: tuple[core.Output, ...], name: str
) -> c.FunctionDef:
    """Publishes what is held, if the outputs are enabled; nothing is held then."""
    assert component.held is not None
    own = c.IndexExpr(c.Arrow(S, "components"), c.Number(str(component.index)))
    stores: list[c.CStmt] = []
    for k, output in enumerate(outputs):
        each = (
            c.Assign(frame.topic(output.topic), _part(frame, component, "out", k)),
            c.Assign(_stamp(output.topic), CT),
            *frame.push_on(output.topic),
        )
        stores.append(c.IfStmt(_is_held(frame, component, k), each))
    body = (
        frame.state_pointer(),
        c.IfStmt(c.Binary("!=", c.Member(own, "oe"), c.Number("0U")), tuple(stores)),
        _nothing(frame, component),
        c.Assign(_stamp(component.held), c.Name("SOTER_NEVER")),
    )
    doc = f"what {component.name} held takes effect"
    return c.FunctionDef("void", f"{name}_effect", PARAMETERS, body, doc)


def exchange(
    frame: Frame, component: Component, outputs: tuple[core.Output, ...], name: str
) -> c.FunctionDef:
    """Swaps what is held and what the topics have."""
    body: list[c.CStmt] = [frame.state_pointer()]
    for k, output in enumerate(outputs):
        pairs = (
            (frame.types.stored(output.type), "value", frame.topic(output.topic), "out"),
            ("int64_t", "stamp", _stamp(output.topic), "at"),
        )
        swaps: list[c.CStmt] = []
        for type_, kept, topic, part in pairs:
            held = _part(frame, component, part, k)
            swaps.append(c.Declare(type_, kept, topic, const=True))
            swaps += [c.Assign(topic, held), c.Assign(held, c.Name(kept))]
        body.append(c.IfStmt(_is_held(frame, component, k), tuple(swaps)))
    doc = f"what {component.name} holds and what the topics have change places"
    return c.FunctionDef("void", f"{name}_exchange", PARAMETERS, tuple(body), doc)


def _nothing(frame: Frame, component: Component) -> c.CStmt:
    assert component.held is not None
    t = frame.system.topics[component.held].type
    return c.Assign(frame.topic(component.held), frame.types.default(t))


def _part(frame: Frame, component: Component, what: str, k: int) -> c.CExpr:
    assert component.held is not None
    return c.Member(frame.topic(component.held), field_name(f"{what}_{k}"))


def _is_held(frame: Frame, component: Component, k: int) -> c.CExpr:
    return c.Binary("!=", _part(frame, component, "has", k), c.Number("0U"))


def _stamp(topic: int) -> c.CExpr:
    return c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(topic)))

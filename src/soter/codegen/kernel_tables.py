"""The tables of a generated program that the kernel reads, and the function for its first state.

Purpose: tables of components, modules, properties, topics and inputs; `soter_program`, which names
them; `init`, which makes the state before the first instant.
Non-goals: the functions in the tables (`nodes.py`, `plants_and_inputs.py`, `decisions.py`), the
first step of plants.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.body import stream_key
from soter.codegen.c_types import int_number
from soter.codegen.plants_and_inputs import DRAW_PARAMETERS, assemble, in_order, uniform
from soter.language.model.system import environment_topics
from soter.language.model.types import ArrayType, FloatType, RecordType, default_value, leaves

if TYPE_CHECKING:
    from soter.codegen.plants_and_inputs import InputEmitter
    from soter.codegen.state_access import Frame
    from soter.core.core import CoreSystem
    from soter.language.model.system import Component, Property
    from soter.language.model.types import Type, Value


def init(frame: Frame, name: str) -> c.FunctionDef:
    """The C function that sets topics, locals and plant states to initial or drawn values."""
    body: list[c.CStmt] = [frame.state_pointer(), c.Unused("s"), c.Unused("answer")]
    for topic in frame.system.topics:
        body += _initial(frame, frame.topic(topic.index), topic.type, topic.default)
    for component in frame.system.components:
        for i, v in enumerate(component.variables):
            target = frame.member(component.index, v.name)
            interval = component.initial_range[i] if component.initial_range else None
            if interval is None:
                body += _initial(frame, target, v.type, component.initial[i])
                continue
            base = f"{component.name}.{v.name}.start"
            draws = [
                uniform(".".join((base, *path)), c.Number("0"), *interval)
                for path, _ in leaves(v.type)
            ]
            prefix = f"drawn_{component.index}_{i}"
            before, values = in_order([("double", e) for e in draws], prefix)
            body += [*before, c.Assign(target, assemble(frame.types, v.type, iter(values)))]
    return c.FunctionDef("void", name, DRAW_PARAMETERS, tuple(body), "initial values")


def _initial(frame: Frame, target: c.CExpr, t: Type, value: Value) -> list[c.CStmt]:
    if value == default_value(t) and _is_zero(t, value):
        return []
    constant = frame.types.constant(t, value, "initial")
    return frame.types.commit(target, t, constant)


def _is_zero(t: Type, value: Value) -> bool:
    """Whether a default value is all zero bytes."""
    if isinstance(t, FloatType):
        return str(value) == "0.0"
    if isinstance(t, RecordType):
        return all(_is_zero(f, v) for (_, f), v in zip(t.fields, value, strict=True))
    if isinstance(t, ArrayType):
        return all(_is_zero(t.element, v) for v in value)
    return not value


ROLES = {
    "plant": "SOTER_ROLE_PLANT",
    "dm": "SOTER_ROLE_DM",
    "sc": "SOTER_ROLE_SC",
    "ac": "SOTER_ROLE_AC",
    "node": "SOTER_ROLE_NODE",
}


class TableEmitter:
    """Emits the tables of one system, and collects them in `found`."""

    def __init__(
        self,
        core: CoreSystem,
        frame: Frame,
        inputs: InputEmitter,
        names: dict[int, str],
        module_names: dict[int, str],
    ) -> None:
        self.system = frame.system
        self.core = core
        self.frame = frame
        self.inputs = inputs
        self.names = names
        self.module_names = module_names
        self.open_topics = environment_topics(frame.system)
        self.moved = {f.component for f in frame.system.faults if f.of_time}
        self.overrun = {f.component for f in frame.system.faults if f.kind == "overrun"}
        self.judged = {p.component for p in frame.system.properties}
        self.found: list[c.CTop] = []

    def tables(self) -> list[c.CTop]:
        """The tables, and the program that names them."""
        p, s = self.frame.prefix, self.system
        tables = (
            (
                "component",
                self._table(
                    "soter_component_info",
                    "components",
                    [self._component(x) for x in s.components],
                    "components in deployed order: plants, DMs, SCs, the rest",
                ),
            ),
            ("module", self._table("soter_module_info", "modules", self._modules(), "RTA modules")),
            (
                "property",
                self._table(
                    "soter_property_info",
                    "properties",
                    self._properties(),
                    "properties, checked on the truth at the end of every instant, and contracts",
                ),
            ),
            ("topic", self._table("soter_topic_info", "topics_info", self._topics(), "topics")),
            (
                "input",
                self._table("soter_input_info", "inputs", self._inputs(), "environment inputs"),
            ),
        )
        counted = (
            ("components", s.components),
            ("modules", s.modules),
            ("properties", s.properties),
            ("topics", s.topics),
            ("inputs", s.inputs),
        )
        program = c.Initializer(
            (
                ("name", c.String(p)),
                ("hash", c.String(s.program.sha256)),
                ("state_size", c.CallExpr("sizeof", (c.Name(f"{p}_state"),))),
                *((name, c.Number(f"{len(items)}U")) for name, items in counted),
                *tables,
                ("init", c.Name(f"{p}_init")),
                *((("order", c.Name(f"{p}_order")),) if s.shuffled else ()),
                ("self_test", c.Name("soter_computes")),
            )
        )
        self.found.append(c.VariableDef("soter_program", f"{p}_program", program, static=False))
        return self.found

    def _table(self, type_: str, name: str, rows: list[c.CExpr], comment: str) -> c.CExpr:
        if not rows:
            return c.Name("NULL")
        full_name = f"{self.frame.prefix}_{name}"
        value = c.Initializer(tuple((None, r) for r in rows))
        self.found.append(c.VariableDef(type_, full_name, value, array=True, comment=comment))
        return c.Name(full_name)

    def _component(self, x: Component) -> c.CExpr:
        name = self.names[x.index]
        step = self.core.nodes.get(x.index) or self.core.plants.get(x.index)
        outputs = len(step.outputs) if step else 0
        return c.Initializer(
            (
                ("name", c.String(x.name)),
                ("role", c.Name(ROLES[x.role])),
                ("period_ns", int_number(x.period_ns)),
                ("phase_ns", int_number(x.phase_ns)),
                ("module", c.Number(str(-1 if x.module is None else x.module))),
                ("is_extern", c.Name("true" if x.extern and not self.frame.linked(x) else "false")),
                ("judged", c.Name("true" if x.index in self.judged else "false")),
                ("outputs", c.Number(f"{(1 << outputs) - 1}U")),
                ("step", c.Name(f"{name}_step" if step else "NULL")),
                ("failsafe", c.Name(f"{name}_failsafe" if x.failsafe else "NULL")),
                *_held(x, name),
                *((("happens", c.Name(f"{name}_happens")),) if x.index in self.moved else ()),
                *((("overrun", c.Name(f"{name}_overrun")),) if x.index in self.overrun else ()),
            )
        )

    def _modules(self) -> list[c.CExpr]:
        return [
            c.Initializer(
                (
                    ("name", c.String(m.name)),
                    ("period_ns", int_number(m.period_ns)),
                    ("dm", c.Number(f"{m.dm}U")),
                    ("ac", c.Number(f"{m.ac}U")),
                    ("sc", c.Number(f"{m.sc}U")),
                    ("clean", c.Number(f"{m.clean}U")),
                    ("forced", c.Name("true" if m.forced else "false")),
                    ("start", c.Name("SOTER_AC" if m.forced == "ac" else "SOTER_SC")),
                    ("decide", c.Name(f"{self.module_names[m.index]}_decide")),
                )
            )
            for m in self.system.modules
        ]

    def _properties(self) -> list[c.CExpr]:
        return [
            c.Initializer(
                (
                    ("text", c.String(f"{q.kind} {q.text}")),
                    ("violated", c.Name(f"{self.frame.prefix}_property_{q.index}")),
                    *_when(q),
                )
            )
            for q in self.system.properties
        ]

    def _inputs(self) -> list[c.CExpr]:
        return [
            c.Initializer(
                (
                    ("every_ns", int_number(d.every_ns)),
                    ("draw", c.Name(f"{self.frame.prefix}_input_{i}")),
                )
            )
            for i, d in enumerate(self.system.inputs)
        ]

    def _topics(self) -> list[c.CExpr]:
        state = c.Name(f"{self.frame.prefix}_state")
        return [
            c.Initializer(
                (
                    ("name", c.String(t.name)),
                    (
                        "offset",
                        c.CallExpr(
                            "offsetof", (state, c.Name(f"topics.{self.frame.topic_field(t.index)}"))
                        ),
                    ),
                    ("size", c.CallExpr("sizeof", (c.Name(self.frame.types.stored(t.type)),))),
                    *(
                        (("publish", c.Name(self.inputs.setter(t.index))),)
                        if t.index in self.open_topics
                        else ()
                    ),
                )
            )
            for t in self.system.topics
        ]


def _when(p: Property) -> tuple[tuple[str, c.CExpr], ...]:
    """The table fields of a contract: before or after whose step it is checked; else none."""
    if p.component is None:
        return ()
    when = "SOTER_BEFORE_STEP" if p.kind == "assumes" else "SOTER_AFTER_STEP"
    return (("when", c.Name(when)), ("component", c.Number(f"{p.component}U")))


def _held(x: Component, name: str) -> tuple[tuple[str, c.CExpr], ...]:
    """The table fields of a node whose steps take time; other nodes have none of them."""
    if x.held is None:
        return ()
    least, most = x.takes_ns or (0, 0)
    return (
        ("least_ns", int_number(least)),
        ("most_ns", int_number(most)),
        ("stream", stream_key(f"{x.name}.takes")),
        ("held", c.Number(f"{x.held}U")),
        ("effect", c.Name(f"{name}_effect")),
        ("exchange", c.Name(f"{name}_exchange")),
    )

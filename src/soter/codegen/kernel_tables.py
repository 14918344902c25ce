"""The tables of a generated program that the kernel reads, and the function for its first state.

Purpose: tables of components, modules, properties, topics and inputs; `soter_program`, which names
the tables; `init`, which makes the state before the first instant.
Non-goals: the functions in the tables (`nodes.py`, `plants_and_inputs.py`, `decisions.py`), the
first step of plants.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.body import stream_key
from soter.codegen.c_types import int_number
from soter.codegen.plants_and_inputs import DRAW_PARAMETERS, assemble, declare_draws, uniform_draw
from soter.language.model.system import environment_topics
from soter.language.model.types import ArrayType, FloatType, RecordType, default_value, leaves

if TYPE_CHECKING:
    from soter.codegen.plants_and_inputs import InputEmitter
    from soter.codegen.state_access import Frame
    from soter.core.core import CoreSystem
    from soter.language.model.system import Component, Property
    from soter.language.model.types import Type, Value


def init_function(frame: Frame, name: str) -> c.FunctionDef:
    """The C function that sets topics, locals and plant states to initial or drawn values."""
    body: list[c.CStmt] = [frame.state_pointer(), c.Unused("s"), c.Unused("answer")]
    for topic in frame.system.topics:
        body += _set_initial(frame, frame.topic_place(topic.index), topic.type, topic.default)
    for component in frame.system.components:
        for i, v in enumerate(component.variables):
            target = frame.member_place(component.index, v.name)
            interval = component.initial_range[i] if component.initial_range else None
            if interval is None:
                body += _set_initial(frame, target, v.type, component.initial[i])
                continue
            base = f"{component.name}.{v.name}.start"
            draws = [
                uniform_draw(".".join((base, *path)), c.Number("0"), *interval)
                for path, _ in leaves(v.type)
            ]
            prefix = f"drawn_{component.index}_{i}"
            before, values = declare_draws([("double", e) for e in draws], prefix)
            body += [*before, c.Assign(target, assemble(frame.types, v.type, iter(values)))]
    return c.FunctionDef("void", name, DRAW_PARAMETERS, tuple(body), "initial values")


def _set_initial(frame: Frame, target: c.CExpr, t: Type, value: Value) -> list[c.CStmt]:
    if value == default_value(t) and _is_all_zero(t, value):
        return []
    constant = frame.types.constant(t, value, "initial")
    return frame.types.commit_value(target, t, constant)


def _is_all_zero(t: Type, value: Value) -> bool:
    """Whether all bytes of a default value are zero."""
    if isinstance(t, FloatType):
        return str(value) == "0.0"
    if isinstance(t, RecordType):
        return all(_is_all_zero(f, v) for (_, f), v in zip(t.fields, value, strict=True))
    if isinstance(t, ArrayType):
        return all(_is_all_zero(t.element, v) for v in value)
    return not value


class TableEmitter:
    """Emits the tables of one system, and collects them in `tables`."""

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
        self.moved = {f.component for f in frame.system.faults if f.changes_releases}
        self.overrun = {f.component for f in frame.system.faults if f.kind == "overrun"}
        self.judged = {p.component for p in frame.system.properties}
        self.tables: list[c.CTop] = []

    def table_definitions(self) -> list[c.CTop]:
        """The definitions of the tables, and of the `soter_program` that names them."""
        p, s = self.frame.prefix, self.system
        rows = (
            (
                "component",
                "components",
                [self._component_row(x) for x in s.components],
                "components in deployed order: plants, DMs, SCs, the rest",
            ),
            ("module", "modules", self._module_rows(), "RTA modules"),
            (
                "property",
                "properties",
                self._property_rows(),
                "properties, checked on the truth at the end of every instant, and contracts",
            ),
            ("topic", "topics_info", self._topic_rows(), "topics"),
            ("input", "inputs", self._input_rows(), "environment inputs"),
        )
        tables = {row[0]: self._add_table(f"soter_{row[0]}_info", *row[1:]) for row in rows}
        counted = ("components", "modules", "properties", "topics", "inputs")
        program = c.named_fields(
            name=c.String(p),
            hash=c.String(s.program.sha256),
            state_size=c.CallExpr("sizeof", (c.Name(f"{p}_state"),)),
            **{name: c.Number(f"{len(getattr(s, name))}U") for name in counted},
            **tables,
            init=c.Name(f"{p}_init"),
            **({"order": c.Name(f"{p}_order")} if s.shuffled else {}),
            self_test=c.Name("soter_computes"),
        )
        self.tables.append(c.VariableDef("soter_program", f"{p}_program", program, static=False))
        return self.tables

    def _add_table(self, type_: str, name: str, rows: list[c.CExpr], comment: str) -> c.CExpr:
        if not rows:
            return c.Name("NULL")
        full_name = f"{self.frame.prefix}_{name}"
        value = c.Initializer(tuple((None, r) for r in rows))
        self.tables.append(c.VariableDef(type_, full_name, value, array=True, comment=comment))
        return c.Name(full_name)

    def _component_row(self, x: Component) -> c.CExpr:
        name = self.names[x.index]
        step = self.core.nodes.get(x.index) or self.core.plants.get(x.index)
        outputs = len(step.outputs) if step else 0
        return c.named_fields(
            name=c.String(x.name),
            role=c.Name(f"SOTER_ROLE_{x.role.upper()}"),
            period_ns=int_number(x.period_ns),
            phase_ns=int_number(x.phase_ns),
            module=c.Number(str(-1 if x.module is None else x.module)),
            is_extern=c.Name("true" if x.extern and not self.frame.is_linked(x) else "false"),
            judged=c.Name("true" if x.index in self.judged else "false"),
            outputs=c.Number(f"{(1 << outputs) - 1}U"),
            step=c.Name(f"{name}_step" if step else "NULL"),
            failsafe=c.Name(f"{name}_failsafe" if x.failsafe else "NULL"),
            **_held_fields(x, name),
            **({"happens": c.Name(f"{name}_happens")} if x.index in self.moved else {}),
            **({"overrun": c.Name(f"{name}_overrun")} if x.index in self.overrun else {}),
        )

    def _module_rows(self) -> list[c.CExpr]:
        return [
            c.named_fields(
                name=c.String(m.name),
                period_ns=int_number(m.period_ns),
                dm=c.Number(f"{m.dm}U"),
                ac=c.Number(f"{m.ac}U"),
                sc=c.Number(f"{m.sc}U"),
                clean=c.Number(f"{m.clean}U"),
                forced=c.Name("true" if m.forced else "false"),
                start=c.Name("SOTER_AC" if m.forced == "ac" else "SOTER_SC"),
                decide=c.Name(f"{self.module_names[m.index]}_decide"),
            )
            for m in self.system.modules
        ]

    def _property_rows(self) -> list[c.CExpr]:
        return [
            c.named_fields(
                text=c.String(f"{q.kind} {q.text}"),
                violated=c.Name(f"{self.frame.prefix}_property_{q.index}"),
                **_contract_fields(q),
            )
            for q in self.system.properties
        ]

    def _input_rows(self) -> list[c.CExpr]:
        return [
            c.named_fields(
                every_ns=int_number(d.every_ns),
                draw=c.Name(f"{self.frame.prefix}_input_{i}"),
            )
            for i, d in enumerate(self.system.inputs)
        ]

    def _topic_rows(self) -> list[c.CExpr]:
        state = c.Name(f"{self.frame.prefix}_state")
        return [
            c.named_fields(
                name=c.String(t.name),
                offset=c.CallExpr(
                    "offsetof", (state, c.Name(f"topics.{self.frame.topic_field(t.index)}"))
                ),
                size=c.CallExpr("sizeof", (c.Name(self.frame.types.stored_type(t.type)),)),
                **(
                    {"publish": c.Name(self.inputs.setter_name(t.index))}
                    if t.index in self.open_topics
                    else {}
                ),
            )
            for t in self.system.topics
        ]


def _contract_fields(p: Property) -> dict[str, c.CExpr]:
    """The fields that say in a contract's table row when it is judged; {} for other properties."""
    if p.component is None:
        return {}
    when = "SOTER_BEFORE_STEP" if p.kind == "assumes" else "SOTER_AFTER_STEP"
    return {"when": c.Name(when), "component": c.Number(f"{p.component}U")}


def _held_fields(x: Component, name: str) -> dict[str, c.CExpr]:
    """The fields in the table row of a node whose steps take time; none for other nodes."""
    if x.held is None:
        return {}
    least, most = x.takes_ns or (0, 0)
    return {
        "least_ns": int_number(least),
        "most_ns": int_number(most),
        "stream": stream_key(f"{x.name}.takes"),
        "held": c.Number(f"{x.held}U"),
        "effect": c.Name(f"{name}_effect"),
        "exchange": c.Name(f"{name}_exchange"),
    }

"""One generated program: a header and a source file.

Purpose: the state struct, the tables of topics, components and modules, and every function, in
the order in which a person would read them.
Non-goals: build files and drivers (`targets/`), compiling (`native/`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.body import Body
from soter.codegen.c_printer import print_file
from soter.codegen.names import FileNames, Unique, field_name, program_prefix
from soter.codegen.received import received
from soter.codegen.steps import StepEmitter, where
from soter.codegen.types import TypeTable, int_number
from soter.lower.layout import Struct, arrange, state_layout
from soter.lower.steps import lower
from soter.program.types import BOOL

if TYPE_CHECKING:
    from soter.codegen.body import Branch
    from soter.lower.core import CoreSystem, Function
    from soter.lower.layout import StateLayout
    from soter.program.system import Component, Property, System
    from soter.program.types import Type

COMPONENT_NAMES = ("_step", "_failsafe", "_in", "_out", "_local", "_state", "_move")
MODULE_NAMES = ("_ttf", "_safer", "_decide")
OWN_NAMES = (
    "state", "topics", "program", "init", "components", "modules", "properties", "topics_info",
    "inputs", "layout_is_as_declared", "switch",
)  # fmt: skip
ROLES = {
    "plant": "SOTER_ROLE_PLANT",
    "dm": "SOTER_ROLE_DM",
    "sc": "SOTER_ROLE_SC",
    "ac": "SOTER_ROLE_AC",
    "node": "SOTER_ROLE_NODE",
}


@dataclass(frozen=True)
class Unit:
    """Generated text and what a driver must know about it."""

    prefix: str
    header: str
    source: str
    layout: StateLayout
    answers: dict[int, Struct]
    """Extern component -> layout of its answer struct."""
    c_sources: tuple[str, ...]
    """C files that externs are bound to."""
    names: dict[int, str]
    """Component -> what its C names begin with (`cart_c`: `cart_c_step`, `cart_c_out`)."""
    branches: tuple[Branch, ...] = ()
    """What the numbers of `soter_branch` mean, where they were asked for."""


def answer_fields(component: Component) -> tuple[tuple[str, Type], ...]:
    """Fields of the struct in which a driver answers an extern step."""
    if component.plant is not None:
        return tuple((v.name, v.type) for v in component.plant.states)
    assert component.node is not None
    short = [(t.name.rsplit(".", 1)[-1], t.type) for t in component.node.publishes]
    return (*short, *((f"has_{n}", BOOL) for n, _ in short))


def own_names(system: System) -> tuple[str, ...]:
    """What every generated file declares, whatever the program calls its own things."""
    properties = [f"property_{p.index}" for p in system.properties]
    inputs = [f"input_{i}" for i in range(len(system.inputs))]
    pushed = [f"pushed_{t.index}" for t in system.topics if t.queues]
    return (*OWN_NAMES, *properties, *inputs, *pushed)


def generate(
    system: System,
    core: CoreSystem | None = None,
    prefix: str | None = None,
    *,
    branches: bool = False,
) -> Unit:
    """The C of a system. With `branches` its nodes tell which of their branches they take."""
    builder = UnitBuilder(system, core or lower(system), prefix)
    builder.steps.branches = [] if branches else None
    return builder.run()


class UnitBuilder:
    """Builds the unit of one system."""

    def __init__(self, system: System, core: CoreSystem, prefix: str | None) -> None:
        self.system = system
        self.core = core
        stem = PurePath(system.program.path).stem or "program"
        self.prefix = prefix or program_prefix(stem)
        self.layout = state_layout(system)
        unique = FileNames(self.prefix, own_names(system))
        self.types = TypeTable(unique)
        self.names = {x.index: unique.family(x.name, COMPONENT_NAMES) for x in system.components}
        self.module_names = {m.index: unique.family(m.name, MODULE_NAMES) for m in system.modules}
        members = Unique(frozenset({"header", "components", "modules", "properties", "stamps"}))
        members("topics")
        self.groups = {g.owner: members(g.name) for g in self.layout.groups if g.owner >= 0}
        self.functions = {f.name: (unique(f"{f.name}_fn"), f.can_fault) for f in core.functions}
        self.body = Body(
            self.types,
            self.functions,
            lambda cell: self.steps.cell(cell),  # noqa: PLW0108 - steps comes next
        )
        self.steps = StepEmitter(system, self.types, self.body, self.prefix, self.groups)
        self.c_sources: list[str] = []

    def run(self) -> Unit:
        """The header, the source and what a driver must know."""
        for topic in self.system.topics:
            self.types.stored(topic.type)  # declared names first: equal records share a struct
        functions = [self._function(f) for f in self.core.functions]
        steps = self._steps()
        init = self.steps.init(f"{self.prefix}_init")
        tables = self._tables()
        more = self.more()
        interface = self._interface()
        state = self._state()
        path, hash_ = self.system.program.path, self.system.program.sha256
        about = (
            f"{self.prefix}: system {self.system.name}, from {PurePath(path).name}",
            f"generated by soter; program {hash_}",
        )
        header = c.CFile(
            (
                c.FileComment(about),
                c.Guarded(f"SOTER_PROGRAM_{self.prefix.upper()}_H"),
                c.Include("soter.h"),
                c.Section("types"),
                *self.types.definitions,
                c.Section("state: everything that changes"),
                *state,
                *interface,
                c.Section("program"),
                c.VariableDef("soter_program", f"{self.prefix}_program", None),
            )
        )
        state_type = f"{self.prefix}_state"
        size_check = c.FunctionDef(
            "void",
            f"{self.prefix}_layout_is_as_declared",
            (),
            (
                c.Do(
                    c.Cast(
                        "void",
                        c.CallExpr(
                            "sizeof",
                            (c.Name(f"char[sizeof({state_type}) == {self.layout.size} ? 1 : -1]"),),
                        ),
                    )
                ),
            ),
            "fails to compile where a compiler would pad the state differently",
            inline=True,
        )
        source = c.CFile(
            (
                c.FileComment(about),
                c.Include(f"{self.prefix}.h"),
                *((c.Include("string.h", system=True),) if self.c_sources else ()),
                size_check,
                *((c.Section("constants"), *self.types.constants) if self.types.constants else ()),
                *((c.Section("helpers"), *self.types.helpers) if self.types.helpers else ()),
                *((c.Section("functions"), *functions) if functions else ()),
                c.Section("steps"),
                *steps,
                init,
                c.Section("tables"),
                *tables,
                *more,
            )
        )
        answers = {x.index: arrange(answer_fields(x)) for x in self.system.components if x.extern}
        return Unit(
            self.prefix,
            print_file(header),
            print_file(source),
            self.layout,
            answers,
            tuple(dict.fromkeys(self.c_sources)),
            dict(self.names),
            tuple(self.steps.branches or ()),
        )

    def more(self) -> list[c.CTop]:
        """What a kind of program has besides (`exploring.py`)."""
        return []

    # ------------------------------------------------------------ functions and steps

    def _function(self, f: Function) -> c.CTop:
        name, faults = self.functions[f.name]
        parameters = [(self._parameter_type(p.type), self.body.local(p.name)) for p in f.parameters]
        if faults:
            parameters.append(("soter_fault *", "fault"))
        result = self.types.work(f.result_type)
        doc = f"{f.source_name}, {where(f.span)}"
        if f.result is None:
            return self._extern_function(f, name, tuple(parameters), result, doc)
        body = self.body.block(f.body, f.result)
        from soter.codegen.body import used_names  # noqa: PLC0415 - one use

        used = used_names((f.body, f.result))
        unused = [c.Unused(self.body.local(p.name)) for p in f.parameters if p.name not in used]
        if faults:
            unused.append(c.Unused("fault"))
        value = self.types.to_store(f.result_type, self.body.expr(f.result))
        if self.types.work(f.result_type) in {"bool", "int64_t", "double"}:
            value = self.body.expr(f.result)
        return c.FunctionDef(
            result, name, tuple(parameters), (*unused, *body, c.Return(value)), doc, inline=True
        )

    def _parameter_type(self, t: Type) -> str:
        return self.types.work(t)

    def _extern_function(
        self, f: Function, name: str, parameters: tuple[tuple[str, str], ...], result: str, doc: str
    ) -> c.CTop:
        """A linked C function; where it is bound to something else, calling it is a fault."""
        if f.source is not None and f.source.startswith("c:"):
            _, path, symbol = f.source.split(":")
            self.c_sources.append(path)
            arguments = tuple(c.Name(n) for _, n in parameters[:-1])
            parameters = (*parameters[:-1], ("soter_fault *", "outer"))
            got, status = c.Name("got"), c.Name("status")
            failed = (
                c.Do(c.CallExpr("soter_raise", (c.Name("outer"), status))),
                c.Return(self.types.default(f.result_type)),
            )
            call = c.CallExpr(symbol, arguments)
            body: tuple[c.CStmt, ...] = (
                c.Declare("soter_fault", "status", c.Name("SOTER_OK")),
                c.Declare("soter_fault *const ", "fault", c.Unary("&", status)),
                c.Unused("fault"),
                c.Declare(self.types.work(f.result_type), "got", call),
                *received(f.result_type, got),
                c.IfStmt(c.Binary("!=", status, c.Name("SOTER_OK")), failed),
                c.Return(got),
            )
        else:
            body = (
                *(c.Unused(n) for _, n in parameters[:-1]),
                c.Do(c.CallExpr("soter_raise", (c.Name("fault"), c.Name("SOTER_EXTERN_FAULT")))),
                c.Return(self.types.default(f.result_type)),
            )
        return c.FunctionDef(result, name, parameters, body, doc, inline=True)

    def _given_topics(self) -> set[int]:
        """Topics that something gives a value while the system runs."""
        found = {o.topic for step in self.core.nodes.values() for o in step.outputs}
        found |= {o.topic for step in self.core.plants.values() for o in step.outputs}
        return found | {d.topic for d in self.system.inputs}

    def _steps(self) -> list[c.CTop]:
        given = self._given_topics()
        queued = [t for t in self.system.topics if t.queues and t.index in given]
        found: list[c.CTop] = [self.steps.push(t) for t in queued]
        for x in self.system.components:
            name = self.names[x.index]
            if x.index in self.core.plants:
                found.append(self.steps.plant(x, self.core.plants[x.index], name))
            elif x.index in self.core.nodes:
                found.append(self.steps.node(x, self.core.nodes[x.index], name))
                failsafe = self.steps.failsafe(x, name)
                if failsafe is not None:
                    found.append(failsafe)
                if x.extern and x.binding and x.binding.startswith("c:"):
                    self.c_sources.append(x.binding.split(":")[1])
        if self.core.decisions:
            found.append(self.steps.switch())
        for d in self.core.decisions:
            found += self.steps.decision(d, self.module_names[d.module])
        for p, predicate in zip(self.system.properties, self.core.properties, strict=True):
            found.append(
                self.steps.predicate(
                    predicate,
                    f"{self.prefix}_property_{p.index}",
                    f"violated: {p.kind} {p.text}",
                    unsafe=True,
                    negate=p.kind != "never",
                )
            )
        for i, drive in enumerate(self.system.inputs):
            found.append(self.steps.draw_input(drive, f"{self.prefix}_input_{i}"))
        return found

    # ------------------------------------------------------------ the state struct

    def _struct(
        self, layout: Struct, name: str, comment: str, *, topics: bool = False
    ) -> c.StructDef:
        members = [
            c.StructMember(
                self.types.stored(m.type),
                self.steps.topic_field(m.index) if topics else field_name(m.name),
            )
            for m in layout.members
        ]
        if layout.padding or not members:
            members.append(c.StructMember("uint8_t", "pad_", layout.padding or 8))
        return c.StructDef(name, tuple(members), comment)

    def _state(self) -> list[c.CTop]:
        found: list[c.CTop] = []
        members: list[c.StructMember] = [c.StructMember("soter_header", "header")]
        n = self.layout
        for type_, name, count in (
            ("soter_component", "components", n.components),
            ("soter_module", "modules", n.modules),
            ("soter_property", "properties", n.properties),
            ("int64_t", "stamps", n.topics),
        ):
            if count:
                members.append(c.StructMember(type_, name, count))
        for g in n.groups:
            if not g.struct.members:
                continue
            if g.owner < 0:
                type_name, member, text = (
                    f"{self.prefix}_topics",
                    "topics",
                    "Topics: the last values",
                )
            else:
                kind = "state" if self.system.components[g.owner].plant else "local"
                type_name = f"{self.names[g.owner]}_{kind}"
                member = self.groups[g.owner]
                text = f"{'state' if kind == 'state' else 'locals'} of {g.name}"
            found.append(self._struct(g.struct, type_name, text, topics=g.owner < 0))
            members.append(c.StructMember(type_name, member))
        found.append(c.StructDef(f"{self.prefix}_state", tuple(members)))
        return found

    def _interface(self) -> list[c.CTop]:
        """What externs see: inputs, outputs, and the prototypes of linked functions."""
        found: list[c.CTop] = []
        for x in self.system.components:
            if not x.extern:
                continue
            name = self.names[x.index]
            layout = arrange(answer_fields(x))
            found.append(self._struct(layout, f"{name}_out", f"what {x.name} answers"))
            if x.node is not None and x.binding and x.binding.startswith("c:"):
                found += self._linked(x, name)
        for f in self.core.functions:
            if f.result is None and f.source and f.source.startswith("c:"):
                parameters = tuple(
                    (self.types.work(p.type), self.body.local(p.name)) for p in f.parameters
                )
                symbol = f.source.rsplit(":", 1)[1]
                found.append(
                    c.FunctionDef(
                        self.types.work(f.result_type),
                        symbol,
                        parameters,
                        None,
                        f"extern fun {f.source_name}",
                        static=False,
                    )
                )
        return [c.Section("externs"), *found] if found else []

    def _linked(self, x: Component, name: str) -> list[c.CTop]:
        assert x.node is not None
        assert x.binding is not None
        symbol = x.binding.rsplit(":", 1)[1]
        inputs = tuple(
            c.StructMember(
                self.types.stored(self.system.topics[x.scope.topics[t.topic]].type),
                field_name(t.topic.name.rsplit(".", 1)[-1]),
            )
            for t in x.node.subscribes
        ) or (c.StructMember("uint8_t", "pad_"),)
        parameters = [(f"const {name}_in *", "in")]
        if x.node.locals:
            parameters.append((f"{name}_local *", "local"))
        parameters.append((f"{name}_out *", "out"))
        return [
            c.StructDef(f"{name}_in", inputs, f"what {x.name} reads"),
            c.FunctionDef(
                "int",
                symbol,
                tuple(parameters),
                None,
                f"extern node {x.node.name}: 0 is success; set has_... for each output given",
                static=False,
            ),
        ]

    # ------------------------------------------------------------ tables

    def _tables(self) -> list[c.CTop]:
        p = self.prefix
        found: list[c.CTop] = []

        def table(type_: str, name: str, rows: list[c.CExpr], comment: str) -> c.CExpr:
            if not rows:
                return c.Name("NULL")
            value = c.Initializer(tuple((None, r) for r in rows))
            found.append(c.VariableDef(type_, f"{p}_{name}", value, array=True, comment=comment))
            return c.Name(f"{p}_{name}")

        components = table(
            "soter_component_info",
            "components",
            [self._component(x) for x in self.system.components],
            "components in deployed order: plants, DMs, SCs, the rest",
        )
        modules = table("soter_module_info", "modules", self._modules(), "RTA modules")
        properties = table(
            "soter_property_info",
            "properties",
            [
                c.Initializer(
                    (
                        ("text", c.String(f"{q.kind} {q.text}")),
                        ("violated", c.Name(f"{p}_property_{q.index}")),
                        *_when(q),
                    )
                )
                for q in self.system.properties
            ],
            "properties, checked on the truth at the end of every instant, and contracts",
        )
        topics = table("soter_topic_info", "topics_info", self._topics(), "topics")
        inputs = table(
            "soter_input_info",
            "inputs",
            [
                c.Initializer(
                    (
                        ("every_ns", int_number(d.every_ns)),
                        ("draw", c.Name(f"{p}_input_{i}")),
                    )
                )
                for i, d in enumerate(self.system.inputs)
            ],
            "environment inputs",
        )
        s = self.system

        def count(n: int) -> c.CExpr:
            return c.Number(f"{n}U")

        program = c.Initializer(
            (
                ("name", c.String(p)),
                ("hash", c.String(s.program.sha256)),
                ("state_size", c.CallExpr("sizeof", (c.Name(f"{p}_state"),))),
                ("components", count(len(s.components))),
                ("modules", count(len(s.modules))),
                ("properties", count(len(s.properties))),
                ("topics", count(len(s.topics))),
                ("inputs", count(len(s.inputs))),
                ("component", components),
                ("module", modules),
                ("property", properties),
                ("topic", topics),
                ("input", inputs),
                ("init", c.Name(f"{p}_init")),
            )
        )
        found.append(c.VariableDef("soter_program", f"{p}_program", program, static=False))
        return found

    def _component(self, x: Component) -> c.CExpr:
        name = self.names[x.index]
        step = self.core.nodes.get(x.index) or self.core.plants.get(x.index)
        outputs = len(step.outputs) if step else 0
        linked = bool(x.binding and x.binding.startswith("c:") and x.node)
        return c.Initializer(
            (
                ("name", c.String(x.name)),
                ("role", c.Name(ROLES[x.role])),
                ("period_ns", int_number(x.period_ns)),
                ("phase_ns", int_number(x.phase_ns)),
                ("module", c.Number(str(-1 if x.module is None else x.module))),
                ("is_extern", c.Name("true" if x.extern and not linked else "false")),
                ("outputs", c.Number(f"{(1 << outputs) - 1}U")),
                ("step", c.Name(f"{name}_step" if step else "NULL")),
                ("failsafe", c.Name(f"{name}_failsafe" if x.failsafe else "NULL")),
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

    def _topics(self) -> list[c.CExpr]:
        state = c.Name(f"{self.prefix}_state")
        return [
            c.Initializer(
                (
                    ("name", c.String(t.name)),
                    (
                        "offset",
                        c.CallExpr(
                            "offsetof", (state, c.Name(f"topics.{self.steps.topic_field(t.index)}"))
                        ),
                    ),
                    ("size", c.CallExpr("sizeof", (c.Name(self.types.stored(t.type)),))),
                )
            )
            for t in self.system.topics
        ]


def _when(p: Property) -> tuple[tuple[str, c.CExpr], ...]:
    """When a contract is checked, and whose it is; nothing for what instants check."""
    if p.component is None:
        return ()
    when = "SOTER_BEFORE_STEP" if p.kind == "assumes" else "SOTER_AFTER_STEP"
    return (("when", c.Name(when)), ("component", c.Number(f"{p.component}U")))

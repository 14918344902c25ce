"""Assembles one generated program: a header and a source file.

Purpose: puts the state struct, the tables of topics, components and modules, and every function in
the order in which a person would read them.
Non-goals: build files and drivers (`targets/`), compiling (`native/`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen import (
    conditions,
    decisions,
    faults,
    held_outputs,
    kernel_tables,
    nodes,
    plants_and_inputs,
    queues,
)
from soter.codegen.body import Body
from soter.codegen.c_names import FileNames, UniqueNames, program_prefix, why_not_linkable
from soter.codegen.c_printer import print_file
from soter.codegen.c_types import TypeTable
from soter.codegen.externs import (
    LINKED,
    answer_fields,
    clean_answer,
    extern_declarations,
    function_caller,
    is_linked,
    linked_bindings,
    linked_name,
    linked_symbol,
    node_caller,
    struct_def,
)
from soter.codegen.kernel_tables import TableEmitter
from soter.codegen.plants_and_inputs import InputEmitter
from soter.codegen.state_access import Frame, place_text
from soter.codegen.value_locations import MADE
from soter.core.layout import Struct, lay_out, state_layout
from soter.core.steps import lower
from soter.diagnostics.diagnostic import Diagnostic, Label, SoterError
from soter.language.model.system import environment_topics

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.codegen.body import StepBranch
    from soter.core.core import CoreSystem, Function, NodeStep, Predicate
    from soter.core.layout import StateLayout
    from soter.language.model.system import Component, Property, System
    from soter.language.model.types import Type

COMPONENT_NAMES = (
    "_step", "_failsafe", "_in", "_out", "_local", "_state", "_move", "_effect", "_exchange",
    "_happens", "_overrun", LINKED,
)  # fmt: skip
MODULE_NAMES = ("_ttf", "_safer", "_decide")
FIXED_NAMES = (
    "state", "topics", "program", "init", "components", "modules", "properties", "topics_info",
    "inputs", "layout_is_as_declared", "switch", "order",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Unit:
    """A generated program: its header, its source, and the facts that a driver needs."""

    prefix: str
    header: str
    source: str
    layout: StateLayout
    answers: dict[int, Struct]
    """Extern component -> layout of its answer struct."""
    c_sources: tuple[str, ...]
    """C files that externs are bound to."""
    names: dict[int, str]
    """Component -> the beginning of its C names (`cart_c`: `cart_c_step`, `cart_c_out`)."""
    topics: tuple[tuple[str, str], ...] = ()
    """Topic index -> its C type, and its member in `topics` of the state."""
    branches: tuple[StepBranch, ...] = ()
    """The branches by their number in `soter_branch`; () if they are not counted."""
    tree: c.CFile = field(default_factory=c.CFile, repr=False)
    """The source as a tree, before decisions are counted."""
    decisions: tuple[tuple[str, c.CExpr], ...] = field(default=(), repr=False)
    """The decisions that are counted; () outside `watching` (`codegen/conditions.py`)."""


def fixed_names(system: System) -> tuple[str, ...]:
    """Names, without prefix, that generated files declare besides names of the program."""
    properties = [f"property_{p.index}" for p in system.properties]
    inputs = [f"input_{i}" for i in range(len(system.inputs))]
    pushed = [f"pushed_{t.index}" for t in system.topics if t.queues]
    published = [f"publish_{i}" for i in environment_topics(system)]
    return (*FIXED_NAMES, *properties, *inputs, *pushed, *published, *faults.fault_names(system))


def generate(
    system: System,
    core: CoreSystem | None = None,
    prefix: str | None = None,
    *,
    branches: bool = False,
    apart: frozenset[int] = frozenset(),
) -> Unit:
    """The C of a system; with `branches` its nodes report which branches they take.

    `apart`: indices of extern nodes in another process: their C is not linked, and all their
    answers are checked, lengths included. Raises SoterError X009 if names of C functions clash.
    """
    builder = UnitBuilder(system, core or lower(system), prefix)
    builder.frame.apart = apart
    builder.frame.branches = [] if branches else None
    return builder.build_unit()


class UnitBuilder:
    """Builds the unit of one system."""

    def __init__(self, system: System, core: CoreSystem, prefix: str | None) -> None:
        self.system = system
        self.core = core
        stem = PurePath(system.program.path).stem or "program"
        self.prefix = prefix or program_prefix(stem)
        self.layout = state_layout(system)
        unique = FileNames(self.prefix, (*fixed_names(system), *self.added_names(system)))
        self.types = TypeTable(unique)
        self.names = {
            x.index: unique.new_family(x.name, COMPONENT_NAMES) for x in system.components
        }
        self.module_names = {
            m.index: unique.new_family(
                m.name, (*MODULE_NAMES, *(f"_good_{k}" for k, _ in enumerate(m.goods)))
            )
            for m in system.modules
        }
        member = UniqueNames(frozenset({"header", "components", "modules", "properties", "stamps"}))
        member("topics")
        self.groups = {g.owner: member(g.name) for g in self.layout.groups if g.owner >= 0}
        self.functions = {
            f.name: (unique.new_family(f"{f.name}_fn", (LINKED,)), f.can_fault)
            for f in core.functions
        }
        self.body = Body(
            self.types,
            self.functions,
            lambda cell: self.frame.cell_place(cell),  # noqa: PLW0108 - `frame` is made just below
        )
        self.frame = Frame(system, self.types, self.body, self.prefix, self.groups)
        self.inputs = InputEmitter(system, self.frame)
        self.open_topics = environment_topics(system)
        self.c_sources: list[str] = []

    def build_unit(self) -> Unit:
        """Builds the C of the system, and returns the unit."""
        for topic in self.system.topics:
            self.types.stored_type(topic.type)  # declared names first: equal records share a struct
        functions = self._function_definitions()
        steps = self._step_definitions()
        init = kernel_tables.init_function(self.frame, f"{self.prefix}_init")
        tables = TableEmitter(
            self.core, self.frame, self.inputs, self.names, self.module_names
        ).table_definitions()
        more = self.added_definitions()
        externs = extern_declarations(self.frame, self.core, self.names)
        state = self._state_definitions()
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
                *externs,
                c.Section("program"),
                c.VariableDef("soter_program", f"{self.prefix}_program", None),
            )
        )
        copied = self.c_sources or self.open_topics or self.frame.apart
        source = c.CFile(
            (
                c.FileComment(about),
                c.Include(f"{self.prefix}.h"),
                *((c.Include("soter_faults.h"),) if self.system.faults else ()),
                *((c.Include("string.h", system=True),) if copied else ()),
                self._size_check_function(),
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
        self._require_linkable_names((*header.items, *source.items))
        answers = {x.index: lay_out(answer_fields(x)) for x in self.system.components if x.extern}
        text, counted = conditions.print_with_counters(source, f'#include "{self.prefix}.h"\n')
        return Unit(
            prefix=self.prefix,
            header=print_file(header),
            source=text,
            layout=self.layout,
            answers=answers,
            c_sources=tuple(dict.fromkeys(self.c_sources)),
            names=dict(self.names),
            topics=tuple(
                (self.types.stored_type(t.type), self.frame.topic_field(t.index))
                for t in self.system.topics
            ),
            branches=tuple(self.frame.branches or ()),
            tree=source,
            decisions=counted,
        )

    def _require_linkable_names(self, items: tuple[c.CTop, ...]) -> None:
        """Raises SoterError X009 if a linked function has a name that is reserved or taken."""
        generated = {
            name
            for x in items
            if not (isinstance(x, c.FunctionDef) and x.body is None)
            for name in (getattr(x, "name", ""),)
        }
        problems = []
        for binding, span, node in linked_bindings(self.frame, self.core):
            name = linked_symbol(binding)
            why = (
                f"the code that is generated of `{self.prefix}` has something of that name"
                if name in generated
                else why_not_linkable(name, node=node)
            )
            if why:
                message = f"`{binding}` cannot be linked: the function's name is impossible"
                helps = ("give the C function another name, and bind to that",)
                problem = Diagnostic("X009", message, Label(span), notes=(why,), helps=helps)
                problems.append(problem)
        if problems:
            raise SoterError(tuple(problems))

    def _size_check_function(self) -> c.FunctionDef:
        state_type = f"{self.prefix}_state"
        return c.FunctionDef(
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

    def added_definitions(self) -> list[c.CTop]:
        """The C that a subclass adds at the end, as `explore/model/explorer_model.py` does."""
        return []

    @staticmethod
    def added_names(_system: System) -> tuple[str, ...]:
        """The names, without prefix, in `added_definitions`; the program may not use them."""
        return ()

    # ------------------------------------------------------------ functions and steps

    def _function_definitions(self) -> list[c.CTop]:
        found: list[c.CTop] = [
            function_caller(self.frame, f, self.functions[f.name][0])
            for f in self.core.functions
            if is_linked(f)
        ]
        return found + [made for f in self.core.functions for made in self.function_definitions(f)]

    def function_definitions(self, f: Function) -> list[c.CTop]:
        """The C of a function; a subclass may change it, as `campaign/compiled_unit.py` does."""
        return [self._function_definition(f)]

    def _function_definition(self, f: Function) -> c.FunctionDef:
        name, faults = self.functions[f.name]
        parameters = self.body.c_parameters(f.parameters)
        result = self.types.work_type(f.result_type)
        if self.types.is_large(f.result_type):
            parameters.append((f"{result} *", "made"))
            result = "void"
        if faults:
            parameters.append(("soter_fault *", "fault"))
        doc = f"{f.source_name}, {place_text(f.span)}"
        if f.result is None:
            return self._extern_function(f, name, tuple(parameters), result, doc)
        unused = [c.Unused(self.body.c_name(p.name)) for p in f.parameters]
        if faults:
            unused.append(c.Unused("fault"))
        body = (*unused, *self.body.function_statements(f, f.result))
        return c.FunctionDef(result, name, tuple(parameters), body, doc, inline=True)

    def _extern_function(
        self, f: Function, name: str, parameters: tuple[tuple[str, str], ...], result: str, doc: str
    ) -> c.FunctionDef:
        """The function that calls a linked C function; for any other extern it raises a fault.

        A linked function takes and returns values of any size (docs/language.md).
        """
        t = f.result_type
        large = self.types.is_large(t)
        if is_linked(f):
            assert f.source is not None
            self.c_sources.append(f.source.split(":")[1])
            arguments = tuple(
                c.Unary("*", parameter) if self.types.is_large(p.type) else parameter
                for p in f.parameters
                for parameter in (c.Name(self.body.c_name(p.name)),)
            )
            parameters = (*parameters[:-1], ("soter_fault *", "outer"))
            got, status = (MADE if large else c.Name("got")), c.Name("status")
            failed = (
                c.Do(c.CallExpr("soter_raise", (c.Name("outer"), status))),
                *self._return_statements(t, self.types.default_constant(t)),
            )
            call = c.CallExpr(linked_name(name), arguments)
            taken = (
                c.Assign(got, call) if large else c.Declare(self.types.work_type(t), "got", call)
            )
            ends = () if large else (c.Return(got),)
            body: tuple[c.CStmt, ...] = (
                c.Declare("soter_fault", "status", c.Name("SOTER_OK")),
                c.Declare("soter_fault *const ", "fault", c.Unary("&", status)),
                c.Unused("fault"),
                taken,
                *clean_answer(t, got),
                c.IfStmt(c.Binary("!=", status, c.Name("SOTER_OK")), failed),
                *ends,
            )
        else:
            body = (
                *(c.Unused(self.body.c_name(p.name)) for p in f.parameters),
                c.Do(c.CallExpr("soter_raise", (c.Name("fault"), c.Name("SOTER_EXTERN_FAULT")))),
                *self._return_statements(t, self.types.default_constant(t)),
            )
        return c.FunctionDef(result, name, parameters, body, doc, inline=True)

    def _return_statements(self, t: Type, value: c.CExpr) -> tuple[c.CStmt, ...]:
        return (c.Assign(MADE, value),) if self.types.is_large(t) else (c.Return(value),)

    def _filled_topics(self) -> set[int]:
        """Indices of the topics that get a value while the system runs."""
        topics = {o.topic for step in self.core.nodes.values() for o in step.outputs}
        topics |= {o.topic for step in self.core.plants.values() for o in step.outputs}
        return topics | set(self.open_topics)

    def _step_definitions(self) -> list[c.CTop]:
        filled_topics = self._filled_topics()
        disturbed = faults.fault_definitions(self.frame, self.names)
        queued = [t for t in self.system.topics if t.queues and t.index in filled_topics]
        definitions: list[c.CTop] = [
            *disturbed,
            *(queues.push_function(self.frame, t) for t in queued),
        ]
        definitions += [
            self.inputs.publish_function(self.system.topics[i]) for i in self.open_topics
        ]
        for x in self.system.components:
            if x.index in self.core.plants:
                plant, name = self.core.plants[x.index], self.names[x.index]
                definitions.append(
                    plants_and_inputs.plant_step_function(self.frame, x, plant, name)
                )
            elif x.index in self.core.nodes:
                definitions += self._node_definitions(x, self.core.nodes[x.index])
        if self.core.decisions:
            definitions.append(decisions.switch_function(self.frame))
        for d in self.core.decisions:
            definitions += decisions.decision_functions(self.frame, d, self.module_names[d.module])
        for p, predicate in zip(self.system.properties, self.core.properties, strict=True):
            definitions.append(self.property_function(p, predicate))
        for i, drive in enumerate(self.system.inputs):
            definitions.append(self.inputs.draw_function(drive, f"{self.prefix}_input_{i}"))
        return definitions

    def _node_definitions(self, x: Component, step: NodeStep) -> Iterator[c.CTop]:
        name = self.names[x.index]
        if self.frame.is_linked(x):
            yield node_caller(x, name)
        yield nodes.node_step_function(self.frame, x, step, name)
        failsafe = nodes.failsafe_function(self.frame, x, name)
        if failsafe is not None:
            yield failsafe
        if x.held is not None:
            yield held_outputs.effect_function(self.frame, x, step.outputs, name)
            yield held_outputs.exchange_function(self.frame, x, step.outputs, name)
        if x.binding and self.frame.is_linked(x):
            self.c_sources.append(x.binding.split(":")[1])

    def property_function(self, p: Property, predicate: Predicate) -> c.FunctionDef:
        """The C function that checks whether a property is violated."""
        return decisions.predicate_function(
            self.frame,
            predicate,
            f"{self.prefix}_property_{p.index}",
            f"violated: {p.kind} {p.text}",
            unsafe=True,
            negate=p.kind != "never",
        )

    # ------------------------------------------------------------ the state struct

    def _state_definitions(self) -> list[c.CTop]:
        definitions: list[c.CTop] = []
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
            definitions.append(
                struct_def(self.frame, g.struct, type_name, text, topics=g.owner < 0)
            )
            members.append(c.StructMember(type_name, member))
        definitions.append(c.StructDef(f"{self.prefix}_state", tuple(members)))
        return definitions

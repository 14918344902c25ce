"""The C that all functions of a generated program have in common.

Purpose: `Frame` emits access to the cells of the state, the load and commit of a step's locals, and
the declaration, check and publication of its outputs.
Non-goals: what steps compute (`body.py`), the functions themselves (`nodes.py`,
`plants_and_inputs.py`, `decisions.py`, `kernel_tables.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_names import UniqueNames, field_name
from soter.codegen.storage_plan import PlannedBody
from soter.core import core
from soter.core.core import output_name
from soter.core.core_walks import outputs_always_published

if TYPE_CHECKING:
    from soter.codegen.body import Body, StepBranch
    from soter.codegen.c_types import TypeTable
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Component, System


S = c.Name("s")
OK = c.Name("SOTER_OK")
CT = c.Member(c.Arrow(S, "header"), "ct")
HEADER = c.Unary("&", c.Arrow(S, "header"))
STEP_PARAMETERS = (
    ("void *", "state"),
    ("uint32_t", "flags"),
    ("uint32_t *", "published"),
    ("const void *", "answer"),
)


def place_text(span: Span) -> str:
    """The place of a declaration as `file.soter:12`; the comment above its C function shows it."""
    return f"{span.source.name.rsplit('/', 1)[-1]}:{span.line}"


def stamp_place(topic: int) -> c.CExpr:
    """The C place of a topic's stamp in the state."""
    return c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(topic)))


def flag_is_set(flag: str) -> c.CExpr:
    """The C condition that `flag` is set among the flags of a step."""
    return c.Binary("!=", c.Binary("&", c.Name("flags"), c.Name(flag)), c.Number("0U"))


class Frame:
    """Emits the code around the bodies of one system's functions: state, locals and outputs."""

    def __init__(
        self, system: System, types: TypeTable, body: Body, prefix: str, groups: dict[int, str]
    ) -> None:
        self.system = system
        self.types = types
        self.body = body
        self.prefix = prefix
        self.groups = groups
        """Component index -> C name of the struct member with its locals or states."""
        self.apart: frozenset[int] = frozenset()
        """Extern nodes that a driver answers though they are bound to C (target `posix`)."""
        self.works_in_place = False
        """Whether nodes change large locals in the state, and restore them after a fault."""
        self.branches: list[StepBranch] | None = None
        """The branches that nodes count as taken, by number; None: they count none."""
        unique = UniqueNames()
        self._topic_fields = [unique(t.name) for t in system.topics]

    def is_linked(self, component: Component) -> bool:
        """Whether a component is an extern node whose C is linked into the program."""
        bound = (component.binding or "").startswith("c:") and component.node is not None
        return component.extern and bound and component.index not in self.apart

    def state_pointer(self, *, const: bool = False) -> c.CStmt:
        """The declaration `prefix_state *const s = state;`."""
        qualifier = "const " if const else ""
        return c.Declare(f"{qualifier}{self.prefix}_state *const ", "s", c.Name("state"))

    def fault_pointer(self) -> list[c.CStmt]:
        """Declares `status`, which keeps the step's first fault, and the pointer `fault` to it."""
        return [
            c.Declare("soter_fault", "status", OK),
            c.Declare("soter_fault *const ", "fault", c.Unary("&", c.Name("status"))),
        ]

    def checked_code(self, code: list[c.CStmt], failed: tuple[c.CStmt, ...] = ()) -> list[c.CStmt]:
        """The code; if it may fault, followed by C that after a fault runs `failed` and returns."""
        if not any(name in {"fault", "status"} for s in code for name in c.names_read(s)):
            return code
        ends = (*failed, c.Return(c.Name("status")))
        check = c.IfStmt(c.Binary("!=", c.Name("status"), OK), ends)
        return [*self.fault_pointer(), *code, check]

    def topic_place(self, index: int) -> c.CExpr:
        """The C place of a topic's value in the state."""
        return c.Member(c.Arrow(S, "topics"), self.topic_field(index))

    def topic_field(self, index: int) -> str:
        """The name of a topic's member in the struct `topics`."""
        return self._topic_fields[index]

    def member_place(self, owner: int, name: str) -> c.CExpr:
        """The C place of a component's local or plant state."""
        return c.Member(c.Arrow(S, self.groups[owner]), field_name(name))

    def cell_place(self, cell: core.Cell) -> c.CExpr:
        """The C place of a cell, which is a topic, a local or a plant state."""
        if cell.kind == "topic":
            return self.topic_place(cell.owner)
        return self.member_place(cell.owner, cell.name)

    def load_locals(self, copies: tuple[core.LocalCopy, ...], used: set[str]) -> list[c.CStmt]:
        """Copies cells into temporaries, except for large cells that are only read."""
        declarations: list[c.CStmt] = []
        for copy in copies:
            if copy.name not in used and not copy.written:
                continue
            name, t, cell = self.body.c_name(copy.name), copy.type, self.cell_place(copy.cell)
            if copy.name in self.body.in_place:
                stored, changed = self.types.stored_type(t), self.body.changed_flag(copy.name)
                declarations += [
                    c.Declare(f"{stored} *const ", name, c.address_of(cell)),
                    c.Declare(stored, self.body.value_before(copy.name).text, None),
                    c.Declare("bool", changed.text, c.Name("false")),
                ]
            elif self.body.is_pointer(copy.name):
                pointer = f"const {self.types.stored_type(t)} *const "
                declarations.append(c.Declare(pointer, name, c.address_of(cell)))
            else:
                declarations.append(
                    c.Declare(self.types.work_type(t), name, cell, const=not copy.written)
                )
        return declarations

    def store_locals(self, copies: tuple[core.LocalCopy, ...]) -> list[c.CStmt]:
        """Commits the temporaries that were written to their cells."""
        commits: list[c.CStmt] = []
        for x in copies:
            if x.name in self.body.in_place:
                _, *canonical = self.types.commit_value(self.cell_place(x.cell), x.type, S)
                if canonical:
                    commits.append(c.IfStmt(self.body.changed_flag(x.name), tuple(canonical)))
            elif x.written:
                commits += self.types.commit_value(
                    self.cell_place(x.cell), x.type, self.body.place_of(x.name)
                )
        return commits

    def restore_locals(self, copies: tuple[core.LocalCopy, ...]) -> list[c.CStmt]:
        """The C that gives locals changed in place their old values again after a fault."""
        return [
            c.IfStmt(
                self.body.changed_flag(x.name),
                (c.Assign(self.cell_place(x.cell), self.body.value_before(x.name)),),
            )
            for x in copies
            if x.name in self.body.in_place
        ]

    def declare_outputs(self, outputs: tuple[core.Output, ...]) -> list[c.CStmt]:
        """Declares `out_topic` and `has_topic` of outputs; large ones may share a local's place."""
        unique = UniqueNames()
        topics = [self.system.topics[o.topic].name.rpartition(".")[2] for o in outputs]
        self.body.outputs = tuple(unique(name) for name in topics)
        declarations: list[c.CStmt] = []
        for k, output in enumerate(outputs):
            if self.body.has_place(output_name(k)):
                work, default = (
                    self.types.work_type(output.type),
                    self.types.default_constant(output.type),
                )
                declarations.append(c.Declare(work, f"out_{self.body.outputs[k]}", default))
            if k not in self.body.certain:
                declarations.append(c.Declare("bool", self.body.flag_of(k).text, c.Name("false")))
        return declarations

    def sure_outputs(
        self, component: Component, step: core.NodeStep | core.PlantStep
    ) -> frozenset[int]:
        """The numbers of the outputs that a step always publishes; these outputs need no flag."""
        code = step.publish if isinstance(step, core.PlantStep) else step.body
        silent = {
            f.topic
            for f in self.system.faults
            if f.kind == "silent" and f.component == component.index
        }
        spoken = {k for k, o in enumerate(step.outputs) if o.topic not in silent}
        return frozenset(outputs_always_published(code) & spoken)

    def code_if_published(self, k: int, code: list[c.CStmt]) -> list[c.CStmt]:
        """The code, in an `if` unless the step always publishes output `k`."""
        if k in self.body.certain:
            return code
        return [c.IfStmt(self.body.flag_of(k), tuple(code))]

    def locals_in_place(self, copies: tuple[core.LocalCopy, ...]) -> frozenset[str]:
        """The large locals that a step changes in place in the state; empty if it copies them."""
        if not self.works_in_place:
            return frozenset()
        return frozenset(x.name for x in copies if x.written and self.types.is_large(x.type))

    def body_to_plan(
        self,
        code: tuple[core.Stmt, ...],
        copies: tuple[core.LocalCopy, ...],
        outputs: tuple[core.Output, ...] = (),
        read_later: tuple[str, ...] = (),
    ) -> PlannedBody:
        """The body of a step, with its large locals and outputs, as input of `plan_storage`."""
        large = self.types.is_large
        return PlannedBody(
            code=code,
            is_large=large,
            fixed=tuple(x.name for x in copies if large(x.type) and not x.written),
            kept=tuple((x.name, x.type) for x in copies if large(x.type) and x.written),
            outputs=tuple((k, o.type) for k, o in enumerate(outputs) if large(o.type)),
            read_later=read_later,
        )

    def check_outputs(self, outputs: tuple[core.Output, ...]) -> list[c.CStmt]:
        """Checks, as the gate does, that each output is finite and in its topic's set."""
        return [
            made
            for k, output in enumerate(outputs)
            if (
                checks := self.types.check_value(
                    output.type, tuple(output.bounds), self.body.output_place(k)
                )
            )
            for made in self.code_if_published(k, list(checks))
        ]

    def publish_outputs(self, outputs: tuple[core.Output, ...], *, gated: bool) -> list[c.CStmt]:
        """Reports and stores outputs; if `gated`, stores them only while OE is set (rule n1)."""
        statements: list[c.CStmt] = []
        for k, output in enumerate(outputs):
            stamp = stamp_place(output.topic)
            stores = [*self._store_output(k, output), c.Assign(stamp, CT)]
            bit = c.Number(f"{1 << k}U")
            published = c.Unary("*", c.Name("published"))
            note = c.Assign(published, c.Binary("|", published, bit))
            if gated:
                stores = [c.IfStmt(flag_is_set("SOTER_ENABLED"), tuple(stores))]
            statements += self.code_if_published(k, [note, *stores])
        return statements

    def _store_output(self, k: int, output: core.Output) -> list[c.CStmt]:
        """Stores output `k` in its topic and queues; for a burst, stores each of the values."""
        topic, out = self.topic_place(output.topic), self.body.output_place(k)
        if not output.burst:
            value = self.types.as_stored(output.type, out)
            return [c.Assign(topic, value), *self.push_to_queues(output.topic)]
        message = c.IndexExpr(c.Member(out, "items"), c.Name("message"))
        each = (c.Assign(topic, message), *self.push_to_queues(output.topic))
        return [c.For("message", c.Number("0"), c.Member(out, "len"), each)]

    def push_name(self, topic: int) -> str:
        """The name of the C function that puts a topic's value into its queues."""
        return f"{self.prefix}_pushed_{topic}"

    def push_to_queues(self, topic: int) -> list[c.CStmt]:
        """The C that puts a topic's new value into its queues, if it has any."""
        if not self.system.topics[topic].queues:
            return []
        return [c.Do(c.CallExpr(self.push_name(topic), (S,)))]

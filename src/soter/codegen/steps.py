"""Functions of a generated program: steps of nodes and plants, decision modules, properties.

Purpose: what `soter_step_fn`, `decide`, `violated`, `draw` and `init` of the kernel's tables are.
Non-goals: the tables and the state struct (`unit.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.body import Branch, Choices, stream_key
from soter.codegen.names import Unique, field_name
from soter.codegen.received import received
from soter.codegen.types import FAULT, float_number, int_number
from soter.lower import core
from soter.lower.footprint import walk
from soter.program.system import queues_of
from soter.program.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    default_value,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.codegen.body import Body
    from soter.codegen.types import TypeTable
    from soter.diagnostics.span import Span
    from soter.program.system import Bound, Component, InputDrive, System, Topic
    from soter.program.typed import NodeSymbol
    from soter.program.types import Type, Value

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
DRAW_PARAMETERS = (("void *", "state"), ("const void *", "answer"))


def where(span: Span) -> str:
    """`file.soter:12`, for the comment above a function."""
    return f"{span.source.name.rsplit('/', 1)[-1]}:{span.line}"


def enabled(flag: str) -> c.CExpr:
    """Whether a flag of a step is set."""
    return c.Binary("!=", c.Binary("&", c.Name("flags"), c.Name(flag)), c.Number("0U"))


class StepEmitter:
    """Emits all functions of one system."""

    def __init__(
        self, system: System, types: TypeTable, body: Body, prefix: str, groups: dict[int, str]
    ) -> None:
        self.system = system
        self.types = types
        self.body = body
        self.prefix = prefix
        self.groups = groups
        """Component index -> C name of its group of locals or states."""
        self.branches: list[Branch] | None = None
        """A list: nodes count which branches they take, and it says what the numbers mean."""
        unique = Unique()
        self._topic_fields = [unique(t.name) for t in system.topics]

    # ------------------------------------------------------------ shared pieces

    def state_pointer(self, *, const: bool = False) -> c.CStmt:
        """`prefix_state *const s = state;`."""
        qualifier = "const " if const else ""
        return c.Declare(f"{qualifier}{self.prefix}_state *const ", "s", c.Name("state"))

    def fault_pointer(self) -> list[c.CStmt]:
        """The sticky fault of a step."""
        return [
            c.Declare("soter_fault", "status", OK),
            c.Declare("soter_fault *const ", "fault", c.Unary("&", c.Name("status"))),
        ]

    def topic(self, index: int) -> c.CExpr:
        """The value of a topic in the state."""
        return c.Member(c.Arrow(S, "topics"), self.topic_field(index))

    def topic_field(self, index: int) -> str:
        """The member of `topics` that holds a topic."""
        return self._topic_fields[index]

    def member(self, owner: int, name: str) -> c.CExpr:
        """A local or plant state in the state struct."""
        return c.Member(c.Arrow(S, self.groups[owner]), field_name(name))

    def cell(self, cell: core.Cell) -> c.CExpr:
        """Any state cell."""
        if cell.kind == "topic":
            return self.topic(cell.owner)
        return self.member(cell.owner, cell.name)

    def load(self, copies: tuple[core.LocalCopy, ...], used: set[str]) -> list[c.CStmt]:
        """Copy cells into temporaries."""
        return [
            c.Declare(
                self.types.work(copy.type),
                self.body.local(copy.name),
                self.cell(copy.cell),
                const=not copy.written,
            )
            for copy in copies
            if copy.name in used or copy.written
        ]

    def store(self, copies: tuple[core.LocalCopy, ...]) -> list[c.CStmt]:
        """Commit written temporaries."""
        return [
            c.Assign(
                self.cell(x.cell), self.types.canonical(x.type, c.Name(self.body.local(x.name)))
            )
            for x in copies
            if x.written
        ]

    def declare_outputs(self, outputs: tuple[core.Output, ...]) -> list[c.CStmt]:
        """`out_topic` and `has_topic` for every output."""
        unique = Unique()
        topics = [self.system.topics[o.topic].name.rpartition(".")[2] for o in outputs]
        self.body.outputs = tuple(unique(name) for name in topics)
        found: list[c.CStmt] = []
        for k, output in enumerate(outputs):
            work, default = self.types.work(output.type), self.types.default(output.type)
            found.append(c.Declare(work, self.body.out(k).text, default))
            found.append(c.Declare("bool", self.body.has(k).text, c.Name("false")))
        return found

    def check_outputs(self, outputs: tuple[core.Output, ...]) -> list[c.CStmt]:
        """The gate's check of every publication."""
        found: list[c.CStmt] = []
        for k, output in enumerate(outputs):
            checks = self.types.check(
                output.type,
                tuple(output.bounds),
                self.body.out(k),
            )
            if checks:
                found.append(c.IfStmt(self.body.has(k), tuple(checks)))
        return found

    def publish(self, outputs: tuple[core.Output, ...], *, gated: bool) -> list[c.CStmt]:
        """Store publications (n1: only if OE) and report which there were."""
        found: list[c.CStmt] = []
        for k, output in enumerate(outputs):
            stamp = c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(output.topic)))
            value = self.types.to_store(output.type, self.body.out(k))
            stores: list[c.CStmt] = [c.Assign(self.topic(output.topic), value), c.Assign(stamp, CT)]
            stores += self._push_on(output.topic)
            bit = c.Number(f"{1 << k}U")
            published = c.Unary("*", c.Name("published"))
            note = c.Assign(published, c.Binary("|", published, bit))
            if gated:
                stores = [c.IfStmt(enabled("SOTER_ENABLED"), tuple(stores))]
            found.append(c.IfStmt(self.body.has(k), (note, *stores)))
        return found

    # ------------------------------------------------------------ queues

    def pushed(self, topic: int) -> str:
        """The function that puts a topic's value into the queues behind it."""
        return f"{self.prefix}_pushed_{topic}"

    def _push_on(self, topic: int) -> list[c.CStmt]:
        """After a topic has a new value: put it into its queues."""
        if not self.system.topics[topic].queues:
            return []
        return [c.Do(c.CallExpr(self.pushed(topic), (S,)))]

    def push(self, topic: Topic) -> c.FunctionDef:
        """Puts a topic's value into the queues behind it, each by its policy when it is full."""
        body: list[c.CStmt] = [self.state_pointer()]
        for index in topic.queues:
            queue = self.system.topics[index]
            assert isinstance(queue.type, ListType)
            items = c.Member(self.topic(index), "items")
            length = c.Member(self.topic(index), "len")
            capacity = queue.type.capacity
            append = (
                c.Assign(c.IndexExpr(items, length), self.topic(topic.index)),
                c.Assign(length, c.Binary("+", length, c.Number("1"))),
            )
            room = c.Binary("<", length, c.Number(str(capacity)))
            if queue.policy == "drop_oldest":
                k = c.Name("k")
                after = c.IndexExpr(items, c.Binary("+", k, c.Number("1")))
                move = (c.Assign(c.IndexExpr(items, k), after),)
                last = c.Number(str(capacity - 1))
                shift = (c.For("k", c.Number("0"), last, move),) if capacity > 1 else ()
                body += [c.IfStmt(c.Unary("!", room), (*shift, c.Assign(length, last))), *append]
            elif queue.policy == "fault":
                lost = c.Assign(self._lost(index), c.Name("SOTER_LOST"))
                body.append(c.IfStmt(room, append, (lost,)))
            else:
                body.append(c.IfStmt(room, append))
        doc = f"the queues behind {topic.name}"
        return c.FunctionDef(
            "void", self.pushed(topic.index), (("void *", "state"),), tuple(body), doc
        )

    def _lost(self, queue: int) -> c.CExpr:
        """Whether a queue lost a value that it may not lose: SOTER_LOST, else SOTER_NEVER."""
        return c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(queue)))

    def _has_lost(self, queue: int) -> c.CExpr:
        return c.Binary("!=", self._lost(queue), c.Name("SOTER_NEVER"))

    def _must_not_lose(self, component: Component) -> list[c.CStmt]:
        """A step fault where a queue of the node lost a value that it may not lose."""
        return [
            c.Do(
                c.CallExpr(
                    "soter_guard",
                    (c.Unary("!", self._has_lost(q)), c.Name("SOTER_CAPACITY"), FAULT),
                )
            )
            for q in queues_of(self.system, component)
            if self.system.topics[q].policy == "fault"
        ]

    def _empty(self, queue: int) -> c.CStmt:
        default = self.types.default(self.system.topics[queue].type)
        return c.Assign(self.topic(queue), default)

    def _forgive(self, component: Component) -> list[c.CStmt]:
        """After that fault the queue starts afresh."""
        found: list[c.CStmt] = []
        for q in queues_of(self.system, component):
            if self.system.topics[q].policy == "fault":
                fresh = (self._empty(q), c.Assign(self._lost(q), c.Name("SOTER_NEVER")))
                told = c.Binary("==", c.Name("status"), c.Name("SOTER_CAPACITY"))
                found.append(c.IfStmt(c.Binary("&&", told, self._has_lost(q)), fresh))
        return found

    # ------------------------------------------------------------ nodes

    def node(self, component: Component, step: core.NodeStep, name: str) -> c.FunctionDef:
        """The step of a node."""
        assert component.node is not None
        c_source = component.binding is not None and component.binding.startswith("c:")
        foreign = component.extern
        used = {n.name for n in _vars((step.takeover, step.body))}
        branches = None if foreign else self.branches
        self.body.choices = Choices(component.name, branches)
        takeover: list[c.CStmt] = []
        if step.takeover:
            block = tuple(self.body.block(step.takeover, step.body))
            takeover.append(c.IfStmt(enabled("SOTER_TAKEOVER"), block))
        body: list[c.CStmt] = [self.state_pointer(), *self.fault_pointer()]
        body += self.load(step.locals, used)
        must_not_lose = self._must_not_lose(component)
        if foreign and c_source and step.locals:
            body += [*takeover, *self._linked(component, step, name), *must_not_lose]
        elif foreign:
            outputs = self._linked if c_source else self._answered
            body += [*outputs(component, step, name), *must_not_lose, *takeover]
        else:
            body += self.declare_outputs(step.outputs)
            body += must_not_lose
            body += [*self._choosing(component, step), *takeover, *self.body.block(step.body)]
        body += [c.Unused(n) for n in ("s", "flags", "answer", "published", "fault")]
        body += self.check_outputs(step.outputs)
        failed = (*self._forgive(component), c.Return(c.Name("status")))
        body.append(c.IfStmt(c.Binary("!=", c.Name("status"), OK), failed))
        if foreign and c_source:
            body += [self._keep(copy) for copy in step.locals]
        else:
            body += self.store(step.locals)
        body += [self._empty(q) for q in queues_of(self.system, component)]
        body += self.publish(step.outputs, gated=True)
        body.append(c.Return(OK))
        self.body.choices = None
        doc = f"{component.role} {component.node.name}, {where(step.span)}"
        return c.FunctionDef("soter_fault", f"{name}_step", STEP_PARAMETERS, tuple(body), doc)

    def _choosing(self, component: Component, step: core.NodeStep) -> list[c.CStmt]:
        """What choices need: how many were made in this step, and which release it is."""
        if not any(isinstance(n, core.Choose) for n in walk(step.body)):
            return []
        since = c.Binary("-", CT, int_number(component.phase_ns)) if component.phase_ns else CT
        release = c.Binary("/", since, int_number(component.period_ns))
        return [
            c.Declare("uint32_t", "made", c.Number("0U")),
            c.Declare("int64_t", "release", release, const=True),
        ]

    def _linked(self, component: Component, step: core.NodeStep, name: str) -> list[c.CStmt]:
        """Outputs of an extern node from a linked C function, which also gets its locals."""
        node = component.node
        assert node is not None
        assert component.binding is not None
        in_fields = tuple(
            (
                field_name(x.topic.name.rsplit(".", 1)[-1]),
                self.topic(component.scope.topics[x.topic]),
            )
            for x in node.subscribes
        )
        inputs = c.Initializer(in_fields or ((None, c.Number("0")),))
        found = self.declare_outputs(step.outputs)
        found.append(c.Declare(f"{name}_in", "in", inputs, const=True))
        found.append(c.Declare(f"{name}_out", "got", c.Initializer(())))
        arguments: list[c.CExpr] = [c.Unary("&", c.Name("in"))]
        if step.locals:
            group = c.Arrow(S, self.groups[component.index])
            found.append(c.Declare(f"{name}_local", "kept", group))
            found += [
                c.Assign(
                    c.Member(c.Name("kept"), field_name(x.cell.name)),
                    self.types.to_store(x.type, c.Name(self.body.local(x.name))),
                )
                for x in step.locals
                if x.written
            ]
            failed = c.Binary("!=", c.Name("status"), OK)
            if step.takeover:
                found.append(c.IfStmt(failed, (c.Return(c.Name("status")),)))
            arguments.append(c.Unary("&", c.Name("kept")))
        arguments.append(c.Unary("&", c.Name("got")))
        call = c.CallExpr(component.binding.rsplit(":", 1)[1], tuple(arguments))
        fine = c.Binary("==", call, c.Number("0"))
        found.append(c.Do(c.CallExpr("soter_guard", (fine, c.Name("SOTER_EXTERN_FAULT"), FAULT))))
        for x in step.locals:
            found += received(x.type, c.Member(c.Name("kept"), field_name(x.cell.name)))
        for topic in node.publishes:
            short = topic.name.rsplit(".", 1)[-1]
            cleaned = received(topic.type, c.Member(c.Name("got"), field_name(short)))
            has = c.Member(c.Name("got"), field_name(f"has_{short}"))
            if cleaned:
                found.append(c.IfStmt(c.Binary("!=", has, c.Number("0")), tuple(cleaned)))
        return found + self._given(node, lambda field: c.Member(c.Name("got"), field))

    def _keep(self, copy: core.LocalCopy) -> c.CStmt:
        """Commit a local that a linked C function may have changed."""
        new = c.Member(c.Name("kept"), field_name(copy.cell.name))
        return c.Assign(self.cell(copy.cell), self.types.canonical(copy.type, new))

    def _answered(self, component: Component, step: core.NodeStep, name: str) -> list[c.CStmt]:
        """Outputs of an extern node from the driver's answer."""
        node = component.node
        assert node is not None
        got = c.Name("got")
        return [
            *self.declare_outputs(step.outputs),
            c.Declare(f"const {name}_out *const ", "got", c.Name("answer")),
            c.IfStmt(
                c.Binary("==", got, c.Name("NULL")), (c.Return(c.Name("SOTER_EXTERN_FAULT")),)
            ),
            *self._given(node, lambda field: c.Arrow(got, field)),
        ]

    def _given(self, node: NodeSymbol, part: Callable[[str], c.CExpr]) -> list[c.CStmt]:
        """Take over the outputs that an extern gave."""
        found: list[c.CStmt] = []
        for k, topic in enumerate(node.publishes):
            short = topic.name.rsplit(".", 1)[-1]
            taken = (
                c.Assign(self.body.out(k), part(field_name(short))),
                c.Assign(self.body.has(k), c.Name("true")),
            )
            has = c.Binary("!=", part(field_name(f"has_{short}")), c.Number("0"))
            found.append(c.IfStmt(has, taken))
        return found

    def failsafe(self, component: Component, name: str) -> c.FunctionDef | None:
        """Publishes the declared fail-safe values of a node."""
        if not component.failsafe:
            return None
        body: list[c.CStmt] = [self.state_pointer()]
        for index, value in component.failsafe.items():
            t = self.system.topics[index].type
            constant = self.types.constant(t, value, "failsafe")
            body.append(c.Assign(self.topic(index), self.types.to_store(t, constant)))
            body.append(c.Assign(c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(index))), CT))
            body += self._push_on(index)
        return c.FunctionDef("void", f"{name}_failsafe", (("void *", "state"),), tuple(body))

    # ------------------------------------------------------------ plants

    def plant(self, component: Component, step: core.PlantStep, name: str) -> c.FunctionDef:
        """One release of a plant."""
        assert component.plant is not None
        first = c.Name("first")
        body: list[c.CStmt] = [
            self.state_pointer(),
            *self.fault_pointer(),
            c.Declare("bool", "first", enabled("SOTER_FIRST"), const=True),
        ]
        used = {n.name for n in _vars((step.integrate, step.publish))}
        body += self.load(step.states, used)
        body += self._disturbances(component, step, used)
        body += self.declare_outputs(step.outputs)
        if step.extern:
            body += self._new_states(step, name)
        elif step.integrate:
            inner = self.body.block(step.integrate, step.publish)
            body.append(c.IfStmt(c.Unary("!", first), tuple(inner)))
        body += self.body.block(step.publish)
        body += self._noise(component, step)
        body += [c.Unused(n) for n in ("s", "flags", "answer", "published", "fault", "first")]
        body += self.check_outputs(step.outputs)
        body.append(c.IfStmt(c.Binary("!=", c.Name("status"), OK), (c.Return(c.Name("status")),)))
        body += self.store(step.states)
        body += self.publish(step.outputs, gated=False)
        body.append(c.Return(OK))
        doc = f"plant {component.plant.name}, {where(step.span)}"
        return c.FunctionDef("soter_fault", f"{name}_step", STEP_PARAMETERS, tuple(body), doc)

    def _disturbances(
        self, component: Component, step: core.PlantStep, used: set[str]
    ) -> list[c.CStmt]:
        if not any(n in used for n, _, _ in step.disturbances):
            return []
        began = c.Ternary(
            c.Name("first"), c.Number("0"), c.Binary("-", CT, int_number(component.period_ns))
        )
        found: list[c.CStmt] = [c.Declare("int64_t", "began", began, const=True)]
        for name, t, draws in step.disturbances:
            if name in used:
                drawn = [self._draw(d, component, c.Name("began")) for d in draws]
                own = self.body.local(name)
                before, values = _in_order([("double", e) for e in drawn], f"drawn_{own}")
                value = _assemble(self.types, t, iter(values))
                found += [*before, c.Declare(self.types.work(t), own, value, const=True)]
        return found

    def _draw(self, draw: core.Draw, component: Component, at: c.CExpr) -> c.CExpr:
        """A disturbance: one that holds is drawn by chance, whoever answers."""
        hold = draw.hold_ns if draw.hold_ns > 0 else component.period_ns
        index = c.Binary("/", at, int_number(hold))
        chance = draw.hold_ns > 0 or component.extern
        return self._uniform(draw.stream, index, draw.low, draw.high, chance=chance)

    def _uniform(
        self, stream: str, index: c.CExpr, low: float, high: float, *, chance: bool = False
    ) -> c.CExpr:
        bounds = (float_number(low), float_number(high))
        if chance:
            return c.CallExpr("soter_draw", (HEADER, stream_key(stream), index, *bounds))
        return c.CallExpr("soter_drawn", (*_whom(stream), index, *bounds))

    def _new_states(self, step: core.PlantStep, name: str) -> list[c.CStmt]:
        """An extern plant: the driver's answer holds the new states."""
        got = c.Name("got")
        found: list[c.CStmt] = [c.Declare(f"const {name}_out *const ", "got", c.Name("answer"))]
        assigns = tuple(
            c.Assign(c.Name(self.body.local(x.name)), c.Arrow(got, field_name(x.cell.name)))
            for x in step.states
        )
        found.append(c.IfStmt(c.Binary("!=", got, c.Name("NULL")), assigns))
        return found

    def _noise(self, component: Component, step: core.PlantStep) -> list[c.CStmt]:
        """Measurement errors, leaf by leaf."""
        found: list[c.CStmt] = []
        index = c.Binary("/", CT, int_number(component.period_ns))
        for output, leaf, draw in step.noise:
            target = _leaf(self.body.out(output), step.outputs[output].type, leaf)
            error = self._uniform(draw.stream, index, draw.low, draw.high, chance=component.extern)
            found.append(c.Assign(target, c.Binary("+", target, error)))
        return found

    # ------------------------------------------------------------ decision modules, properties

    def switch(self) -> c.FunctionDef:
        """The switching logic of every DM, on facts alone: `reach/dm_check.py` tries all."""
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
        doc = "the mode after a DM step: the switching logic of the paper's Figure"
        return c.FunctionDef("soter_mode", f"{self.prefix}_switch", parameters, body, doc)

    def decision(self, decision: core.Decision, name: str) -> list[c.FunctionDef]:
        """ttf, safer and the generated DM of a module."""
        module = self.system.modules[decision.module]
        made = [
            self.predicate(decision.ttf, f"{name}_ttf", f"ttf of {module.name}", unsafe=True),
            self.predicate(
                decision.safer, f"{name}_safer", f"safer of {module.name}", unsafe=False
            ),
        ]
        m = c.Name("m")
        own = c.IndexExpr(c.Arrow(S, "modules"), c.Number(str(module.index)))
        stale: c.CExpr | None = None
        for index in module.inputs:
            max_age = self.system.topics[index].max_age_ns
            if max_age is None:
                continue
            stamp = c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(index)))
            old = c.Binary(">", c.Binary("-", CT, stamp), int_number(max_age))
            stale = old if stale is None else c.Binary("||", stale, old)
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
            self.state_pointer(),
            c.Declare("soter_module *const ", "m", c.Unary("&", own)),
            c.Declare("bool", "stale", stale if stale is not None else c.Name("false"), const=True),
            c.Declare("bool", "ttf", c.CallExpr(f"{name}_ttf", (c.Name("state"),)), const=True),
            c.Declare("bool", "safer", c.CallExpr(f"{name}_safer", (c.Name("state"),)), const=True),
            *set_fact,
            c.Declare("bool", "gate_fault", gate_fault, const=True),
            c.Declare("bool", "clean", clean, const=True),
            c.Return(c.CallExpr(f"{self.prefix}_switch", facts)),
        ]
        doc = f"decision module of {module.name}, {where(module.symbol.span)}"
        made.append(
            c.FunctionDef("soter_mode", f"{name}_decide", (("void *", "state"),), tuple(body), doc)
        )
        return made

    def predicate(
        self, p: core.Predicate, name: str, doc: str, *, unsafe: bool, negate: bool = False
    ) -> c.FunctionDef:
        """A predicate over the state; a fault inside gives `unsafe`."""
        value = self.body.expr(p.value)
        if negate:
            value = c.Unary("!", value)
        body: list[c.CStmt] = [self.state_pointer(const=True), c.Unused("s")]
        faults = p.body and any(
            isinstance(x, (core.Checked, core.Guard, core.Call, core.If, core.Loop)) for x in p.body
        )
        if faults:
            body += [*self.fault_pointer(), c.Unused("fault")]
        body += self.body.block(p.body, p.value)
        if faults:
            failed = c.Binary("!=", c.Name("status"), OK)
            body.append(c.IfStmt(failed, (c.Return(c.Name("true" if unsafe else "false")),)))
        body.append(c.Return(value))
        return c.FunctionDef(
            "bool", name, (("const void *", "state"),), tuple(body), f"{doc}, {where(p.span)}"
        )

    def draw_input(self, drive: InputDrive, name: str) -> c.FunctionDef:
        """A change of an environment input, by chance or as a driver answers."""
        info = self.system.topics[drive.topic]
        index = c.Binary("/", CT, int_number(drive.every_ns))
        stream = f"input.{info.name}"
        before: Sequence[c.CStmt]
        if drive.values:
            before, value = self._one_of(drive, stream, index)
        else:
            drawn = [
                self._drawn_leaf(t, bound, ".".join((stream, *path)), index)
                for (path, t), bound in zip(leaves(info.type), info.bounds, strict=True)
            ]
            before, values = _in_order(drawn, "drawn")
            value = _assemble(self.types, info.type, iter(values))
        body = (
            self.state_pointer(),
            *before,
            c.Assign(self.topic(drive.topic), value),
            c.Assign(c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(drive.topic))), CT),
            *self._push_on(drive.topic),
            c.Unused("answer"),
        )
        return c.FunctionDef("void", name, DRAW_PARAMETERS, body, f"environment input {info.name}")

    def _one_of(
        self, drive: InputDrive, stream: str, index: c.CExpr
    ) -> tuple[list[c.CStmt], c.CExpr]:
        """One of the declared values of an input."""
        t = self.system.topics[drive.topic].type
        last = len(drive.values) - 1
        pick = c.CallExpr(
            "soter_drawn_int", (*_whom(stream), index, int_number(0), int_number(last))
        )
        name = c.Name("drawn_pick")
        value = self.types.constant(t, drive.values[last], "value")
        for k in range(last - 1, -1, -1):
            this = self.types.constant(t, drive.values[k], "value")
            value = c.Ternary(c.Binary("==", name, c.Number(str(k))), this, value)
        declared = c.Declare("int64_t", name.text, pick, const=True)
        return [declared, c.Unused(name.text)], self.types.to_store(t, value)

    def _drawn_leaf(
        self, t: Type, bound: Bound | None, stream: str, index: c.CExpr
    ) -> tuple[str, c.CExpr]:
        """One leaf of an input: its C type, and the draw."""
        if isinstance(t, FloatType):
            assert bound is not None
            return "double", self._uniform(stream, index, bound.low, bound.high)
        if isinstance(t, BoolType):
            drawn = c.CallExpr("soter_drawn_bool", (*_whom(stream), index))
            return "uint8_t", c.Cast("uint8_t", drawn)
        if isinstance(t, EnumType):
            low, high = 0, len(t.members) - 1
        else:
            assert isinstance(t, IntType)
            low, high = (int(bound.low), int(bound.high)) if bound else (t.low, t.high)
        limits = (int_number(low), int_number(high))
        drawn = c.CallExpr("soter_drawn_int", (*_whom(stream), index, *limits))
        return self.types.stored(t), self.types.to_store(t, drawn)

    # ------------------------------------------------------------ start

    def init(self, name: str) -> c.FunctionDef:
        """Defaults of topics, locals and plant states."""
        body: list[c.CStmt] = [self.state_pointer(), c.Unused("s"), c.Unused("answer")]
        for topic in self.system.topics:
            body += self._initial(self.topic(topic.index), topic.type, topic.default)
        for component in self.system.components:
            variables = (
                component.node.locals
                if component.node
                else component.plant.states
                if component.plant
                else ()
            )
            for i, v in enumerate(variables):
                target = self.member(component.index, v.name)
                interval = component.initial_range[i] if component.initial_range else None
                if interval is None:
                    body += self._initial(target, v.type, component.initial[i])
                    continue
                base = f"{component.name}.{v.name}.start"
                draws = [
                    self._uniform(".".join((base, *path)), c.Number("0"), *interval)
                    for path, _ in leaves(v.type)
                ]
                own = f"drawn_{component.index}_{i}"
                before, values = _in_order([("double", e) for e in draws], own)
                body += [*before, c.Assign(target, _assemble(self.types, v.type, iter(values)))]
        return c.FunctionDef("void", name, DRAW_PARAMETERS, tuple(body), "initial values")

    def _initial(self, target: c.CExpr, t: Type, value: Value) -> list[c.CStmt]:
        if value == default_value(t) and _is_zero(t, value):
            return []
        constant = self.types.constant(t, value, "initial")
        return [c.Assign(target, self.types.canonical(t, constant))]


def _whom(stream: str) -> tuple[c.CExpr, ...]:
    """The first arguments of a draw that a driver may answer."""
    return (HEADER, c.Name("answer"), stream_key(stream))


def _in_order(drawn: list[tuple[str, c.CExpr]], name: str) -> tuple[list[c.CStmt], list[c.CExpr]]:
    """Draws one after the other: C leaves the order inside an initializer open."""
    if len(drawn) == 1:
        return [], [drawn[0][1]]
    names = [f"{name}_{k}" for k in range(len(drawn))]
    before: list[c.CStmt] = [
        c.Declare(t, n, e, const=True) for n, (t, e) in zip(names, drawn, strict=True)
    ]
    return before, [c.Name(n) for n in names]


def _is_zero(t: Type, value: Value) -> bool:
    """Whether a default value is all zero bytes."""
    if isinstance(t, FloatType):
        return str(value) == "0.0"
    if isinstance(t, RecordType):
        return all(_is_zero(f, v) for (_, f), v in zip(t.fields, value, strict=True))
    if isinstance(t, ArrayType):
        return all(_is_zero(t.element, v) for v in value)
    if isinstance(t, ListType):
        return not value
    return not value


def _assemble(types: TypeTable, t: Type, values: object) -> c.CExpr:
    """A value of type `t` from its leaves in order."""
    if isinstance(t, RecordType):
        return c.Initializer(
            tuple((field_name(n), _assemble(types, f, values)) for n, f in t.fields),
            types.stored(t),
        )
    if isinstance(t, ArrayType):
        items = c.Initializer(
            tuple((None, _assemble(types, t.element, values)) for _ in range(t.size))
        )
        return c.Initializer((("at", items),), types.stored(t))
    value = next(values)  # type: ignore[call-overload]
    assert isinstance(value, c.CExpr)
    return value


def _leaf(e: c.CExpr, t: Type, index: int) -> c.CExpr:
    """Leaf number `index` of a value."""
    if isinstance(t, RecordType):
        for n, f in t.fields:
            count = sum(1 for _ in leaves(f))
            if index < count:
                return _leaf(c.Member(e, field_name(n)), f, index)
            index -= count
    if isinstance(t, ArrayType):
        count = sum(1 for _ in leaves(t.element))
        return _leaf(
            c.IndexExpr(c.Member(e, "at"), c.Number(str(index // count))), t.element, index % count
        )
    return e


def _vars(root: object) -> list[core.Var]:
    return [n for n in walk(root) if isinstance(n, core.Var)]

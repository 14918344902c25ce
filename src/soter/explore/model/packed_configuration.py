"""A configuration of the explorer: its struct, and how it is packed into words and read back.

Purpose: a `ConfigurationEmitter` writes the C. It decides which fields a packed configuration has,
in which order and how wide; times are relative to now, so that configurations with the same future
have the same bits.
Non-goals: how bits are written (`bit_packing.py`), the other tables of a model
(`explorer_model.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_types import int_number
from soter.core.layout import size_of
from soter.explore.model.bit_packing import Packing, as_u64, int_hulls, u64
from soter.language.model.types import leaves

if TYPE_CHECKING:
    from soter.codegen.c_types import TypeTable
    from soter.codegen.state_access import Frame
    from soter.core.layout import StateLayout
    from soter.explore.model.exploration_plan import ExplorationPlan
    from soter.language.model.system import Component, Module, System, TimedProperty, Topic

X, S, NOW, SINCE_START = c.Name("x"), c.Name("s"), c.Name("now"), c.Name("from")


@dataclass(frozen=True)
class AgeingField:
    """A packed field that changes as time passes; `kind`: a C constant; `most`: its largest one."""

    at: int
    width: int
    kind: str
    most: int = 0


def deadline_ns(system: System, t: TimedProperty) -> int:
    """The deadline of a timed property in ns; for an invariant, two periods of its module."""
    return t.within_ns if t.module is None else 2 * system.modules[t.module].period_ns


class ConfigurationEmitter:
    """Emits the struct, `pack` and `unpack`; `packing` says where each field lies in the words."""

    def __init__(
        self,
        system: System,
        plan: ExplorationPlan,
        types: TypeTable,
        frame: Frame,
        layout: StateLayout,
        prefix: str,
    ) -> None:
        assert system.test is not None
        self.system = system
        self.test = system.test
        self.plan = plan
        self.types = types
        self.frame = frame
        self.layout = layout
        self.prefix = prefix
        self.name = types.unique("configuration")
        self.size = 0
        """The bytes of a configuration, known once `struct_definition` was called."""
        self.held_at: dict[int, int] = {}
        """The offset in bytes of the `soter_held` of each actor that may overrun."""
        self.overrunning = [i for i, a in enumerate(plan.actors) if a.overrun_ns]
        self.ageing: list[AgeingField] = []
        """The fields that time alone changes."""
        self.calendar = 0
        """How many bits the time and the releases made take; they follow bit 0."""
        self.judged = {
            t.module: deadline_ns(system, t) for t in self.test.timed if t.module is not None
        }
        self.last_now = self._to_ticks(
            plan.horizon_ns + max((a.window_ns + a.overrun_ns for a in plan.actors), default=0)
        )
        self.packing = self._build_packing()

    def _to_ticks(self, ns: int) -> int:
        return ns // self.plan.tick_ns

    def _pack_ageing_field(
        self, p: Packing, value: c.CExpr, width: int, kind: str, most: int = 0
    ) -> c.CExpr:
        """Packs a field that changes as time passes, and adds it to `ageing`."""
        self.ageing.append(AgeingField(p.bits, width, kind, most))
        return p.add_field(value, width)

    def struct_definition(self) -> c.StructDef:
        """The C struct of a configuration, as soter_explore.h describes it."""
        actors, timeds = len(self.plan.actors), len(self.test.timed)
        modules = len(self.system.modules)
        members = [
            c.StructMember(f"{self.prefix}_state", "state"),
            c.StructMember("int64_t", "now"),
        ]
        counted = (
            ("int64_t", "due", timeds),
            ("int64_t", "verdict", modules),
            ("uint32_t", "done", actors),
            ("uint32_t", "lost", actors),
            ("uint8_t", "acted", modules),
        )
        members += [
            c.StructMember(type_name, name, count) for type_name, name, count in counted if count
        ]
        end = self.layout.size + 8 + 8 * timeds + 8 * modules + 8 * actors + modules
        members += _padding_members(end, 0)
        end += -end % 8
        for number in self.overrunning:
            self.held_at[number] = end
            members.append(c.StructMember("soter_held", f"held_{number}"))
            end += 16
            for position, topic in enumerate(self.plan.actors[number].outputs):
                type_name = self.system.topics[topic].type
                members.append(
                    c.StructMember(self.types.stored_type(type_name), f"held_{number}_{position}")
                )
                members += _padding_members(size_of(type_name), 1000 * number + position + 1)
                end += size_of(type_name) + -size_of(type_name) % 8
        self.size = end
        return c.StructDef(
            self.name, tuple(members), "a configuration, as soter_explore.h describes it"
        )

    # ------------------------------------------------------------ packing

    def _build_packing(self) -> Packing:
        p = Packing()
        p.add_field(u64(1), 1)
        p.label = ("time", 0)
        shown = c.Ternary(
            c.Binary("<", NOW, c.Number("0")), u64(0), c.Binary("+", as_u64(c.Name("n")), u64(1))
        )
        self.now_read = p.add_field(shown, (self.last_now + 1).bit_length())
        self._pack_schedule(p)
        self._pack_timed_properties(p)
        for module in self.system.modules:
            self._pack_module(p, module)
        p.unpack.append(c.Comment("components"))
        for component in self.system.components:
            self._pack_component(p, component)
        self._pack_stamps(p)
        self._pack_topics(p)
        for component in self.system.components:
            self._pack_variables(p, component)
        for number in self.overrunning:
            self._pack_held_outputs(p, number)
        p.store_last_word()
        return p

    def _pack_schedule(self, p: Packing) -> None:
        """Packs how far each actor's releases are ahead of those due; then its lost releases."""
        shared: dict[tuple[int, int, int], c.CExpr] = {}
        for number, actor in enumerate(self.plan.actors):
            key = (
                self._to_ticks(actor.window_ns),
                self._to_ticks(actor.phase_ns),
                self._to_ticks(actor.period_ns),
            )
            if key not in shared:
                shared[key] = self._required_releases(p, key)
            bias = actor.overrun_ns // actor.period_ns + 1 if actor.overrun_ns else 0
            most = actor.window_ns // actor.period_ns + 1 + bias
            p.label = ("done", number)
            done = c.IndexExpr(c.Arrow(X, "done"), c.Number(str(number)))
            ahead: c.CExpr = c.Binary("-", c.Cast("int64_t", done), shared[key])
            if bias:
                ahead = c.Binary("+", ahead, int_number(bias))
            got: c.CExpr = c.Cast("int64_t", p.add_field(as_u64(ahead), most.bit_length()))
            if bias:
                got = c.Binary("-", got, int_number(bias))
            p.unpack.append(c.Assign(done, c.Cast("uint32_t", c.Binary("+", shared[key], got))))
        self.calendar = p.bits - 1
        for number, actor in enumerate(self.plan.actors):
            p.label = ("lost", number)
            lost = c.IndexExpr(c.Arrow(X, "lost"), c.Number(str(number)))
            got = p.add_field(as_u64(lost), actor.skips.bit_length()) if actor.skips else u64(0)
            p.unpack.append(c.Assign(lost, c.Cast("uint32_t", got)))

    def _required_releases(self, p: Packing, key: tuple[int, int, int]) -> c.CExpr:
        """The releases that must have been made by now; `key`: window, phase, period in ticks."""
        name = p.new_name("must")
        times = *(int_number(t) for t in key), int_number(self._to_ticks(self.plan.horizon_ns))
        call = c.CallExpr("soter_must", (c.Name("n"), *times))
        for body in (p.pack, p.unpack):
            body.append(c.Declare("int64_t", name, call, const=True))
        return c.Name(name)

    def _pack_timed_properties(self, p: Packing) -> None:
        """Packs the open deadlines; for an invariant, its last verdict and whether SC has acted."""
        tick = int_number(self.plan.tick_ns)
        for number, timed in enumerate(self.test.timed):
            p.label = ("due", number)
            due = c.IndexExpr(c.Arrow(X, "due"), c.Number(str(number)))
            if timed.module is not None:
                p.unpack.append(c.Assign(due, c.Name("INT64_MAX")))
                continue
            width = (self._to_ticks(timed.within_ns) + 2).bit_length()
            packed = c.CallExpr("soter_pack_due", (due, SINCE_START, tick))
            got = self._pack_ageing_field(p, packed, width, "SOTER_DUE")
            p.unpack.append(c.Assign(due, c.CallExpr("soter_unpack_due", (got, SINCE_START, tick))))
        for module in range(len(self.system.modules)):
            p.label = ("verdict", module)
            verdict = c.IndexExpr(c.Arrow(X, "verdict"), c.Number(str(module)))
            acted = c.IndexExpr(c.Arrow(X, "acted"), c.Number(str(module)))
            if module not in self.judged:
                p.unpack.append(c.Assign(verdict, c.Number("0")))
                p.unpack.append(c.Assign(acted, c.Number("0")))
                continue
            most = self._to_ticks(self.judged[module]) + 1
            since = c.CallExpr("soter_pack_since", (verdict, SINCE_START, tick, u64(most)))
            got = self._pack_ageing_field(p, since, most.bit_length(), "SOTER_SINCE", most)
            ago = c.Binary("*", c.Cast("int64_t", got), tick)
            p.unpack.append(c.Assign(verdict, c.Binary("-", SINCE_START, ago)))
            got = p.add_field(as_u64(acted), 1)
            p.unpack.append(c.Assign(acted, c.Cast("uint8_t", got)))

    def _pack_module(self, p: Packing, module: Module) -> None:
        """Packs a module's mode and gate; a forced module has neither."""
        record = c.IndexExpr(c.Arrow(S, "modules"), c.Number(str(module.index)))
        mode: c.CExpr = c.Number("1U" if module.forced == "ac" else "0U")
        items: list[tuple[str | None, c.CExpr]] = []
        if module.forced is None:
            p.label = ("mode", module.index)
            mode = c.Cast("uint8_t", p.add_field(as_u64(c.Member(record, "mode")), 1))
            p.label = ("gate", module.index)
            if module.ac in self.plan.may_fault:
                fault = p.add_field(as_u64(c.Member(record, "gate_fault")), 1)
                needed = p.add_field(
                    as_u64(c.Member(record, "clean_needed")), module.clean.bit_length()
                )
                items.append(("clean_needed", c.Cast("uint32_t", needed)))
                items.append(("gate_fault", c.Cast("uint8_t", fault)))
        p.unpack.append(c.Assign(record, c.Initializer((*items, ("mode", mode)), "soter_module")))

    def _pack_component(self, p: Packing, component: Component) -> None:
        """Packs a component's latch and `had_control`; unpacking computes `oe` from the mode."""
        record = c.IndexExpr(c.Arrow(S, "components"), c.Number(str(component.index)))
        enabled = self._enabled_expression(component)
        items: list[tuple[str | None, c.CExpr]] = [("oe", enabled)]
        if component.index in self.plan.may_fault and component.role not in {"ac", "dm"}:
            p.label = ("latched", component.index)
            got = p.add_field(as_u64(c.Member(record, "latched")), 1)
            items.append(("latched", c.Cast("uint8_t", got)))
        if component.node is not None and component.node.takeover is not None:
            p.label = ("control", component.index)
            got = p.add_field(as_u64(c.Member(record, "had_control")), 1)
            items.append(("had_control", c.Cast("uint8_t", got)))
        p.unpack.append(c.Assign(record, c.Initializer(tuple(items), "soter_component")))

    def _enabled_expression(self, component: Component) -> c.CExpr:
        """The C condition that a component's outputs are enabled (OE), from the mode."""
        if component.role not in {"ac", "sc"}:
            return c.Number("1U")
        modules = c.Arrow(S, "modules")
        mode = c.Member(c.IndexExpr(modules, c.Number(str(component.module))), "mode")
        name = c.Name("SOTER_AC" if component.role == "ac" else "SOTER_SC")
        same = c.Binary("==", mode, c.Cast("uint8_t", name))
        return c.Ternary(same, c.Number("1U"), c.Number("0U"))

    def _pack_stamps(self, p: Packing) -> None:
        """Packs the ages that matter; all ages above the limit of a topic get the same value."""
        tick = int_number(self.plan.tick_ns)
        for topic in self.system.topics:
            p.label = ("stamp", topic.index)
            stamp = c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(topic.index)))
            if (
                topic.policy == "fault" and topic.index not in self.plan.aged
            ):  # the mark of a lost value
                never = c.Binary("==", stamp, c.Name("SOTER_NEVER"))
                got = p.add_field(c.Ternary(never, u64(0), u64(1)), 1)
                back: c.CExpr = c.Ternary(
                    c.Binary("==", got, u64(0)), c.Name("SOTER_NEVER"), c.Number("0")
                )
            elif topic.index in self.plan.aged:
                packed = c.CallExpr("soter_pack_stamp", (stamp, SINCE_START, tick))
                got = self._pack_ageing_field(
                    p, packed, (self.last_now + 1).bit_length(), "SOTER_STAMP"
                )
                back = c.CallExpr("soter_unpack_stamp", (got, SINCE_START, tick))
            elif topic.index in self.plan.limited and topic.max_age_ns is not None:
                most = self._to_ticks(topic.max_age_ns) + 1
                packed = c.CallExpr("soter_pack_since", (stamp, SINCE_START, tick, u64(most)))
                got = self._pack_ageing_field(p, packed, most.bit_length(), "SOTER_SINCE", most)
                back = c.CallExpr("soter_unpack_fresh", (got, SINCE_START, tick, u64(most)))
            else:
                back = c.Name("SOTER_NEVER")
            p.unpack.append(c.Assign(stamp, back))

    def _pack_topics(self, p: Packing) -> None:
        """Packs the values of the topics that something reads."""
        for topic in self.system.topics:
            if topic.index in self.plan.read:
                p.label = ("topic", topic.index)
                p.append_value(
                    self.frame.topic_place(topic.index), topic.type, self._int_ranges(topic)
                )

    def _int_ranges(self, t: Topic) -> list[tuple[int, int] | None]:
        """The range of each int in a topic, from its set and the values that it may start with."""
        values = [v for d in self.system.inputs if d.topic == t.source for v in d.values]
        values += [x.failsafe[t.source] for x in self.system.components if t.source in x.failsafe]
        if t.queue_of is not None:
            values = [tuple(values)]
        return int_hulls(t.type, t.bounds, [t.default, *values])

    def _pack_variables(self, p: Packing, component: Component) -> None:
        for number, variable in enumerate(component.variables):
            p.label = ("cell", component.index, variable.name)
            known = component.initial_range[number] if component.initial_range else None
            start = [] if known is not None else [component.initial[number]]
            none = [None for _ in leaves(variable.type)]
            p.append_value(
                self.frame.member_place(component.index, variable.name),
                variable.type,
                int_hulls(variable.type, none, start),
            )

    def _pack_held_outputs(self, p: Packing, number: int) -> None:
        """Packs the outputs that an overrunning step has not yet published."""
        p.label = ("held", number)
        actor, tick = self.plan.actors[number], int_number(self.plan.tick_ns)
        held = c.Arrow(X, f"held_{number}")
        since, mask = c.Member(held, "since"), c.Member(held, "mask")
        runs, present = p.new_name("runs"), p.new_name("mask")
        none = c.Binary("<", since, c.Number("0"))
        p.pack.append(
            c.Declare("uint64_t", runs, c.Ternary(none, u64(0), c.Name("UINT64_MAX")), const=True)
        )
        ago = c.CallExpr("soter_pack_since", (since, NOW, tick, c.Name("UINT64_MAX")))
        shown = c.Ternary(none, u64(0), c.Binary("+", ago, u64(1)))
        got = p.add_field(shown, (self._to_ticks(actor.overrun_ns) + 1).bit_length())
        began = p.new_name("ago")
        p.unpack.append(c.Declare("uint64_t", began, got, const=True))
        back = c.Binary(
            "-", NOW, c.Binary("*", c.Cast("int64_t", c.Binary("-", c.Name(began), u64(1))), tick)
        )
        p.unpack.append(
            c.Assign(since, c.Ternary(c.Binary("==", c.Name(began), u64(0)), c.Number("-1"), back))
        )
        p.pack.append(c.Declare("uint64_t", present, c.Binary("&", mask, c.Name(runs)), const=True))
        p.unpack.append(c.Assign(mask, p.add_field(c.Name(present), len(actor.outputs))))
        for position, index in enumerate(actor.outputs):
            topic = self.system.topics[index]
            bit = c.Binary("!=", c.Binary("&", c.Name(present), u64(1 << position)), u64(0))
            keep = p.new_name("keep")
            p.pack.append(c.Declare("uint64_t", keep, c.CallExpr("soter_if", (bit,)), const=True))
            place = c.Arrow(X, f"held_{number}_{position}")
            p.append_value(place, topic.type, self._int_ranges(topic), c.Name(keep))

    def pack_function(self, name: str) -> c.FunctionDef:
        """The C function that packs a configuration into words."""
        zero = c.Number("0")
        tick = u64(self.plan.tick_ns)
        ticks = c.Cast("int64_t", c.Binary("/", as_u64(NOW), tick))
        body = (
            c.Declare(f"const {self.name} *const ", "x", c.Name("configuration")),
            c.Declare(f"const {self.prefix}_state *const ", "s", c.Unary("&", c.Arrow(X, "state"))),
            c.Declare("int64_t", "now", c.Arrow(X, "now"), const=True),
            c.Declare(
                "int64_t", "from", c.Ternary(c.Binary("<", NOW, zero), zero, NOW), const=True
            ),
            c.Declare(
                "int64_t",
                "n",
                c.Ternary(c.Binary("<", NOW, zero), c.Number("-1"), ticks),
                const=True,
            ),
            *(c.Unused(n) for n in ("s", "from", "n")),
            c.Declare("uint64_t", "w", u64(0)),
            *self.packing.pack,
        )
        parameters = (("const void *", "configuration"), ("uint64_t *", "words"))
        doc = f"{self.packing.bits} bits of a configuration that decide what may follow"
        return c.FunctionDef("void", name, parameters, body, doc)

    def unpack_function(self, name: str) -> c.FunctionDef:
        """The C function that unpacks words; a field that is not packed gets a fixed value."""
        zero, n = c.Number("0"), c.Name("n")
        header = c.Arrow(S, "header")
        none = c.Initializer((("first_ns", c.Name("SOTER_NEVER")),), "soter_property")
        times = c.Ternary(
            c.Binary("<", n, zero), c.Number("-1"), c.Binary("*", n, int_number(self.plan.tick_ns))
        )
        body = (
            c.Declare(f"{self.name} *const ", "x", c.Name("configuration")),
            c.Declare(f"{self.prefix}_state *const ", "s", c.Unary("&", c.Arrow(X, "state"))),
            c.Declare(
                "int64_t",
                "n",
                c.Binary("-", c.Cast("int64_t", self.now_read), c.Number("1")),
                const=True,
            ),
            c.Declare("int64_t", "now", times, const=True),
            c.Declare(
                "int64_t", "from", c.Ternary(c.Binary("<", NOW, zero), zero, NOW), const=True
            ),
            c.Unused("from"),
            c.Assign(c.Arrow(X, "now"), NOW),
            c.Assign(c.Member(header, "ct"), NOW),
            c.Assign(c.Member(header, "violations"), u64(0)),
            c.Assign(c.Member(header, "firing"), u64(0)),
            *(
                c.Assign(c.IndexExpr(c.Arrow(S, "properties"), c.Number(str(q.index))), none)
                for q in self.system.properties
            ),
            *self.packing.unpack,
        )
        parameters = (("const uint64_t *", "words"), ("void *", "configuration"))
        return c.FunctionDef(
            "void",
            name,
            parameters,
            body,
            "the same, read back into a configuration that was started once",
        )


def _padding_members(size: int, number: int) -> list[c.StructMember]:
    """The struct member that fills `size` bytes up to a multiple of 8; [] if none is needed."""
    return [c.StructMember("uint8_t", f"pad_{number}", -size % 8)] if size % 8 else []

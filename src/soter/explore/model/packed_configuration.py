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
from soter.explore.model.bit_packing import Packing, hulls, unsigned, word
from soter.language.model.system import modules_above
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
    """A packed field that time alone changes; `kind`: a constant of soter_explore.h; bits."""

    at: int
    width: int
    kind: str
    most: int = 0


def within(system: System, t: TimedProperty) -> int:
    """The deadline of a timed property in ns; for an invariant 2 periods of its module."""
    return t.within_ns if t.module is None else 2 * system.modules[t.module].period_ns


class ConfigurationEmitter:
    """Emits the struct, `pack` and `unpack`; `packing`: where the fields lie in the words."""

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
        """The bytes of a configuration, known once `struct` was called."""
        self.held_at: dict[int, int] = {}
        """The offset in bytes of the `soter_held` of each actor that may overrun."""
        self.overrunning = [i for i, a in enumerate(plan.actors) if a.overrun_ns]
        self.ageing: list[AgeingField] = []
        """The fields that time alone changes."""
        self.calendar = 0
        """How many bits now and the releases made take: the first ones but for one."""
        self.judged = {t.module: within(system, t) for t in self.test.timed if t.module is not None}
        self.last_now = self._ticks(
            plan.horizon_ns + max((a.window_ns + a.overrun_ns for a in plan.actors), default=0)
        )
        self.packing = self._packing()

    def _ticks(self, ns: int) -> int:
        return ns // self.plan.tick_ns

    def _add_age(self, p: Packing, value: c.CExpr, width: int, kind: str, most: int = 0) -> c.CExpr:
        """Packs a field that time alone changes."""
        self.ageing.append(AgeingField(p.bits, width, kind, most))
        return p.field(value, width)

    def struct(self) -> c.StructDef:
        """The struct of soter_explore.h with the sizes of this system."""
        actors, timeds, modules = (
            len(self.plan.actors),
            len(self.test.timed),
            len(self.system.modules),
        )
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
        members += [c.StructMember(t, n, count) for t, n, count in counted if count]
        end = self.layout.size + 8 + 8 * timeds + 8 * modules + 8 * actors + modules
        members += _padding(end, 0)
        end += -end % 8
        for i in self.overrunning:
            self.held_at[i] = end
            members.append(c.StructMember("soter_held", f"held_{i}"))
            end += 16
            for k, topic in enumerate(self.plan.actors[i].outputs):
                t = self.system.topics[topic].type
                members.append(c.StructMember(self.types.stored(t), f"held_{i}_{k}"))
                members += _padding(size_of(t), 1000 * i + k + 1)
                end += size_of(t) + -size_of(t) % 8
        self.size = end
        return c.StructDef(
            self.name, tuple(members), "a configuration, as soter_explore.h describes it"
        )

    # ------------------------------------------------------------ packing

    def _packing(self) -> Packing:
        p = Packing()
        p.field(word(1), 1)
        p.label = ("time", 0)
        shown = c.Ternary(
            c.Binary("<", NOW, c.Number("0")),
            word(0),
            c.Binary("+", unsigned(c.Name("n")), word(1)),
        )
        self.now_read = p.field(shown, (self.last_now + 1).bit_length())
        self._schedule(p)
        self._obligations(p)
        for m in self.system.modules:
            self._module(p, m)
        p.unpack.append(c.Comment("components"))
        for x in self.system.components:
            self._component_record(p, x)
        self._stamps(p)
        self._topic_values(p)
        for x in self.system.components:
            self._variables(p, x)
        for i in self.overrunning:
            self._held(p, i)
        p.finish()
        return p

    def _schedule(self, p: Packing) -> None:
        """Packs each actor's releases, relative to those that it must have made; then lost ones."""
        shared: dict[tuple[int, int, int], c.CExpr] = {}
        for i, a in enumerate(self.plan.actors):
            key = (self._ticks(a.window_ns), self._ticks(a.phase_ns), self._ticks(a.period_ns))
            if key not in shared:
                shared[key] = self._required_releases(p, key)
            bias = a.overrun_ns // a.period_ns + 1 if a.overrun_ns else 0
            most = a.window_ns // a.period_ns + 1 + bias
            p.label = ("done", i)
            done = c.IndexExpr(c.Arrow(X, "done"), c.Number(str(i)))
            ahead: c.CExpr = c.Binary("-", c.Cast("int64_t", done), shared[key])
            if bias:
                ahead = c.Binary("+", ahead, int_number(bias))
            got: c.CExpr = c.Cast("int64_t", p.field(unsigned(ahead), most.bit_length()))
            if bias:
                got = c.Binary("-", got, int_number(bias))
            p.unpack.append(c.Assign(done, c.Cast("uint32_t", c.Binary("+", shared[key], got))))
        self.calendar = p.bits - 1
        for i, a in enumerate(self.plan.actors):
            p.label = ("lost", i)
            lost = c.IndexExpr(c.Arrow(X, "lost"), c.Number(str(i)))
            got = p.field(unsigned(lost), a.skips.bit_length()) if a.skips else word(0)
            p.unpack.append(c.Assign(lost, c.Cast("uint32_t", got)))

    def _required_releases(self, p: Packing, key: tuple[int, int, int]) -> c.CExpr:
        """The releases that must have been made by now; `key`: window, phase, period in ticks."""
        name = p.name("must")
        times = *(int_number(t) for t in key), int_number(self._ticks(self.plan.horizon_ns))
        call = c.CallExpr("soter_must", (c.Name("n"), *times))
        for body in (p.pack, p.unpack):
            body.append(c.Declare("int64_t", name, call, const=True))
        return c.Name(name)

    def _obligations(self, p: Packing) -> None:
        """Packs the state of the timed properties."""
        tick = int_number(self.plan.tick_ns)
        for i, t in enumerate(self.test.timed):
            p.label = ("due", i)
            due = c.IndexExpr(c.Arrow(X, "due"), c.Number(str(i)))
            if t.module is not None:
                p.unpack.append(c.Assign(due, c.Name("INT64_MAX")))
                continue
            width = (self._ticks(t.within_ns) + 2).bit_length()
            packed = c.CallExpr("soter_pack_due", (due, SINCE_START, tick))
            got = self._add_age(p, packed, width, "SOTER_DUE")
            p.unpack.append(c.Assign(due, c.CallExpr("soter_unpack_due", (got, SINCE_START, tick))))
        for m in range(len(self.system.modules)):
            p.label = ("verdict", m)
            verdict = c.IndexExpr(c.Arrow(X, "verdict"), c.Number(str(m)))
            acted = c.IndexExpr(c.Arrow(X, "acted"), c.Number(str(m)))
            if m not in self.judged:
                p.unpack.append(c.Assign(verdict, c.Number("0")))
                p.unpack.append(c.Assign(acted, c.Number("0")))
                continue
            most = self._ticks(self.judged[m]) + 1
            since = c.CallExpr("soter_pack_since", (verdict, SINCE_START, tick, word(most)))
            got = self._add_age(p, since, most.bit_length(), "SOTER_SINCE", most)
            ago = c.Binary("*", c.Cast("int64_t", got), tick)
            p.unpack.append(c.Assign(verdict, c.Binary("-", SINCE_START, ago)))
            got = p.field(unsigned(acted), 1)
            p.unpack.append(c.Assign(acted, c.Cast("uint8_t", got)))

    def _module(self, p: Packing, m: Module) -> None:
        """Packs a module's mode and gate; of a forced module nothing, as neither has an effect."""
        record = c.IndexExpr(c.Arrow(S, "modules"), c.Number(str(m.index)))
        mode: c.CExpr = c.Number("1U" if m.forced == "ac" else "0U")
        items: list[tuple[str | None, c.CExpr]] = []
        if m.forced is None:
            p.label = ("mode", m.index)
            mode = c.Cast("uint8_t", p.field(unsigned(c.Member(record, "mode")), 1))
            p.label = ("gate", m.index)
            if m.ac in self.plan.may_fault:
                fault = p.field(unsigned(c.Member(record, "gate_fault")), 1)
                needed = p.field(unsigned(c.Member(record, "clean_needed")), m.clean.bit_length())
                items.append(("clean_needed", c.Cast("uint32_t", needed)))
                items.append(("gate_fault", c.Cast("uint8_t", fault)))
        p.unpack.append(c.Assign(record, c.Initializer((*items, ("mode", mode)), "soter_module")))

    def _component_record(self, p: Packing, x: Component) -> None:
        """Packs a component's latch and `had_control`; OE follows from the modes."""
        record = c.IndexExpr(c.Arrow(S, "components"), c.Number(str(x.index)))
        enabled = self._enabled(x)
        items: list[tuple[str | None, c.CExpr]] = [("oe", enabled)]
        if x.index in self.plan.may_fault and x.role not in {"ac", "dm"}:
            p.label = ("latched", x.index)
            got = p.field(unsigned(c.Member(record, "latched")), 1)
            items.append(("latched", c.Cast("uint8_t", got)))
        if x.node is not None and x.node.takeover is not None:
            p.label = ("control", x.index)
            got = p.field(unsigned(c.Member(record, "had_control")), 1)
            items.append(("had_control", c.Cast("uint8_t", got)))
        p.unpack.append(c.Assign(record, c.Initializer(tuple(items), "soter_component")))

    def _enabled(self, x: Component) -> c.CExpr:
        """OE of a component, an expression over the modes."""
        if x.module is None:
            return c.Number("1U")
        wanted = [(m, "ac") for m in modules_above(self.system, x.module)]
        if x.role in {"ac", "sc"}:
            wanted.append((self.system.modules[x.module], x.role))
        holds: c.CExpr | None = None
        for m, role in wanted:
            mode = c.Member(c.IndexExpr(c.Arrow(S, "modules"), c.Number(str(m.index))), "mode")
            name = c.Name("SOTER_AC" if role == "ac" else "SOTER_SC")
            same = c.Binary("==", mode, c.Cast("uint8_t", name))
            holds = same if holds is None else c.Binary("&&", holds, same)
        return c.Number("1U") if holds is None else c.Ternary(holds, c.Number("1U"), c.Number("0U"))

    def _stamps(self, p: Packing) -> None:
        """Packs the ages that matter, up to where they stop mattering."""
        tick = int_number(self.plan.tick_ns)
        for t in self.system.topics:
            p.label = ("stamp", t.index)
            stamp = c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(t.index)))
            if t.policy == "fault" and t.index not in self.plan.aged:  # the mark of a lost value
                never = c.Binary("==", stamp, c.Name("SOTER_NEVER"))
                got = p.field(c.Ternary(never, word(0), word(1)), 1)
                back: c.CExpr = c.Ternary(
                    c.Binary("==", got, word(0)), c.Name("SOTER_NEVER"), c.Number("0")
                )
            elif t.index in self.plan.aged:
                packed = c.CallExpr("soter_pack_stamp", (stamp, SINCE_START, tick))
                got = self._add_age(p, packed, (self.last_now + 1).bit_length(), "SOTER_STAMP")
                back = c.CallExpr("soter_unpack_stamp", (got, SINCE_START, tick))
            elif t.index in self.plan.limited and t.max_age_ns is not None:
                most = self._ticks(t.max_age_ns) + 1
                packed = c.CallExpr("soter_pack_since", (stamp, SINCE_START, tick, word(most)))
                got = self._add_age(p, packed, most.bit_length(), "SOTER_SINCE", most)
                back = c.CallExpr("soter_unpack_fresh", (got, SINCE_START, tick, word(most)))
            else:
                back = c.Name("SOTER_NEVER")
            p.unpack.append(c.Assign(stamp, back))

    def _topic_values(self, p: Packing) -> None:
        """Packs the topics that something reads."""
        for t in self.system.topics:
            if t.index in self.plan.read:
                p.label = ("topic", t.index)
                p.value(self.frame.topic(t.index), t.type, self._int_ranges(t))

    def _int_ranges(self, t: Topic) -> list[tuple[int, int] | None]:
        """The ranges of a topic's ints: its set, and whatever it may start with."""
        source = t.index if t.queue_of is None else t.queue_of
        given = [v for d in self.system.inputs if d.topic == source for v in d.values]
        given += [x.failsafe[source] for x in self.system.components if source in x.failsafe]
        if t.queue_of is not None:
            given = [tuple(given)]
        return hulls(t.type, t.bounds, [t.default, *given])

    def _variables(self, p: Packing, x: Component) -> None:
        """Packs a component's locals and plant states."""
        symbol = x.node or x.plant
        if symbol is None:
            return
        variables = x.node.locals if x.node else x.plant.states if x.plant else ()
        for i, v in enumerate(variables):
            p.label = ("cell", x.index, v.name)
            known = x.initial_range[i] if x.initial_range else None
            start = [] if known is not None else [x.initial[i]]
            none = [None for _ in leaves(v.type)]
            p.value(self.frame.member(x.index, v.name), v.type, hulls(v.type, none, start))

    def _held(self, p: Packing, i: int) -> None:
        """Packs what a step that still runs will publish."""
        p.label = ("held", i)
        actor, tick = self.plan.actors[i], int_number(self.plan.tick_ns)
        held = c.Arrow(X, f"held_{i}")
        since, mask = c.Member(held, "since"), c.Member(held, "mask")
        runs, present = p.name("runs"), p.name("mask")
        none = c.Binary("<", since, c.Number("0"))
        p.pack.append(
            c.Declare("uint64_t", runs, c.Ternary(none, word(0), c.Name("UINT64_MAX")), const=True)
        )
        ago = c.CallExpr("soter_pack_since", (since, NOW, tick, c.Name("UINT64_MAX")))
        shown = c.Ternary(none, word(0), c.Binary("+", ago, word(1)))
        got = p.field(shown, (self._ticks(actor.overrun_ns) + 1).bit_length())
        began = p.name("ago")
        p.unpack.append(c.Declare("uint64_t", began, got, const=True))
        back = c.Binary(
            "-", NOW, c.Binary("*", c.Cast("int64_t", c.Binary("-", c.Name(began), word(1))), tick)
        )
        p.unpack.append(
            c.Assign(since, c.Ternary(c.Binary("==", c.Name(began), word(0)), c.Number("-1"), back))
        )
        p.pack.append(c.Declare("uint64_t", present, c.Binary("&", mask, c.Name(runs)), const=True))
        p.unpack.append(c.Assign(mask, p.field(c.Name(present), len(actor.outputs))))
        for k, index in enumerate(actor.outputs):
            topic = self.system.topics[index]
            bit = c.Binary("!=", c.Binary("&", c.Name(present), word(1 << k)), word(0))
            keep = p.name("keep")
            p.pack.append(c.Declare("uint64_t", keep, c.CallExpr("soter_if", (bit,)), const=True))
            place = c.Arrow(X, f"held_{i}_{k}")
            p.value(place, topic.type, self._int_ranges(topic), c.Name(keep))

    def pack(self, name: str) -> c.FunctionDef:
        """The C function that packs a configuration into words."""
        zero = c.Number("0")
        tick = word(self.plan.tick_ns)
        ticks = c.Cast("int64_t", c.Binary("/", unsigned(NOW), tick))
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
            c.Declare("uint64_t", "w", word(0)),
            *self.packing.pack,
        )
        parameters = (("const void *", "configuration"), ("uint64_t *", "words"))
        doc = f"{self.packing.bits} bits of a configuration that decide what may follow"
        return c.FunctionDef("void", name, parameters, body, doc)

    def unpack(self, name: str) -> c.FunctionDef:
        """The C function that reads words back; what decides nothing gets its first values."""
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
            c.Assign(c.Member(header, "violations"), word(0)),
            c.Assign(c.Member(header, "firing"), word(0)),
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


def _padding(size: int, number: int) -> list[c.StructMember]:
    """The padding bytes up to a multiple of 8."""
    return [c.StructMember("uint8_t", f"pad_{number}", -size % 8)] if size % 8 else []

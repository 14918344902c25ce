"""Elaborates the `faults { ... }` of a system: which component, how often, in which assumption.

Purpose: turns each `SystemFaultSymbol` into `Fault`s, one for each component, with diagnostics for
impossible ones, and decides whether the assumptions of proofs still hold with them.
`components_named` finds a component by the path in a fault or a test; `refuse_path` reports that
no component has the path.
Non-goals: what a fault does (`semantics/faults.py`, `codegen/faults.py`), tests
(`language/elaborate/tested_system.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.language.check.dots_and_brackets import quoted
from soter.language.elaborate.passes.memory_topics import add_held_topic, refuse_overrun
from soter.language.elaborate.passes.step_times import with_wait_faults
from soter.language.model.system import Fault
from soter.language.model.types import FloatType, IntType, has_list, leaves, show_ns

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.elaborate.passes.flattening import Flattening
    from soter.language.model import typed
    from soter.language.model.system import Component, Module, System, Topic

    _Target = tuple[Component, int | None, tuple[int, ...], int | None]
    """What an item hits: component, topic, leaves and disturbance."""


def components_named(system: System, path: str) -> list[Component]:
    """Gives the components with this full name, or if none has it, those with it as an alias."""
    matches = [c for c in system.components if c.name == path]
    return matches or [c for c in system.components if path in _aliases(system, c)]


def _aliases(system: System, c: Component) -> set[str]:
    """Gives the other names of a component besides its full name, the same as in `replace`."""
    if c.node is None:
        return set()
    symbols = [c.node]
    aliases: set[str] = set()
    if c.module is not None:
        module = system.modules[c.module]
        symbols.append(module.symbol.ac if c.role == "ac" else module.symbol.sc)
        aliases |= {f"{module.name}.{s.name.rpartition('.')[2]}" for s in symbols}
    return aliases | {s.name for s in symbols} | {s.name.rpartition(".")[2] for s in symbols}


def refuse_path(
    system: System, path: str, span: Span, diagnostics: Diagnostics, *, verb: str, plants: bool
) -> None:
    """Reports E009 for a path of no component that could `verb`; `plants`: plants count, too."""
    known = [c.name for c in system.components if plants or c.role != "plant"]
    head, _, last = path.rpartition(".")
    inside = [n for n in known if n.startswith(f"{head}.") and n.endswith(f".{last}")]
    helps = diagnostics.did_you_mean(path, known, span)
    if len(inside) == 1:
        helps = (f"of a module's controller the name has the module's in it: `{inside[0]}`",)
    if any(m.name == path for m in system.modules):
        helps = (f"its decision module is `{path}.dm`",)
    kind = "component" if plants else "node"
    diagnostics.error(
        "E009",
        f"this system has no {kind} `{path}` that could {verb}",
        span,
        notes=(f"what steps is {quoted(known)}",) if known else (),
        helps=helps,
    )


GROUPS = ("all", "modules")
"""Targets of timing faults: all nodes and DMs, or only those of modules."""
APART = ("late", "skip", "silent")
"""Kinds that may not last longer than declared, and so never fill two slots in a row."""
APART_MOST = 0.25
"""The largest share of slots that such a fault can have."""
OFTEN = 0.999
"""The largest probability that a release is skipped; with more hardly any would run."""
ALWAYS = 1.0
LATE_MAX_NS = 3_600_000_000_000
TIMED = ("late", "overrun")
GIVEN = (*TIMED, "bias", "noise", "scale")


def add_faults(flat: Flattening, system: System) -> None:
    """Adds the faults that the system declares, and sets `shuffled`.

    Topics that hold the outputs of steps that overrun come last.
    """
    if not flat.symbol.faults:
        return
    places = _FaultPlacer(flat, system)
    faults = [f for item in flat.symbol.faults for f in places.faults_of(item)]
    places.enter_covering_assumptions(faults)
    system.shuffled = any(item.kind == "order" for item in flat.symbol.faults)
    system.faults = with_wait_faults(system.modules, faults, shuffled=system.shuffled)
    for f in system.faults:
        if f.kind == "overrun":
            add_held_topic(flat, system.components[f.component])
            refuse_overrun(system, system.components[f.component], f.text, flat.diagnostics)
    system.topics = tuple(flat.topics)


class _FaultPlacer:
    def __init__(self, flat: Flattening, system: System) -> None:
        self.flat = flat
        self.diagnostics = flat.diagnostics
        self.system = system
        self.streams: dict[str, int] = {}

    def faults_of(self, item: typed.SystemFaultSymbol) -> Iterator[Fault]:
        """Yields the faults of an item, one for each component; none after a reported error."""
        if item.kind == "order":
            return
        lasts = self.flat.duration_ns(item.lasts, f"how long `{item.kind}` lasts") or 0
        amount = self._amount_of(item, lasts)
        rate = self._rate_per_s(item)
        if amount is None or rate is None:
            return
        streams: dict[int, str] = {}
        now_and_then = item.kind == "late" and item.rate is not None
        together = item.path in GROUPS and now_and_then
        shared = self._new_stream_name(item) if together else None
        slot = int(amount[0]) if now_and_then else lasts
        apart = slot > 0 and item.kind in APART
        for c, topic, leaf_indices, disturbance in self._targets_of(item):
            p = self._probability_of_slot(item, rate, slot or c.period_ns, apart=apart)
            if p is None or self._leaves_no_release(item, amount, c):
                return
            if c.index not in streams:
                streams[c.index] = shared or self._new_stream_name(item, c)
            fault = Fault(
                kind=item.kind,
                component=c.index,
                stream=streams[c.index],
                probability=p,
                slot_ns=slot,
                amount=amount,
                topic=topic,
                leaves=leaf_indices,
                disturbance=disturbance,
                apart=apart,
                text=item.text,
            )
            yield fault

    def _leaves_no_release(
        self, item: typed.SystemFaultSymbol, amount: tuple[float, ...], c: Component
    ) -> bool:
        """Whether a component would be so late that it never runs; reports V011 if so."""
        never = item.kind == "late" and item.rate is None and amount[0] >= c.period_ns
        if never:
            self._refuse(item, f"leaves `{c.name}` no release: each is lost to the next one")
        return never

    def _new_stream_name(self, item: typed.SystemFaultSymbol, c: Component | None = None) -> str:
        """Gives a new stream name; a second fault of the same kind and place gets another name."""
        where = item.path if c is None or c.name == item.path else f"{c.name}.{item.path}"
        name = f"fault.{item.kind}.{where}"
        count = self.streams[name] = self.streams.get(name, 0) + 1
        return name if count == 1 else f"{name}#{count}"

    # ------------------------------------------------------------ numbers

    def _rate_per_s(self, item: typed.SystemFaultSymbol) -> float | None:
        """Gives the rate of a fault per second; 0 if it always acts, None after an error."""
        if item.rate is None or item.per is None:
            return 0.0
        rate = self.flat.value_of(item.rate, "how often")
        per = self.flat.duration_ns(item.per, "`per`")
        if rate is None or per is None:
            return None
        if not (math.isfinite(rate) and rate >= 0.0):
            self._refuse(item, f"cannot happen {rate!r} times: give a number that is not negative")
            return None
        return float(rate) / (per / 1e9)

    def _amount_of(self, item: typed.SystemFaultSymbol, lasts: int) -> tuple[float, ...] | None:
        numbers = [self.flat.value_of(e, f"`{item.kind}`") for e in item.by]
        values = [v for v in numbers if v is not None]
        if len(values) != len(numbers):
            return None
        if not values and item.kind in GIVEN:
            return None  # the parser has reported it
        if item.kind == "overrun":
            if not 0 < values[0] <= LATE_MAX_NS:
                self._refuse(item, "is by a time of more than 0 and at most 1 h")
                return None
            return (values[0],)
        if item.kind == "late":
            return self._quantiles_of_lateness(item, values, lasts)
        if any(not math.isfinite(v) for v in values) or len(values) > 1:
            self._refuse(item, "is by one finite number")
            return None
        return tuple(float(v) for v in values)

    def _quantiles_of_lateness(
        self, item: typed.SystemFaultSymbol, values: list[float], lasts: int
    ) -> tuple[float, ...] | None:
        """Gives the ascending quantiles of the lateness, in ns; None after a reported error."""
        if any(not 0 <= v <= LATE_MAX_NS for v in values) or values != sorted(values):
            self._refuse(item, "is by times from 0 to 1 h, the shorter ones first")
            return None
        if item.rate is not None and (len(values) > 1 or values[0] <= 0 or lasts):
            self._refuse(item, "that happens now and then is by one time, which is its length")
            return None
        if item.rate is None and len(values) == 1:
            values = [0, *values]
        return tuple(values)

    def _probability_of_slot(
        self, item: typed.SystemFaultSymbol, rate: float, slot_ns: int, *, apart: bool
    ) -> float | None:
        """Gives the probability that a slot has the fault, from its rate; None after an error."""
        if item.rate is None:
            return 1.0
        share = rate * (slot_ns / 1e9)
        most = APART_MOST if apart else ALWAYS if item.kind != "skip" else OFTEN
        if share > most:
            often = show_ns(round(slot_ns / most))
            length = f"lasts {show_ns(slot_ns)}" if item.lasts or apart else "is about one release"
            self._refuse(item, f"happens too often: it {length}, so at most once in {often}")
            return None
        return (1.0 - math.sqrt(1.0 - 4.0 * share)) / 2.0 if apart else share

    def _refuse(self, item: typed.SystemFaultSymbol, problem: str) -> None:
        self.diagnostics.error("V011", f"`{item.kind}` {problem}", item.span)

    # ------------------------------------------------------------ targets

    def _targets_of_group(self, item: typed.SystemFaultSymbol) -> list[_Target]:
        if item.kind == "overrun":
            self._refuse_target(item, f"not all nodes of `{item.path}` can: name those that shall")
            return []
        if item.kind not in {"late", "skip"}:
            self._refuse_target(item, f"`{item.path}` stands for nodes whose time is disturbed")
            return []
        wanted = ("dm", "sc", "ac") if item.path == "modules" else ("dm", "sc", "ac", "node")
        components = [c for c in self.system.components if c.role in wanted]
        return [(c, None, (), None) for c in components]

    def _targets_of(self, item: typed.SystemFaultSymbol) -> list[_Target]:
        if item.path in GROUPS:
            return self._targets_of_group(item)
        parts = item.path.split(".")
        for count in range(len(parts), 0, -1):
            components = components_named(self.system, ".".join(parts[:count]))
            if components:
                return [x for c in components for x in self._targets_in(item, c, parts[count:])]
        if not self.flat.partial:
            verb = f"have a fault `{item.kind}`"
            refuse_path(self.system, item.path, item.span, self.diagnostics, verb=verb, plants=True)
        return []

    def _targets_in(
        self, item: typed.SystemFaultSymbol, c: Component, rest: Sequence[str]
    ) -> Iterator[_Target]:
        if item.kind in {"late", "skip"}:
            if rest:
                self._refuse_target(item, f"`{c.name}` has no `{'.'.join(rest)}` that is released")
            elif c.plant is not None:
                self._refuse_target(item, "physical time is never skewed")
            else:
                yield c, None, (), None
            return
        if item.kind == "overrun":
            why = _why_no_overrun(c, rest)
            if why is None:
                yield c, None, (), None
            else:
                self._refuse_target(item, why)
            return
        if c.role == "dm":
            self._refuse_target(item, "a decision module publishes nothing")
            return
        drawn = [i for i, d in enumerate(c.disturbances) if [d.variable.name] == list(rest[:1])]
        if drawn and item.kind == "scale":
            if len(rest) > 1:
                self._refuse_target(item, f"all of `{c.name}.{rest[0]}` is scaled, no part of it")
                return
            yield c, None, (), drawn[0]
            return
        yield from self._targets_published(item, c, rest)

    def _targets_published(
        self, item: typed.SystemFaultSymbol, c: Component, rest: Sequence[str]
    ) -> Iterator[_Target]:
        parts = [x for part in rest for x in part.replace("[", ".[").split(".") if x]
        topics = [t for t in c.published if not parts or t.name.rpartition(".")[2] == parts[0]]
        found_any, below = False, parts[1:]
        for symbol in topics:
            if item.kind != "silent" and not _publishes_one_value(c, symbol):
                if rest:
                    self._refuse_target(item, f"`{symbol.name}` is not one value of fixed size")
                    return
                continue
            topic = c.scope.topics[symbol]
            indices = _leaves_to_hit(item.kind, self.system.topics[topic], below)
            if indices:
                found_any = True
                yield c, topic, indices, None
        if not found_any:
            self._report_nothing_to_hit(item, c, rest)
        elif c.plant is not None and item.kind == "nan":
            self._refuse_target(item, "a reading that is no number reaches no topic: say `silent`")

    def _report_nothing_to_hit(
        self, item: typed.SystemFaultSymbol, c: Component, rest: Sequence[str]
    ) -> None:
        place = f"`{'.'.join(rest)}` of `{c.name}`" if rest else f"what `{c.name}` publishes"
        names = [t.name.rpartition(".")[2] for t in c.published]
        also = [f"`{c.name}` publishes {quoted(names)}"] if names else []
        self._refuse_target(item, f"{place} is nothing that `{item.kind}` could hit", *also)

    def _refuse_target(self, item: typed.SystemFaultSymbol, *why: str) -> None:
        self.diagnostics.error(
            "E018", f"`{item.kind} {item.path}` cannot happen", item.span, notes=why
        )

    # ------------------------------------------------------------ whether proofs cover a fault

    def enter_covering_assumptions(self, faults: Sequence[Fault]) -> None:
        """Sets in each fault why proofs cover it (`inside`); times of one component add up."""
        for f in faults:
            f.inside = self._covering_reason(f, self.system.components[f.component], faults)

    def _covering_reason(self, fault: Fault, c: Component, faults: Sequence[Fault]) -> str | None:
        """Gives the reason why assumptions of proofs hold with a fault; None if one may not."""
        if c.role == "ac" and not self._must_publish(c, fault):
            return "AC may do anything"
        if fault.disturbance is not None:
            d = c.disturbances[fault.disturbance]
            low, high = sorted(fault.amount[0] * x for x in (d.low, d.high))
            return "in its declared range" if d.low <= low and high <= d.high else None
        if fault.kind in TIMED:
            return self._time_reason(fault, c, faults)
        if fault.kind == "silent" and c.plant is not None:
            return self._dropout_reason(fault, c, faults)
        return None

    def _must_publish(self, c: Component, fault: Fault) -> bool:
        """Whether some proof assumes that this AC steps and publishes at each release."""
        blocks = [m.symbol.verify for m in self.system.modules]
        return fault.kind in {"late", "skip", "silent", "overrun"} and any(
            b.induction is not None
            for m, b in zip(self.system.modules, blocks, strict=True)
            if c.index == m.ac or c.index in self._nodes_around(m)
        )

    def _declared_ns(self, m: Module, expr: typed.TypedExpr | None) -> float | None:
        """Gives a time of a `verify` block in ns, computed with the parameters of the module."""
        with self.flat.with_params(m.scope.params):
            value = self.flat.value_of(expr, "a time of `verify`")
        return None if value is None else float(value)

    def _time_reason(self, fault: Fault, c: Component, faults: Sequence[Fault]) -> str | None:
        """Gives the reason why `late` or `response` covers such faults of `c`; None if not."""
        timed = [f for f in faults if f.kind in TIMED and f.component == c.index]
        most = sum(int(f.amount[-1]) for f in timed if f.kind == fault.kind)
        if fault.kind == "late":
            return self._late_reason(c, most)
        lost = sum(int(f.amount[-1]) for f in timed) >= c.period_ns
        return None if lost or c.takes_ns is not None else self._response_reason(c, most)

    def _late_reason(self, c: Component, most: int) -> str | None:
        """Gives the reason why `late` of all modules that need `c` covers `most` ns; or None."""
        declared = []
        for m in self.system.modules:
            block = m.symbol.verify
            by_name = _by_full_name(m, block.late_of)
            if c.index in (m.dm, m.sc):
                declared.append((m, block.late_dm if c.index == m.dm else block.late_sc))
            elif c.name in by_name or (
                (c.module is None or (c.role == "ac" and block.induction is not None))
                and c.index in self._nodes_around(m)
            ):
                declared.append((m, by_name.get(c.name)))
        takes = 0 if c.takes_ns is None else c.takes_ns[1]
        if not declared or most >= c.period_ns or most + takes > c.period_ns:
            return None  # a release would be lost
        values = [self._declared_ns(m, e) for m, e in declared]
        return "as late as declared" if _are_at_least(values, most) else None

    def _response_reason(self, c: Component, most: int) -> str | None:
        """Gives the reason why `response` of modules that need `c` covers `most` ns; or None."""
        declared = []
        for m in self.system.modules:
            by_name = _by_full_name(m, m.symbol.verify.response_of)
            if c.name in by_name or c.index in self._nodes_around(m) or c.index == m.ac:
                declared.append(self._declared_ns(m, by_name.get(c.name)))
        return "no longer than its declared `response`" if _are_at_least(declared, most) else None

    def _dropout_reason(self, fault: Fault, c: Component, faults: Sequence[Fault]) -> str | None:
        """Gives the reason why `dropout` in all modules covers a plant's silences; None if not.

        A silence shorter than a period still loses a release, and two silences may be adjacent.
        """
        assert c.plant is not None
        silent = {f.stream: f for f in faults if f.kind == "silent" and f.component == c.index}
        lost = sum(max(f.slot_ns - 1, 0) // c.period_ns + 1 for f in silent.values())
        values = [self._declared_ns(m, m.symbol.verify.dropout) for m in self.system.modules]
        fits = _are_at_least(values, lost * c.period_ns)
        return "as silent as `dropout` says" if fits and fault.slot_ns else None

    def _nodes_around(self, m: Module) -> set[int]:
        """Gives indices of the nodes from sensors to the module, and from it to plants."""
        gated = (m.sc, m.ac)
        nodes = [c for c in self.system.components if c.node is not None and c.index not in gated]
        sc = self.system.components[m.sc]
        read = {*m.inputs, *_topics_read(self.system, sc)}
        written = set(m.outputs)
        node_indices: set[int] = set()
        for _ in nodes:
            for c in nodes:
                outputs = {*c.writes}
                if outputs & read:
                    node_indices.add(c.index)
                    read |= _topics_read(self.system, c)
                if _topics_read(self.system, c) & written:
                    node_indices.add(c.index)
                    written |= outputs
        return node_indices


def _are_at_least(declared: Sequence[float | None], least: int) -> bool:
    """Whether times are declared and each of them is at least `least`."""
    return bool(declared) and all(v is not None and least <= v for v in declared)


def _topics_read(system: System, c: Component) -> set[int]:
    """Gives the topics to which a node subscribes; for a queue, the topic that fills it."""
    if c.node is None:
        return set()
    subscribed = [system.topics[c.scope.topics[s.topic]] for s in c.node.subscribes]
    return {t.source for t in subscribed}


def _why_no_overrun(c: Component, rest: Sequence[str]) -> str | None:
    """Gives the reason why no step of a component can overrun; None if a step can."""
    if rest:
        return f"`{c.name}` has no `{'.'.join(rest)}` that steps"
    if c.role == "plant":
        return "physical time is never skewed"
    if c.role == "dm":
        return "a decision module publishes nothing that could count later: say `late`"
    if c.role == "sc":
        return "what SC publishes has to count when the decision module calls for it: say `late`"
    if c.node is None or not c.node.publishes:
        return f"`{c.name}` publishes nothing that could count later"
    for topic in c.node.bursts:
        return f"a step publishes several messages on `{topic.name}`; one a topic can be held"
    return None


def _by_full_name(m: Module, exprs: Mapping[str, typed.TypedExpr]) -> dict[str, typed.TypedExpr]:
    """Gives full name in the system -> expression, for node names of a `verify` block."""
    return {f"{m.name.removesuffix(m.name.rpartition('.')[2])}{n}": e for n, e in exprs.items()}


def _publishes_one_value(c: Component, topic: typed.TopicSymbol) -> bool:
    """Whether each step publishes at most one message of fixed size on the topic."""
    return not has_list(topic.type) and not (c.node is not None and topic in c.node.bursts)


def _leaves_to_hit(kind: str, topic: Topic, path: Sequence[str]) -> tuple[int, ...]:
    """The indices of leaves below `path` that a kind of fault can hit; "silent": (0,), no path."""
    if kind == "silent":
        return () if path else (0,)
    wanted = {"stuck": (object,), "saturated": (FloatType, IntType)}.get(kind, (FloatType,))
    return tuple(
        i
        for i, (at, leaf) in enumerate(leaves(topic.type))
        if at[: len(path)] == tuple(path)
        and isinstance(leaf, wanted)
        and (kind != "saturated" or topic.bounds[i] is not None)
    )

"""Checks that the parts of a flat system fit together.

Purpose: reports what breaks the paper's composability (Section IV: disjoint nodes, disjoint
outputs), topics with two drivers or none (M005, with edits that add one), and too long calendars.
Non-goals: numbers of single declarations (`make_components.py`), P1 (`wellformed.py`).
"""

from __future__ import annotations

import itertools
import math
import re
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Edit, Fix, Span
from soter.diagnostics.fixes import insert, remove_from_list, whole_lines
from soter.language.check.unknown_names import place_of_publication
from soter.language.elaborate.wellformed import check_external_topics
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.typed import TypedPublish
from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Diagnostics, Help
    from soter.language.model.system import Component, Module, System, Topic
    from soter.language.model.typed import NodeSymbol, SystemSymbol, TopicSymbol, TypedProgram


SHOWN = 2
MAX_HYPERPERIOD_NS = 2**62
PERIODS_SHOWN = 8
DRIVERS_SHOWN = 4
_CAPITALS = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


def driver_fixes(program: TypedProgram, system: SystemSymbol, topic: Topic) -> tuple[Help, ...]:
    """Gives edits that add an instance which drives a topic of the system, not of a sub-system."""
    if topic.name != topic.symbol.name:
        return ()
    declarations = itertools.islice(_items_that_drive(program, system, topic.symbol), SHOWN)
    return tuple(fix_that_adds(system, item) for item in declarations)


def _items_that_drive(
    program: TypedProgram, system: SystemSymbol, topic: TopicSymbol
) -> Iterator[str]:
    """Yields the text of each item that would add to the system a declared driver of a topic."""
    taken = {i.name for i in system.instances}
    present: set[object] = {i.what for i in system.instances}
    modules = program.modules.values()
    present |= {node for m in modules for node in m.named_nodes}
    for name, plant in program.plants.items():
        if plant not in present and any(t is topic for t, _ in plant.drives):
            yield f"{_free_instance_name(name, taken)}: {name};"
    for name, module in program.modules.items():
        if module not in present and topic in module.sc.publishes:
            yield f"module {name};"
    for name, node in program.nodes.items():
        if node not in present and topic in node.publishes:
            yield f"node {name};"


def _free_instance_name(name: str, taken: set[str]) -> str:
    """Gives a free name for an instance of a plant: `my_cart` for `MyCart`."""
    base = _CAPITALS.sub("_", name.rpartition(".")[2]).lower()
    while base in taken:
        base += "_2"
    return base


def fix_that_adds(system: SystemSymbol, item: str) -> Fix:
    """Gives the edit that inserts an item before all other items of a system."""
    text = system.span.source.text
    opener = text.find("{", system.span.end) + 1
    at = Span(system.span.source, opener, opener)
    return Fix(f"add `{item}` to system `{system.name}`", (Edit(at, f"\n  {item}"),))


def fix_that_makes_input(program: TypedProgram, symbol: TopicSymbol) -> tuple[Help, ...]:
    """Gives the edit that makes a topic an input, if nothing in the program drives it."""
    if any(symbol in n.publishes for n in program.nodes.values()) or any(
        symbol is t for p in program.plants.values() for t, _ in p.drives
    ):
        return ()
    name = symbol.span
    text = name.source.text
    start = text.rfind("topic", 0, name.start)
    title = f"if the environment sets it, declare `input topic {name.text}`"
    if start < 0 or text[start + len("topic") : name.start].strip():
        return (title,)
    return (insert(Span(name.source, start, name.start), "input ", title),)


class Composition:
    """Checks one flat system.

    `partial`: errors in parts were reported, so a missing part is no new error. `draft`: the file
    declares no system, and this one stands for the whole file.
    """

    def __init__(
        self,
        system: System,
        symbol: SystemSymbol,
        diagnostics: Diagnostics,
        *,
        partial: bool,
        draft: bool,
    ) -> None:
        self.system = system
        self.symbol = symbol
        self.diagnostics = diagnostics
        self.partial = partial
        self.draft = draft
        self.had_errors = diagnostics.has_errors
        self.outside = {e.topic for e in system.externals}
        self.read: set[int] = set()

    def check_all_rules(self, property_reads: list[tuple[int, Span]]) -> None:
        """Checks all rules of composition, and sets the driver of every topic."""
        self._require_distinct_names()
        beside = self._nodes_beside_modules()
        self._check_takeovers(beside)
        drivers = self._drivers_by_topic(beside)
        for index, topic_drivers in drivers.items():
            driven_topic = self.system.topics[index]
            driven_topic.driver = topic_drivers[0][0]
            if len(topic_drivers) > 1:
                self._report_two_drivers(driven_topic, topic_drivers)
            if driven_topic.symbol.input:
                self._report_driven_input(driven_topic, *topic_drivers[0])
        self._require_disjoint_topics()
        self._check_acknowledgements(drivers)
        driven = set(drivers)
        for component in self.system.components:
            for topic, span in self._topics_read_by(component):
                reader = f"{component.role} `{component.name}`"
                if component.role == "dm":
                    reader = f"module `{component.name.rpartition('.')[0]}`"
                elif component.role in {"ac", "sc"}:
                    reader = f"node `{component.name}`"
                self._require_driver(component.scope.topics[topic], span, reader, driven)
        for index, span in property_reads:
            self._require_driver(index, span, "a property", driven)
        self._require_disjoint_nodes()
        if not self.partial:
            check_external_topics(self.system, self.read, self.diagnostics)
        for queue in self.system.topics:
            if queue.queue_of is not None:
                queue.driver = self.system.topics[queue.queue_of].driver

    # ------------------------------------------------------------ drivers

    def _nodes_beside_modules(self) -> set[Component]:
        """Gives the nodes that a system names although a module contains them; reports M004."""
        beside: dict[Component, tuple[str, Module]] = {}
        for c in self.system.components:
            if c.role != "node" or c.node is None or c.stands_for is not None or self.draft:
                continue
            written = {*c.writes}
            for m in self.system.modules:
                roles = {"AC": self.system.components[m.ac], "SC": self.system.components[m.sc]}
                role = next((r for r, x in roles.items() if x.node is c.node), None)
                if role is not None and written & set(m.outputs):
                    beside[c] = role, m
        for c, (role, m) in beside.items():
            module = self.system.components[m.dm].span
            self._report_error(
                "M004",
                f"node `{c.name}` is the {role} of module `{m.name}` already",
                c.span,
                "named once more",
                also=((module, "brings it along"),),
                note="a module has its nodes in it: they are not named in the system",
                helps=(_help_to_leave_out([x.span for x in beside]),),
            )
        return set(beside)

    def _check_takeovers(self, beside: set[Component]) -> None:
        """Reports M015 for `on takeover` in nodes that are no controllers of a module."""
        for c in self.system.components:
            if c.role != "node" or c.node is None or c in beside or self.draft:
                continue
            if c.node.takeover is not None:
                self.diagnostics.error(
                    "M015",
                    f"`{c.node.name}` has `on takeover`, but is in control all the time",
                    c.node.span,
                    also=((self.symbol.span, "in this system it belongs to no module"),),
                    notes=("control is taken and given back inside an `rta` module only",),
                    helps=("leave the block out, or make the node the AC or SC of a module",),
                )

    def _drivers_by_topic(self, beside: set[Component]) -> dict[int, list[tuple[str, Span]]]:
        """Gives topic -> its publishers, each with its kind and full name, and its place."""
        drivers_by_topic: dict[int, list[tuple[str, Span]]] = {}
        for c in self.system.components:
            if c in beside:
                continue
            stands_for = c.stands_for
            name = f"{stands_for.kind} `{stands_for.of}`" if stands_for else f"{c.role} `{c.name}`"
            who = name, c.span
            for t in c.published if c.role in {"plant", "node"} else ():
                drivers = drivers_by_topic.setdefault(c.scope.topics[t], [])
                if c.stands_for is None or who not in drivers:
                    drivers.append(who)
        for m in self.system.modules:
            span = self.system.components[m.dm].span
            outputs_of_ac = set(m.symbol.ac.publishes)  # P1b reports the others
            outputs_by_symbol = zip(m.symbol.sc.publishes, m.outputs, strict=True)
            for index in (i for t, i in outputs_by_symbol if t in outputs_of_ac):
                drivers_by_topic.setdefault(index, []).append((f"module `{m.name}`", span))
        return drivers_by_topic

    def _report_two_drivers(self, topic: Topic, drivers: list[tuple[str, Span]]) -> None:
        if self.draft and self.partial:
            return  # a module that was not read may outputs_by_symbol one of them
        second, first = drivers[1], drivers[0]
        if second[0].startswith("module") and not first[0].startswith("module"):
            second, first = first, second  # report the node beside the module, not the module
        inner = topic.symbol.name.rpartition(".")[2]
        both_modules = first != second and all(who.startswith("module") for who, _ in drivers)
        by = f"by {first[0]} and {second[0]}" if first != second else f"twice by {first[0]}"
        listed, unused = self._listing_and_fix(topic, second[1])
        others = [(span, who) for who, span in drivers[2:DRIVERS_SHOWN]]
        self._report_error(
            "M004",
            f"topic `{topic.name}` is driven {by}",
            second[1],
            "second driver" if first != second else "two of its topics are wired to this one",
            also=(
                *([(first[1], "first driver")] if first != second else []),
                *others,
                *([(listed, "listed here")] if listed is not None else []),
                (topic.symbol.span, "the topic"),
            ),
            note="modules are composed only if their outputs are disjoint"
            if both_modules
            else "a topic has exactly one driver",
            helps=(
                *unused,
                f"give one of them a topic of its own, or wire it: `{{ {inner} = other }}`",
            ),
        )

    def _listing_and_fix(self, topic: Topic, place: Span) -> tuple[Span | None, tuple[Help, ...]]:
        """Gives where the node at `place` lists `topic`; and an edit, if it never publishes it."""
        for c in self.system.components:
            if c.span is not place or c.role != "node" or c.node is None or c.stands_for:
                continue
            for t in c.node.publishes:
                listed = place_of_publication(t.name.rpartition(".")[2], c.node.span)
                if self.system.topics[c.scope.topics[t]] is not topic or listed is None:
                    continue
                published = {n.topic for n in nodes(c.node.step) if isinstance(n, TypedPublish)}
                if c.node.extern or t in published:
                    return listed, ()
                title = f"leave it out there: `{c.name}` never publishes it"
                return listed, (remove_from_list(listed, title),)
        return None, ()

    def _report_error(
        self,
        code: Code,
        message: str,
        span: Span,
        label: str,
        *,
        also: tuple[tuple[Span, str], ...],
        note: str,
        helps: tuple[Help, ...],
    ) -> None:
        """Reports an error; in a draft only if it has no other errors, and with a note."""
        if self.draft and self.had_errors:
            return
        notes = (note,) if note else ()
        if self.draft:
            notes = (*notes, "a file without a `system` runs everything it declares, once")
            helps = (*helps, "or declare a `system` that says what runs")
        self.diagnostics.error(code, message, span, label, also=also, notes=notes, helps=helps)

    # ------------------------------------------------------------ wires

    def _require_distinct_names(self) -> None:
        """Reports N002 for a topic of an instance with the same name as a topic of an import."""
        seen: dict[str, Topic] = {}
        for topic in self.system.topics:
            other = seen.setdefault(topic.name, topic)
            if other is not topic:
                self.diagnostics.error(
                    "N002",
                    f"two topics of system `{self.symbol.name}` are called `{topic.name}`",
                    self.symbol.span,
                    also=((other.symbol.span, "one"), (topic.symbol.span, "the other")),
                    notes=("one is a topic of an instance, the other one of an imported file",),
                    helps=("give the instance another name",),
                )

    def _report_driven_input(self, topic: Topic, who: str, span: Span) -> None:
        """Reports M011 if a wire makes the part at `span` drive an input topic."""
        parts = [c for c in self.system.components if c.span is span]
        if any(topic.symbol in c.published for c in parts):
            return  # it names the input itself, which the checker reported
        self.diagnostics.error(
            "M011",
            f"{who} is wired to `{topic.name}`, an input topic: only the environment sets it",
            span,
            "wired here",
            also=((topic.symbol.span, "declared `input` here"),),
            helps=("wire it to a topic that is declared without `input`",),
        )

    def _require_disjoint_topics(self) -> None:
        """Reports M001 for a node one of whose inputs is wired to one of its outputs."""
        for c in self.system.components:
            if c.node is None:
                continue
            subscribed = [(c.scope.topics[s.topic], s.topic) for s in c.node.subscribes]
            reads = {self.system.topics[i].source: symbol for i, symbol in subscribed}
            for symbol in c.node.publishes:
                index = c.scope.topics[symbol]
                inner = reads.get(index)
                if inner is None or inner is symbol:
                    continue  # the node's outputs_by_symbol check reports the latter
                self.diagnostics.error(
                    "M001",
                    f"by its wires node `{c.name}` both subscribes to and publishes "
                    f"`{self.system.topics[index].name}`",
                    c.span,
                    "wired here",
                    also=((inner.span, "subscribed to"), (symbol.span, "published")),
                    notes=("the inputs and the outputs of a node are disjoint",),
                    helps=("wire them to two topics",),
                )

    # ------------------------------------------------------------ acknowledgements

    def _check_acknowledgements(self, drivers: dict[int, list[tuple[str, Span]]]) -> None:
        """Reports M028 if a node or module acknowledges, or one acknowledgement counts twice."""
        first_by_topic: dict[int, Module] = {}
        for module in self.system.modules:
            latch = module.symbol.latch
            if latch is None or latch.topic is None:
                continue
            topic = self.system.topics[module.scope.topics[latch.topic]]
            others = [
                (w, at) for w, at in drivers.get(topic.index, []) if not w.startswith("plant")
            ]
            for who, span in others[:1]:
                self._report_error(
                    "M028",
                    f"{who} publishes `{topic.name}`, the acknowledgement of `{module.name}`",
                    latch.span,
                    "",
                    also=((span, "it would give control back"),),
                    note="an acknowledgement is the operator's: it comes from outside",
                    helps=(f"declare `input topic {topic.symbol.name}`",),
                )
            other = first_by_topic.setdefault(topic.index, module)
            if other is not module:
                self._report_error(
                    "M028",
                    f"`{topic.name}` acknowledges for `{other.name}` and for `{module.name}`",
                    latch.span,
                    "",
                    also=((self.system.components[other.dm].span, "the other module"),),
                    note="one acknowledgement gives control back once",
                    helps=("give each module a topic of its own",),
                )

    # ------------------------------------------------------------ readers

    def _topics_read_by(self, c: Component) -> list[tuple[TopicSymbol, Span]]:
        if c.node is not None:
            return [(s.topic, s.span) for s in c.node.subscribes]
        if c.plant is not None:
            return list(zip(c.plant.reads, c.plant.read_spans, strict=True))
        assert c.module is not None
        m = self.system.modules[c.module].symbol
        reads = [(t, read.span) for t, read in topic_reads(*m.expressions).items()]
        if m.rest is not None:
            reads += [(x.topic, x.span) for x in m.rest.moves]
        if m.latch is not None:
            reads += [(t, m.latch.span) for t in m.acknowledgements]
        return reads

    def _require_driver(self, index: int, span: Span, reader: str, driven: set[int]) -> None:
        index = self.system.topics[index].source
        topic = self.system.topics[index]
        self.read.add(index)
        if index in driven:
            return
        if topic.symbol.input or index in self.outside:
            topic.driver = "input"
            return
        if self.partial or self._is_published_by_one_controller(index):
            return
        also: tuple[tuple[Span, str], ...] = ((topic.symbol.span, "declared here"),)
        publisher: tuple[Help, ...] = ("add the node or plant that publishes it",)
        place, label = span, "read here"
        if not self.draft:
            also = (*also, (self.symbol.span, "in this system"))
            publisher = (f"add the node or plant that publishes it to system `{self.symbol.name}`",)
            missing = driver_fixes(self.system.program, self.symbol, topic)
            if missing:
                place, label = self.symbol.span, f"nothing in it drives `{topic.name}`"
                also = ((span, "read here"), (topic.symbol.span, "declared here"))
                publisher = missing
        self._report_error(
            "M005",
            f"{reader} reads `{topic.name}`, which nobody drives",
            place,
            label,
            also=also,
            note="",
            helps=(*fix_that_makes_input(self.system.program, topic.symbol), *publisher),
        )

    def _is_published_by_one_controller(self, index: int) -> bool:
        """Whether only one controller of a module publishes the topic, which P1b reports."""
        for m in self.system.modules:
            differ = {*m.symbol.ac.publishes} ^ {*m.symbol.sc.publishes}
            scopes = [self.system.components[c].scope.topics for c in (m.ac, m.sc)]
            if any(topics.get(t) == index for t in differ for topics in scopes):
                return True
        return False

    # ------------------------------------------------------------ nodes of modules

    def _require_disjoint_nodes(self) -> None:
        seen: dict[tuple[str, NodeSymbol], Module] = {}
        for m in self.system.modules:
            prefix = m.name.rpartition(".")[0]
            for index, span in ((m.ac, m.symbol.ac_span), (m.sc, m.symbol.sc_span)):
                node = self.system.components[index].node
                assert node is not None
                other = seen.setdefault((prefix, node), m)
                if other is m or other.symbol is m.symbol:
                    continue
                first = other.symbol
                at_first = first.ac_span if first.ac is node else first.sc_span
                self._report_error(
                    "M003",
                    f"node `{node.name}` is in modules `{other.name}` and `{m.name}`",
                    span or m.symbol.span,
                    "second module",
                    also=((at_first or first.span, "first module"),),
                    note="modules are composed only if their nodes are disjoint",
                    helps=("give one of the modules a node of its own",),
                )


def _help_to_leave_out(names: Sequence[Span]) -> Help:
    """Gives the help that removes items; it is an edit if each item has a line for itself."""
    title = f"leave {' and '.join(f'`{n.text}`' for n in names)} out"
    edits = []
    for n in names:
        text = n.source.text
        start, end = text.rfind("\n", 0, n.start) + 1, text.find(";", n.end) + 1
        if not re.fullmatch(r"\s*(node\s+)?[\w.]+(\s*:\s*[\w.]+)?\s*;", text[start:end]):
            return title
        edits.append(Edit(whole_lines(Span(n.source, start, end)), ""))
    return Fix(title, tuple(edits))


def hyperperiod(system: System, symbol: SystemSymbol, diagnostics: Diagnostics) -> int:
    """Gives the time after which the calendar repeats, in ns; reports C003 if it is too long."""
    periods = sorted({c.period_ns for c in system.components})
    if (value := math.lcm(*periods)) <= MAX_HYPERPERIOD_NS:
        return value
    shown = ", ".join(show_ns(p) for p in periods[:PERIODS_SHOWN])
    more = len(periods) - PERIODS_SHOWN
    diagnostics.error(
        "C003",
        f"the periods of system `{symbol.name}` have no common multiple that fits 64 bits",
        symbol.span,
        notes=(f"they are {shown}" + (f" and {more} more" if more > 0 else ""),),
        helps=("choose periods that divide each other",),
    )
    return 1

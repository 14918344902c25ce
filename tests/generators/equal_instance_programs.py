"""Random small programs of two or three instances of one sub-system that share something.

Purpose: what the explorer is held against the enumerator on where instances are equal, or nearly:
a hub that reads all of them, through queues and locals as well, an environment that all of them
read, or nothing; properties of each, of two, or of one alone. In some of the programs something
tells the instances apart: a parameter, a fault, a property, who wins at the hub.
`swapped` swaps two instances in a configuration of the enumerator, by their names.
Non-goals: finding out which are equal.
"""

from __future__ import annotations

import re
from dataclasses import replace
from random import Random
from typing import TYPE_CHECKING, Any

from generators.small_fleets import DECLARED, PARAMETERS, FleetMaker
from generators.small_test_programs import HEAD, RANGES, TICK, Seen, Topic

if TYPE_CHECKING:
    from collections.abc import Callable

    from generators.brute_force import BruteForce, World
    from soter.language.model.system import System

HUBS = ("node", "node", "queue", "queue", "plant", "drawn", "none")
ODD = 0.35
"""The share of programs that something in them may tell the instances apart in."""


class EqualMaker(FleetMaker):
    """Makes one program."""

    def __init__(self, random: Random) -> None:
        super().__init__(random)
        self.timed = self.timed and self.chance(0.4)
        self.odd = self.chance(ODD)
        self.count = self.pick((2, 2, 3))
        self.hub = self.pick(HUBS)

    def _declare(self) -> list[tuple[Topic, str]]:
        few = self.count == 3
        kinds = self.pick(
            (("node",), ("plant",), ("node", "node"), ("plant", "node"), ("module",))[
                : 2 if few else 5
            ]
        )
        out = self._topic()
        out.max_age = 0
        shared = Topic("open", self.pick(("bool", "bool", "Small")), True)
        self.shared, self.out = shared, out
        self.p.topics.append(shared)
        driven = [out, *(self._topic() for _ in kinds[1:])]
        return [
            *(() if self.hub == "none" else ((shared, "open"),)),
            *zip(driven, kinds, strict=True),
        ]

    def _reads(self, publishes: list[Topic]) -> list[Topic]:
        """Mostly what is shared, too."""
        topics = super()._reads(publishes)
        if self.shared not in topics and self.chance(0.7):
            topics.append(self.shared)
        return topics

    def _open(self, topic: Topic) -> None:
        del topic

    def _clock_apart(self) -> None:
        """An instance is one: what shares nothing with the rest of it is equal by itself."""

    def _literal(self, t: str) -> str:
        return PARAMETERS[t] if t in PARAMETERS and self.chance(0.1) else super()._literal(t)

    # ------------------------------------------------------------ the system

    def _assembled(self) -> str:
        topics = [self._declaration(t) for t in self.p.topics]
        items = "".join(f"  {item}\n" for item in self.p.items)
        hub, at = self._hub()
        body = "\n".join([*topics, hub, *self.p.text])
        inside = f" {{ open = {at} }}" if at else ""
        again = "".join(f"  {x}\n" for x in self._around())
        parts = f"  for i in 0..{self.count} {{ r[i]: Part{inside}; }}\n"
        self.seen_in_one = self._sees()
        self.p.replaced = [
            f"for i in 0..{self.count} {{ {x} }}" for x in self._in_loops(self.p.replaced)
        ]
        self._spread(self.count)
        self.p.actors += bool(at)
        test = "".join(f"  {item}\n" for item in self._test())
        return (
            f"{HEAD}{DECLARED}{body}\nsystem Part {{\n{items}}}\nsystem S {{\n{again}{parts}}}\n"
            f"test T {{\n  system S;\n{test}}}\n"
        )

    def _hub(self) -> tuple[str, str]:
        """Its text, and the topic that it drives."""
        if self.hub == "none":
            return "", ""
        low_high = RANGES.get(self.shared.type)
        values = f" in [{low_high[0]}, {low_high[1]}]" if low_high else ""
        kind = "input topic" if self.hub == "drawn" else "topic"
        told = f"{kind} hub : {self.shared.type}{values};\n"
        if self.hub == "plant":
            changed = self._choose(self.shared.type, [])
            told += (
                f"plant Hub period {self._period(2)}ms {{\n  drives hub = s;\n"
                f"  state s: {self.shared.type};\n  next s = {changed};\n}}"
            )
            return told, "hub"
        if self.hub == "drawn":
            return told, "hub"
        low_high = RANGES.get(self.out.type)
        values = f" in [{low_high[0]}, {low_high[1]}]" if low_high else ""
        told += "".join(
            f"input topic in{k} : {self.out.type}{values};\n" for k in range(self.count)
        )
        return told + self._hub_node(), "hub"

    def _hub_node(self) -> str:
        """Reads all instances; what it makes of them seldom depends on who is who."""
        queued = self.hub == "queue"
        names = [f"kept{k}" if queued else f"in{k}" for k in range(self.count)]
        size, policy = self.pick((1, 2)), self.pick(("", " drop_newest"))
        queue = f" queue {size}{policy}" if queued else ""
        reads = ", ".join(f"in{k}{queue}" for k in range(self.count))
        lines = [f"  subscribes {reads};", "  publishes hub;"]
        step = []
        if queued:
            first = self._literal_of(self.out.type)
            lines += [f"  var {n}: {self.out.type} = {first};" for n in names]
            step += [f"for v in in{k} {{ {n} = v; }}" for k, n in enumerate(names)]
        some = self._bool([Seen("@", self.out.type)], 1)
        told = [some.replace("@", n) for n in names]
        if self.odd and self.chance(0.3):
            told[0] = f"!{told[0]}"
        op = self.pick(("&&", "||"))
        truth = f" {op} ".join(f"({t})" for t in told)
        if self.count == 2 and self.chance(0.2):
            truth = f"({told[0]}) == ({told[1]})"
        yes, no = self._literal_of(self.shared.type), self._literal_of(self.shared.type)
        if self.odd and self.chance(0.3):
            yes = f"({told[0]}) ? {yes} : {no}"
        step.append(f"publish hub = ({truth}) ? ({yes}) : {no};")
        inside = "\n".join(f"    {s}" for s in step)
        head = "\n".join(lines)
        return f"node Hub period {self._period(2)}ms {{\n{head}\n  step {{\n{inside}\n  }}\n}}"

    def _around(self) -> list[str]:
        """Items of the outer system but for the instances."""
        items = []
        if self.hub in ("node", "queue"):
            wires = ", ".join(f"in{k} = r[{k}].{self.out.name}" for k in range(self.count))
            items.append(f"h: Hub {{ {wires} }};")
        elif self.hub == "plant":
            items.append("h: Hub;")
        elif self.hub == "drawn":
            items.append(f"input hub every {self._period(2)}ms;")
        if self.odd and self.chance(0.4):
            items.append(f"set r[{self.pick(range(self.count))}].LEVEL = {self.pick((0, 1, 2))};")
        return items

    # ------------------------------------------------------------ the test

    def _faults(self) -> list[str]:
        one = super(FleetMaker, self)._faults()
        if self.odd and self.chance(0.5):
            return one
        faults = []
        for item in one:
            inside = re.sub(r"r\[\d\]", "r[i]", item)
            faults.append(f"for i in 0..{self.count} {{ {inside} }}")
        kinds = [tuple(re.sub(r"^for i in 0..\d \{ ", "", x).split()[:2]) for x in faults]
        return [x for k, x in enumerate(faults) if kinds[k] not in kinds[:k]]

    def _sees(self) -> list[Seen]:
        """What a property sees of one instance, number `@`."""
        sees = [Seen(f"r[@].{t.name}", t.type) for t in self.p.topics if not t.input]
        sees += [Seen(f"r[@].{s.text}", s.type) for s in self.p.truths]
        return sees + [Seen(f"(mode(r[@].{m}) == Mode.AC)", "bool") for m in self.p.modules]

    def _properties(self) -> list[str]:
        hub = [] if self.hub == "none" else [Seen("hub", self.shared.type)]
        properties = []
        for _ in range(self.pick((1, 1, 2))):
            way = self.pick(("always", "always", "never", "within", "leadsto"))
            properties += self._spread_out(way, self.seen_in_one, hub)
        return properties

    def _spread_out(self, way: str, one: list[Seen], hub: list[Seen]) -> list[str]:
        """A property of each instance, of two, or of one alone."""
        numbers = range(self.count)
        how = self.pick(("each", "pair", "pair", "one" if self.odd else "all"))
        if how == "pair":
            some = self._bool(one, 1)
            op = self.pick(("&&", "||", "=="))
            pairs = [(i, j) for i in numbers for j in numbers if i < j]
            told = [f"(({self._of(some, i)}) {op} ({self._of(some, j)}))" for i, j in pairs]
            if self.chance(0.4):
                rest = self._bool(hub, 1) if hub else self._literal("bool")
                told = [f"({t} || {rest})" for t in told]
            return [self._stated(way, t, t) for t in told]
        if how == "all":
            some = self._bool(one, 1)
            op = self.pick(("&&", "||"))
            told_one = f" {op} ".join(f"({self._of(some, i)})" for i in numbers)
            return [self._stated(way, told_one, told_one)]
        a, b = self._mostly([*one, *hub]), self._likely([*one, *hub])
        return [
            self._stated(way, self._of(a, i), self._of(b, i))
            for i in (numbers if how == "each" else [self.pick(numbers)])
        ]

    def _of(self, text: str, number: int) -> str:
        return text.replace("@", str(number))

    def _stated(self, way: str, e: str, premise: str) -> str:
        latest = self.horizon - (TICK / 2 if way == "leadsto" else 0)
        d = f"{min(2 * TICK, latest):g}ms"
        return {
            "always": f"always {e};",
            "never": f"never !({e});",
            "within": f"eventually {e} within {d};",
            "leadsto": f"{premise} leadsto {e} within {d};",
        }[way]


def equal_instances(seed: int) -> str:
    """The text of program number `seed`."""
    return EqualMaker(Random(seed)).run()  # noqa: S311 - the same programs every time are wanted


# ---------------------------------------------------------------- swapping, by names


def swapped(judge: BruteForce, i: int, j: int) -> Callable[[World], World]:
    """A configuration with instances i and j swapped, and what the hub keeps of them."""
    system = judge.system
    assert system.test is not None
    names: dict[str, list[str]] = {
        "components": [x.name for x in system.components],
        "topics": [t.name for t in system.topics],
        "modules": [m.name for m in system.modules],
    }
    to = {kind: [_where(n, some, i, j) for n in some] for kind, some in names.items()}
    texts = [_told(t.text) for t in system.test.timed]
    to["timed"] = [texts.index(_told(_renamed(t.text, i, j))) for t in system.test.timed]
    drives = {d.topic: k for k, d in enumerate(system.inputs)}
    count = len(system.components)
    actors = [
        to["components"][a.index] if a.kind == "component" else
        count + drives[to["topics"][system.inputs[a.index].topic]]
        for a in judge.actors
    ]  # fmt: skip
    locals_ = [_locals(system, k, i, j) for k in range(count)]

    def permuted(values: tuple[Any, ...], places: list[int]) -> tuple[Any, ...]:
        permutation = list(values)
        for k, place in enumerate(places):
            permutation[place] = values[k]
        return tuple(permutation)

    def swap(w: World) -> World:
        c, components, topics = w.c, to["components"], to["topics"]
        kept = [permuted(v, locals_[k]) if locals_[k] else v for k, v in enumerate(c.L)]
        held = [
            None if h is None else
            replace(h, published=tuple(sorted((topics[t], v) for t, v in h.published)))
            for h in w.held
        ]  # fmt: skip
        return replace(
            w,
            c=replace(
                c,
                L=permuted(tuple(kept), components),
                OE=permuted(c.OE, components),
                Topics=permuted(c.Topics, topics),
                stamps=permuted(c.stamps, topics),
                latched=permuted(c.latched, components),
                had_control=permuted(c.had_control, components),
                gate_fault=permuted(c.gate_fault, to["modules"]),
                clean_needed=permuted(c.clean_needed, to["modules"]),
            ),
            done=permuted(w.done, actors),
            lost=permuted(w.lost, actors),
            held=permuted(tuple(held), actors),
            due=permuted(w.due, to["timed"]),
            verdict=permuted(w.verdict, to["modules"]),
            acted=permuted(w.acted, to["modules"]),
        )

    return swap


def _renamed(name: str, i: int, j: int) -> str:
    """`r[0].Go`, `h.in0.queue`, `kept0` with 0 and 1 swapped."""

    def other(match: re.Match[str]) -> str:
        number = int(match[2])
        return f"{match[1]}{j if number == i else i if number == j else number}"

    return re.sub(r"(\br\[|\bin|\bkept)(\d)", other, name)


def _told(text: str) -> tuple[str, frozenset[str]]:
    """A property without regard to which instance of those that it names comes first.

    Of two instances it says the same either way round, as it is made.
    """
    return re.sub(r"r\[\d\]", "r[]", text), frozenset(re.findall(r"r\[\d\]", text))


def _where(name: str, names: list[str], i: int, j: int) -> int:
    """Where what stands for a name is; of what is told the other way round, itself."""
    renamed = _renamed(name, i, j)
    return names.index(renamed if renamed in names else name)


def _locals(system: System, component: int, i: int, j: int) -> list[int]:
    """Where the locals of a node go; nothing where that is no question."""
    x = system.components[component]
    if x.node is None:
        return []
    names = [v.name for v in x.node.locals]
    return [_where(n, names, i, j) for n in names]

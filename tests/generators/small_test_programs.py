"""Random small discrete programs with a test block, as Soter source text.

Purpose: what the explorer and the brute-force enumerator are compared on: a few nodes, modules and
plants over bools, enums and small ints, with every construct of docs/testing.md somewhere.
Non-goals: meaning; whether a program is small enough is found out by enumerating it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from random import Random
from typing import Any

from generators.latched_programs import add_latches

TICK = 10
"""Milliseconds; every period and phase is a multiple, half of it is the finest time."""

RANGES = {"Small": (0, 2), "Signed": (-1, 1), "Cell": (-2, 2)}
COLORS = ("Color.Red", "Color.Green", "Color.Blue")
TYPES = ("bool", "Color", *RANGES)

HEAD = """soter 1;

type Color = enum { Red, Green, Blue };
type Small = int in [0, 2];
type Signed = int in [-1, 1];
type Cell = int in [-2, 2];
"""


@dataclass(frozen=True)
class Seen:
    """Something an expression can read: its text and the name of its type."""

    text: str
    type: str


@dataclass
class Topic:
    """A topic; `max_age` in ms, 0: none."""

    name: str
    type: str
    input: bool = False
    max_age: int = 0


@dataclass
class Program:
    """The parts of a program while it is made."""

    topics: list[Topic] = field(default_factory=list)
    text: list[str] = field(default_factory=list)
    items: list[str] = field(default_factory=list)
    """Of the system."""
    nodes: dict[str, list[Topic]] = field(default_factory=dict)
    """Paths that timing faults may name, with what is published there; nothing: a DM."""
    queued: set[str] = field(default_factory=set)
    """Topics that somebody reads from a queue."""
    bursts: set[str] = field(default_factory=set)
    """Topics of which a step may publish several messages."""
    replaced: list[str] = field(default_factory=list)
    """Items of the test."""
    modules: list[str] = field(default_factory=list)
    """The modules that stand below none."""
    truths: list[Seen] = field(default_factory=list)
    actors: int = 0


class Maker:
    """Makes one program; every choice comes from `random`."""

    def __init__(self, random: Random) -> None:
        self.random = random
        self.more = Random(random.getstate()[1][7])  # noqa: S311
        """For what was added later, so that programs keep their numbers."""
        self.p = Program()
        self.timed = random.random() < 0.35
        self.risky = random.random() < 0.4

    def chance(self, share: float) -> bool:
        return self.random.random() < share

    def pick(self, options: Any) -> Any:
        return self.random.choice(list(options))

    def run(self) -> str:
        """The program's text."""
        driven = self._declare()
        for topic, kind in driven:
            getattr(self, f"_{kind}")(topic)
        if not self.p.nodes:
            self._node(self._topic())
        if self.p.actors < 5 and self.chance(0.2):
            self._clock_apart()
        add_latches(self.p, Random(self.random.getstate()[1][8]), TICK)  # noqa: S311
        return self._assembled()

    # ------------------------------------------------------------ topics and who drives them

    def _declare(self) -> list[tuple[Topic, str]]:
        kinds = ["module"] * self.pick((0, 1, 1, 1, 2)) + ["node"] * self.pick((0, 1, 1, 2))
        kinds += ["plant"] * self.pick((0, 1, 1)) + ["drawn"] * self.pick((0, 0, 0, 1))
        weight = {"module": 3, "node": 1, "plant": 1, "drawn": 1}
        while sum(weight[k] for k in kinds) > 7:
            kinds.pop(self.random.randrange(len(kinds)))
        self.random.shuffle(kinds)
        return [(self._topic(input_=k == "drawn"), k) for k in kinds]

    def _topic(self, *, input_: bool = False) -> Topic:
        t = self.pick(TYPES)
        age = self.pick((1, 2, 3)) * TICK if self.chance(0.25) else 0
        topic = Topic(f"t{len(self.p.topics)}", t, input_, age)
        self.p.topics.append(topic)
        return topic

    def _declaration(self, t: Topic) -> str:
        low_high = RANGES.get(t.type)
        values = f" in [{low_high[0]}, {low_high[1]}]" if low_high else ""
        age = f" max_age {t.max_age}ms" if t.max_age else ""
        default = f" = {self._literal(t.type)}" if self.chance(0.5) else ""
        return f"{'input ' if t.input else ''}topic {t.name} : {t.type}{values}{default}{age};"

    # ------------------------------------------------------------ expressions

    def _literal(self, t: str) -> str:
        if t == "bool":
            return str(self.pick(("true", "false")))
        if t == "Color":
            return str(self.pick(COLORS))
        low, high = RANGES[t]
        n = self.random.randint(low, high)
        return str(n) if n >= 0 else f"({n})"

    def _value(self, t: str, sees: list[Seen], depth: int = 2) -> str:
        """An expression of one of the named types; ints are kept in range, nearly always."""
        if t == "bool":
            return self._bool(sees, depth)
        if t == "Color":
            return self._color(sees, depth)
        low, high = RANGES[t]
        e = self._int(sees, depth)
        loose = self.risky and self.chance(0.08) and any(s.text in e for s in sees)
        return e if loose else f"max({low}, min({high}, {e}))"

    def _int(self, sees: list[Seen], depth: int) -> str:
        ints = [s.text for s in sees if s.type in RANGES]
        if depth == 0 or self.chance(0.25):
            return str(self.pick(ints)) if ints and self.chance(0.8) else self._literal("Cell")
        if self.chance(0.25):
            a, b = self._int(sees, depth - 1), self._int(sees, depth - 1)
            return f"({self._bool(sees, depth - 1)} ? {a} : {b})"
        a, b = self._int(sees, depth - 1), self._int(sees, depth - 1)
        return f"({a} {self.pick('++-')} {b})"

    def _bool(self, sees: list[Seen], depth: int) -> str:
        bools = [s.text for s in sees if s.type == "bool"]
        ints = any(s.type in RANGES for s in sees)
        colors = [s.text for s in sees if s.type == "Color"]
        ways = ["bool"] * 2 * bool(bools) + ["int"] * 3 * ints + ["color"] * 2 * bool(colors)
        if depth > 0:
            ways += ["not", "and", "or"]
        way = self.pick(ways or ["none"])
        if way == "bool":
            return str(self.pick(bools))
        if way == "color":
            return f"({self.pick(colors)} {self.pick(('==', '!='))} {self.pick(COLORS)})"
        if way == "int":
            a = self._int(sees, max(depth - 1, 0))
            return f"({a} {self.pick(('<', '<=', '>', '==', '!='))} {self._literal('Cell')})"
        if way == "not":
            return f"!{self._bool(sees, depth - 1)}"
        if way in ("and", "or"):
            a, b = self._bool(sees, depth - 1), self._bool(sees, depth - 1)
            return f"({a} {'&&' if way == 'and' else '||'} {b})"
        return self._literal("bool")

    def _color(self, sees: list[Seen], depth: int) -> str:
        colors = [s.text for s in sees if s.type == "Color"]
        if depth > 0 and self.chance(0.5):
            a, b = self._color(sees, depth - 1), self._color(sees, depth - 1)
            return f"({self._bool(sees, depth - 1)} ? {a} : {b})"
        return str(self.pick(colors)) if colors and self.chance(0.6) else str(self.pick(COLORS))

    def _choose(self, t: str, sees: list[Seen]) -> str:
        fair = "fair " if self.chance(0.25) else ""
        if t in ("bool", "Color") and self.chance(0.5):
            return f"{fair}choose {t}"
        if t in RANGES and self.chance(0.4):
            low, high = RANGES[t]
            return f"{fair}choose [{low}, {min(low + 1, high)}]"
        options = [self._value(t, sees, 1) for _ in range(self.pick((1, 2, 2, 2, 3)))]
        return f"{fair}choose {{ {', '.join(options)} }}"

    # ------------------------------------------------------------ nodes

    def _reads(self, publishes: list[Topic]) -> list[Topic]:
        others = [t for t in self.p.topics if t not in publishes]
        return self.random.sample(others, min(len(others), self.pick((0, 1, 1, 2))))

    def _subscriptions(self, reads: list[Topic]) -> tuple[str, list[Seen]]:
        """The lines, and what the step sees of it."""
        parts, sees = [], []
        for t in reads:
            if self.chance(0.15) or (t.name in self.p.bursts and self.more.random() < 0.8):
                size, policy = self.pick((1, 2)), self.pick(("", " drop_oldest", " drop_newest"))
                if self.risky and self.chance(0.3):
                    policy = " fault"
                parts.append(f"{t.name} queue {size}{policy}")
                self.p.queued.add(t.name)
                first = f"({t.name}.len > 0 ? {t.name}[0] : {self._literal(t.type)})"
                sees.append(Seen(first, t.type))
                sees.append(Seen(f"({t.name}.len > 1)", "bool"))
            else:
                parts.append(t.name)
                sees.append(Seen(t.name, t.type))
        return (f"  subscribes {', '.join(parts)};\n" if parts else ""), sees

    def _clock(self, reads: list[Topic]) -> list[Seen]:
        """Conditions on time; floats appear nowhere else."""
        if not self.timed:
            return []
        seen = [Seen(f"(time > {self.pick((1, 2, 3)) * TICK / 1000})", "bool")]
        return seen + [Seen(f"(age({t.name}) > {TICK * 1.5 / 1000})", "bool") for t in reads]

    def _body(self, name: str, period: int, phase: int, outputs: list[Topic], role: str) -> None:
        reads = self._reads(outputs)
        lines, sees = self._subscriptions(reads)
        plain = [Seen(t.name, t.type) for t in reads if f"{t.name} queue" not in lines]
        sees += self._clock([t for t in reads if f"{t.name} queue" not in lines])
        local, takeover = "", ""
        if self.chance(0.3):
            t = self.pick(("bool", "Small", "Color"))
            local = f"  var kept: {t} = {self._literal(t)};\n"
            sees.append(Seen("kept", t))
            if role in ("ac", "sc") and self.chance(0.5):
                takeover = f"  on takeover {{ kept = {self._literal(t)}; }}\n"
        if role in ("ac", "sc") and self.chance(0.15):
            sees.append(Seen("in_control", "bool"))
        contracts = ""
        if self.chance(0.12) and plain:
            contracts += f"  assumes {self._mostly(plain)};\n"
        if self.chance(0.12):
            told = [*plain, *(Seen(t.name, t.type) for t in outputs)]
            contracts += f"  guarantees {self._mostly(told)};\n"
        step = self._step(outputs, sees, local, role)
        starts = f" phase {phase}ms" if phase else ""
        self.p.text.append(
            f"node {name} period {period}ms{starts} {{\n{lines}"
            f"  publishes {', '.join(t.name for t in outputs)};\n{local}{contracts}{takeover}"
            f"  step {{\n{step}  }}\n}}"
        )
        self.p.actors += 1

    def _step(self, outputs: list[Topic], sees: list[Seen], local: str, role: str) -> str:
        lines = []
        if (role == "ac" and self.chance(0.3)) or (self.risky and self.chance(0.2)):
            lines.append(f'    assert {self._likely(sees)}, "not now";')
        if local:
            kind = local.split(":", maxsplit=1)[1].split("=", maxsplit=1)[0].strip()
            lines.append(f"    kept = {self._value(kind, sees, 1)};")
        share = 0.75 if role == "ac" else 0.0 if role == "sc" else 0.35
        for t in outputs:
            e = self._choose(t.type, sees) if self.chance(share) else self._value(t.type, sees)
            publish = f"publish {t.name} = {e};"
            if self.chance(0.1):
                publish = f"if {self._bool(sees, 1)} {{ {publish} }}"
            lines.append(f"    {publish}")
        return "".join(f"{line}\n" for line in lines)

    def _likely(self, sees: list[Seen]) -> str:
        """A condition that often holds."""
        return f"({self._bool(sees, 1)} || {self._bool(sees, 1)})"

    def _period(self, most: int = 3) -> int:
        return int(self.random.randint(1, most)) * TICK

    def _node(self, topic: Topic) -> None:
        name = f"N{len(self.p.text)}"
        period = self._period()
        phase = self.pick((0, 0, 0, TICK // 2, period - TICK))
        self._body(name, period, phase, [topic], "node")
        if self.more.random() < 0.5:
            self.p.text[-1] = self._burst(self.p.text[-1], topic)
        self.p.nodes[name] = [topic]
        self.p.items.append(f"node {name};")

    def _burst(self, node: str, topic: Topic) -> str:
        """The node, of which a step may publish several messages; seldom one too many."""
        self.p.bursts.add(topic.name)
        most = self.more.choice((2, 2, 3))
        times = most + (self.more.random() < 0.15) - (self.more.random() < 0.3)
        head, mark, rest = node.partition(f"publish {topic.name} = ")
        value = rest.partition(";")[0]
        if self.more.random() < 0.5:
            again = f"for m in 0..{times} {{ publish {topic.name} = {value}; }}"
        else:
            first = self._literal_of(topic.type)
            again = f"publish {topic.name} = {first}; publish {topic.name} = {value};"
        head = head.replace(f"publishes {topic.name};", f"publishes {topic.name}[<={most}];")
        return head + again + rest.removeprefix(f"{value};") if mark else node

    def _literal_of(self, t: str) -> str:
        if t == "bool":
            return self.more.choice(("true", "false"))
        if t == "Color":
            return self.more.choice(COLORS)
        return str(self.more.randint(0, RANGES[t][1]))

    def _module(self, topic: Topic) -> None:
        name = f"M{len(self.p.text)}"
        outputs = [topic, *([self._topic()] if self.chance(0.15) else [])]
        period = self._period()
        most = period // TICK
        self._body(self._advanced(name, outputs), self._period(most), 0, outputs, "ac")
        self._body(f"{name}Sc", self._period(most), 0, outputs, "sc")
        sees = [Seen(t.name, t.type) for t in self._seen_by_a_module(outputs)]
        if self.timed and sees and self.chance(0.2):
            sees.append(Seen(f"(age({sees[0].text}) > {TICK / 1000})", "bool"))
        clean = f"  clean {self.pick((1, 2))};\n" if self.chance(0.4) else ""
        safe = self._likely([s for s in sees if "age" not in s.text])
        self.p.text.append(
            f"rta {name} {{\n  ac {name}Ac;\n  sc {name}Sc;\n  period {period}ms;\n"
            f"  safe {safe};\n  ttf {self._bool(sees, 1)};\n  safer {self._bool(sees, 1)};\n"
            f"{clean}}}"
        )
        self.p.actors += 1
        self.p.items.append(f"module {name};")
        self.p.nodes |= {f"{name}.{name}Ac": outputs, f"{name}.{name}Sc": outputs}
        self.p.nodes[f"{name}.dm"] = []
        self.p.modules.append(name)

    def _advanced(self, name: str, outputs: list[Topic]) -> str:
        """The name of the node that is tested as AC: perhaps in place of code nobody has."""
        if not self.chance(0.2):
            return f"{name}Ac"
        self.p.text.append(
            f"extern node {name}Ac period {TICK}ms {{\n"
            f"  publishes {', '.join(t.name for t in outputs)};\n}}"
        )
        self.p.replaced.append(f"replace {name}Ac by {name}Any;")
        return f"{name}Any"

    def _seen_by_a_module(self, outputs: list[Topic]) -> list[Topic]:
        others = [t for t in self.p.topics if t not in outputs]
        return self.random.sample(others or outputs, 1)

    # ------------------------------------------------------------ the environment

    def _plant(self, topic: Topic) -> None:
        name = f"P{len(self.p.text)}"
        reads = self._reads([topic])
        sees = [Seen("s", topic.type), *(Seen(t.name, t.type) for t in reads)]
        lines = f"  reads {', '.join(t.name for t in reads)};\n" if reads else ""
        if self.chance(0.2):
            lines += "  disturbance gust: float in [-1.0, 1.0];\n"
            sees.append(Seen("(gust > 0.5)", "bool"))
        if self.chance(0.15):
            lines += "  state bias: float in [1.0, 2.0];\n"
            sees.append(Seen("(bias > 1.2)", "bool"))
        self.p.text.append(
            f"plant {name} period {self._period()}ms {{\n{lines}  drives {topic.name} = s;\n"
            f"  state s: {topic.type} = {self._literal(topic.type)};\n"
            f"  next s = {self._value(topic.type, sees)};\n}}"
        )
        if self.more.random() < 0.4:
            self.p.text[-1] = self._choosing(self.p.text[-1], topic)
        self.p.items.append(f"p{len(self.p.text)}: {name};")
        self.p.truths.append(Seen(f"p{len(self.p.text)}.truth.s", topic.type))
        self.p.actors += 1

    def _choosing(self, plant: str, topic: Topic) -> str:
        """The plant, which chooses: in a `let`, in `next` or in what it drives, or in several."""
        more, drives = self.more, f"drives {topic.name} = "
        literal = self._literal_of(topic.type)
        options = f"choose {{ s, {literal} }}"
        if more.random() < 0.5:
            let = f"  let odd = choose bool;\n  next s = odd ? {options} : "
            plant = plant.replace("  next s = ", let)
            if more.random() < 0.5:
                return plant.replace(f"{drives}s;", f"{drives}odd ? s : {literal};")
            if more.random() < 0.5:
                return plant
        return plant.replace(f"{drives}s;", f"{drives}{options};")

    def _clock_apart(self) -> None:
        """A plant that shares nothing with the others but time."""
        self.p.text.append(
            f"topic tick : bool;\nplant Clock period {TICK}ms {{\n  drives tick = s;\n"
            "  state s: bool;\n  next s = !s;\n}"
        )
        self.p.items += ["clock: Clock;", "always tick || !tick;"]
        self.p.actors += 1

    def _drawn(self, topic: Topic) -> None:
        values = ""
        if self.chance(0.6):
            options = {self._literal(topic.type) for _ in range(3)}
            values = f" in {{ {', '.join(sorted(options))} }}"
        self.p.items.append(f"input {topic.name}{values} every {self._period()}ms;")
        self.p.actors += 1

    # ------------------------------------------------------------ the test

    def _assembled(self) -> str:
        topics = [self._declaration(t) for t in self.p.topics]
        items = "".join(f"  {item}\n" for item in self.p.items)
        test = "".join(f"  {item}\n" for item in self._test())
        body = "\n".join([*topics, *self.p.text])
        return f"{HEAD}{body}\nsystem S {{\n{items}}}\ntest T {{\n  system S;\n{test}}}\n"

    def _test(self) -> list[str]:
        busy = self.p.actors
        ticks = self.pick((1, 2, 3) if busy > 5 else (2, 3, 4) if busy > 3 else (3, 4, 6, 8))
        self.horizon = ticks * TICK
        items = [*self.p.replaced, f"horizon {ticks * TICK}ms;"]
        if self.chance(0.35):
            items.append(f"skew {self.pick((0.5, 1, 1, 1.5, 2)) * TICK:g}ms;")
        if self.chance(0.35):
            items += self._faults()
        if self.chance(0.15):
            items.append(f"quantum {self.pick((0.5, 1)) * TICK:g}ms;")
        return [*items, *self._properties()]

    def _faults(self) -> list[str]:
        n = self.pick(self.p.nodes)
        items = []
        for _ in range(self.pick((1, 1, 2))):
            kind = self.pick(("late", "skip", "overrun"))
            if kind == "overrun" and not self._may_overrun(n):
                kind = "late"
            by = f"{self.pick((0.5, 1, 2)) * TICK:g}ms"
            most = f" at most {self.pick((1, 2))}" if self.chance(0.7) else ""
            items.append(f"skip {n}{most};" if kind == "skip" else f"{kind} {n} by {by};")
            n = self.pick([m for m in self.p.nodes if m != n] or [n])
        kinds = [tuple(i.split()[:2]) for i in items]
        return [i for k, i in enumerate(items) if kinds[k] not in kinds[:k]]

    def _may_overrun(self, n: str) -> bool:
        outputs = self.p.nodes[n]
        return bool(outputs) and not any(t.name in self.p.queued for t in outputs)

    def _properties(self) -> list[str]:
        sees = [Seen(t.name, t.type) for t in self.p.topics] + self.p.truths
        sees += [Seen(f"(mode({m}) == Mode.AC)", "bool") for m in self.p.modules]
        if self.timed and self.chance(0.3):
            sees.append(Seen(f"(time < {TICK * 2.5 / 1000})", "bool"))
        items = []
        for _ in range(self.pick((1, 1, 2))):
            way = self.pick(("always", "never", "within", "leadsto", "invariant"))
            if way == "invariant" and not self.p.modules:
                way = "always"
            items.append(self._property(way, sees))
        return items

    def _property(self, way: str, sees: list[Seen]) -> str:
        latest = self.horizon - (TICK / 2 if way == "leadsto" else 0)  # else it is never judged
        d = f"{min(self.pick((0.5, 1, 2, 3)) * TICK, latest):g}ms"
        if way == "always":
            return f"always {self._mostly(sees)};"
        if way == "never":
            return f"never !{self._mostly(sees)};"
        if way == "within":
            return f"eventually {self._likely(sees)} within {d};"
        if way == "leadsto":
            return f"{self._bool(sees, 1)} leadsto {self._likely(sees)} within {d};"
        if self.chance(0.5):
            return "always invariants;"
        return f"always invariant({self.pick(self.p.modules)});"

    def _mostly(self, sees: list[Seen]) -> str:
        """A condition that fails in few configurations, or in none."""
        return "(" + " || ".join(self._bool(sees, 1) for _ in range(self.pick((2, 3, 4)))) + ")"


def small_program(seed: int) -> str:
    """The text of program number `seed`."""
    return Maker(Random(seed)).run()  # noqa: S311 - the same programs every time are wanted

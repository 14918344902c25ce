"""Random programs that check without errors: the text of one, as a Hypothesis strategy.

Purpose: `programs()` draws a whole program, biased so that modules switch, gates refuse, steps
fault and topics grow stale in a good share of them.
Non-goals: running them (`engine_comparison.py`).

A program has a world (types, constants, parameters, functions, topics), plants, modules and other
nodes, and one system; in every third program that system has two instances of a sub-system.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.internal.conjecture.providers import HypothesisProvider

from generators.hypothesis_choices import Chooser
from generators.random_expressions import DURATIONS, ExpressionMaker
from generators.random_names import Namer
from generators.random_statements import Output, StatementMaker
from generators.random_types import (
    RANGES,
    VEC2,
    VEC3,
    SetMaker,
    TypeMaker,
    ValueSet,
    boundable,
    fits,
    has_list,
    routes,
    text_of,
)
from generators.visible_names import Globals, Seen, Sight
from soter.language.model.types import (
    BOOL,
    FLOAT,
    INT,
    ArrayType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    is_vector,
)
from soter.language.syntax.schemes import SCHEMES

if TYPE_CHECKING:
    from hypothesis.strategies import DrawFn

    from soter.language.model.types import Type

PERIODS_US = (10_000, 5_000, 20_000, 7_000, 11_000, 2_500, 15_000, 3_333, 13_000, 30_000)


@dataclass
class Topic:
    """A declared topic."""

    name: str
    type: Type
    values: ValueSet
    input: bool = False
    age: str = ""
    """Its `max_age`, as the program writes it."""

    @property
    def seen(self) -> Seen:
        """As an expression sees it."""
        return Seen(self.name, self.type)


@dataclass
class Part:
    """What a system instantiates: kind "plant", "node" or "module"."""

    kind: str
    name: str
    drives: list[Topic] = field(default_factory=list)
    states: list[Seen] = field(default_factory=list)


class ProgramMaker:
    """Makes one program."""

    def __init__(self, choose: Chooser) -> None:
        self.choose = choose
        self.names = Namer(choose, choose.pick((0, 0, 0, 15, 60)))
        self.types = TypeMaker(choose, self.names)
        self.expressions = ExpressionMaker(choose)
        self.statements = StatementMaker(choose, self.names, self.types, self.expressions)
        self.sets = SetMaker(choose)
        self.world = Globals()
        self.text: list[list[str]] = []
        self.topics: list[Topic] = []
        self.parts: list[Part] = []
        self.module_names: list[str] = []
        self.queued: set[str] = set()
        self.bursting: set[str] = set()
        self.lasting: list[tuple[list[str], int, str, int]] = []
        """Nodes whose steps may take time: lines, the one of what it publishes, role, period."""
        self.latchable: list[list[str]] = []
        """The lines of modules, whose decision modules may have a latch."""

    def run(self) -> str:
        """The text of the program."""
        self.types.declare()
        self.text += [[line] for line in self.types.declarations]
        self._world()
        plan = self._plan()
        for plant, drives in plan["plants"]:
            self._plant(plant, drives)
        for module, outputs in plan["modules"]:
            self._module(module, outputs)
        for node, outputs in plan["nodes"]:
            self.parts.append(Part("node", node, outputs))
            self._node(node, self._period(), outputs, role="node")
        systems = self._systems()
        for lines, at, role, period_us in self.lasting:
            lines[at] += self._takes(role, period_us)
        for lines in self.latchable:
            self._latch(lines, systems[0])
        declarations = self.choose.shuffled(self.text) if self.choose.chance(15) else self.text
        body = ["\n".join(lines) for lines in [*declarations, *systems]]
        return "soter 1;\n\n" + "\n\n".join(body) + "\n"

    # ------------------------------------------------------------ the world

    def _sight(self, **more: Any) -> Sight:
        return Sight(self.world, **more)

    def _world(self) -> None:
        choose = self.choose
        self.world.enums = self.types.enums
        vectors = [r for r in self.types.records if is_vector(r)]
        self.world.vectors = [*vectors[:3], ArrayType(FLOAT, 3)]
        self.world.reserved = {*(r.name for r in self.types.records if r.name), "Mode"}
        self.world.reserved |= {e.name for e in self.types.enums}
        for _ in range(choose.count(1, 4)):
            self._constant()
        for _ in range(choose.count(0, 3)):
            self._parameter()
        for _ in range(choose.count(0, 4)):
            name = self.names.fresh("function")
            sight = self._sight(risk=choose.pick((0, 0, 0, 5)), fuel=25)
            lines, made = self.statements.function(sight, name)
            self.text.append(lines)
            self.world.functions.append(made)
            self.world.reserved.add(name)

    def _constant(self) -> None:
        choose = self.choose
        t = choose.weighted(
            ((3, FLOAT), (2, self.types.any()), (1, ArrayType(FLOAT, 3)), (1, VEC3))
        )
        sight = self._sight(constant=True, fuel=30)
        value = self.expressions.make(t, sight, 2)
        if t == FLOAT and choose.chance(10):
            value = choose.pick(("sqrt(-1.0)", "1.0e308 * 10.0", "-1.0e308 * 10.0"))
        name = self.names.fresh("constant")
        self.text.append([f"const {name}: {text_of(t)} = {value};"])
        self.world.constants.append(Seen(name, t))

    def _parameter(self) -> None:
        choose = self.choose
        name = self.names.fresh("constant")
        kind = choose.weighted(((4, "float"), (2, "int"), (1, "bool"), (2, "duration")))
        if kind == "duration":
            self.text.append([f"param {name}: duration = {choose.pick(DURATIONS)};"])
            self.world.durations.append(name)
            return
        t: Type = {"float": FLOAT, "int": IntType(-5, 50), "bool": BOOL}[kind]
        value = {"float": "1.5", "int": "3", "bool": "true"}[kind]
        limits = " in [-10.0, 10.0]" if kind == "float" and choose.chance(50) else ""
        self.text.append([f"param {name}: {text_of(t)} = {value}{limits};"])
        self.world.parameters.append(Seen(name, t))

    # ------------------------------------------------------------ topics, before who drives them

    def _topic(
        self, t: Type, *, complete: bool, is_input: bool = False, like: Topic | None = None
    ) -> Topic:
        choose = self.choose
        name = self.names.fresh("topic")
        if t == INT:  # `topic t : int in [0, 9]` has a ranged type, no set
            t = IntType(*choose.pick(RANGES))
        values = like.values if like else self.sets.make(t, complete=complete)
        default = ""
        if values.bounds or choose.chance(30):
            default = f" = {self.expressions.fixed(t, values)}"
        age = f" max_age {choose.pick((6, 12, 25, 60))}ms" if choose.chance(35) else ""
        age = like.age if like else age
        word = "input topic" if is_input else "topic"
        self.text.append([f"{word} {name} : {text_of(t)}{values.text}{default}{age};"])
        topic = Topic(name, t, values, is_input, age)
        self.topics.append(topic)
        return topic

    def _bounded_type(self, *, drawn: bool = False) -> Type:
        """A type whose numbers a set can bound, and that can be drawn where that is asked."""
        choose = self.choose
        for _ in range(3):
            t = choose.weighted(
                ((3, FLOAT), (3, self.types.any()), (2, choose.pick(self.types.records)))
            )
            if boundable(t) and not (drawn and has_list(t)):
                return t
        return choose.pick((FLOAT, VEC2, INT, BOOL))

    def _plan(self) -> dict[str, list[tuple[str, list[Topic]]]]:
        """Who drives which topics: every topic exists before any code reads it."""
        choose = self.choose
        for _ in range(choose.weighted(((1, 0), (4, 1), (3, 2)))):
            self._topic(self._bounded_type(drawn=True), complete=True, is_input=True)
        plants = []
        for _ in range(choose.weighted(((1, 0), (6, 1), (2, 2)))):
            types = [self._driven_type() for _ in range(choose.weighted(((5, 1), (2, 2))))]
            drives = [self._topic(t, complete=False) for t in types]
            plants.append((self.names.fresh("plant"), drives))
        modules = []
        for _ in range(choose.weighted(((1, 0), (7, 1), (3, 2)))):
            count = choose.weighted(((4, 1), (2, 2)))
            outputs = [self._topic(self._bounded_type(), complete=True) for _ in range(count)]
            modules.append((self.names.fresh("module"), outputs))
        nodes = []
        for _ in range(choose.count(0 if modules or plants else 1, 2)):
            count = choose.weighted(((1, 0), (5, 1), (2, 2)))
            outputs = [self._topic(self.types.any(), complete=False) for _ in range(count)]
            nodes.append((self.names.fresh("node"), outputs))
        self.module_names = [name for name, _ in modules]
        return {"plants": plants, "modules": modules, "nodes": nodes}

    def _driven_type(self) -> Type:
        choose = self.choose
        return choose.weighted(
            ((3, FLOAT), (4, choose.pick(self.types.records)), (2, self.types.any()), (1, VEC3))
        )

    def _period(self, least_us: int = 0) -> int:
        fitting = [p for p in PERIODS_US if p >= least_us]
        return self.choose.pick(fitting) if fitting else least_us

    def _subscribed(self, outputs: list[Topic]) -> list[Topic]:
        readable = [t for t in self.topics if t not in outputs]
        return self.choose.some(readable, 0 if self.choose.chance(10) else 1, 3)

    # ------------------------------------------------------------ nodes

    def _node(self, name: str, period_us: int, outputs: list[Topic], *, role: str) -> None:
        choose = self.choose
        topics = self._subscribed(outputs)
        modules = self._modes()
        risk = choose.pick((0, 0, 4, 15) if role == "ac" else (0, 0, 0, 0, 0, 2))
        rolled = {t.name: self._queue(role, t) for t in topics if not has_list(t.type)}
        queues = {name: queue for name, queue in rolled.items() if queue}
        self.queued |= set(queues)
        seen = [
            Seen(t.name, ListType(t.type, queues[t.name][0])) if t.name in queues else t.seen
            for t in topics
        ]
        sight = self._sight(
            topics=seen, modules=modules, has_time=True, has_period=True,
            has_control=True, risk=risk, fuel=70, frames=[{}],
        )  # fmt: skip
        phase = f" phase {choose.below(period_us)}us" if choose.chance(20) else ""
        lines = [f"node {name} period {period_us}us{phase} {{"]
        if topics:
            reads = [t.name + queues.get(t.name, (0, ""))[1] for t in topics]
            lines.append(f"  subscribes {', '.join(reads)};")
        bursts = {t.name: choose.pick((1, 3, 4)) for t in outputs if self._bursts(role, t)}
        self.bursting |= set(bursts)
        if outputs:
            told = [t.name + self._messages(t, bursts) for t in choose.shuffled(outputs)]
            lines.append(f"  publishes {', '.join(told)};")
            if not bursts:
                self.lasting.append((lines, len(lines) - 1, role, period_us))
        lines += [
            f"  failsafe {t.name} = {self.expressions.fixed(t.type, t.values)};"
            for t in outputs
            if role != "ac" and choose.chance(50)
        ]
        counter = self._locals(lines, sight)
        own = {f.name for f in sight.locals()}
        lines += self._contracts(seen, [t.seen for t in outputs], modules, own)
        published = [Output(t.name, t.type, t.values, bursts.get(t.name, 1)) for t in outputs]
        if role in {"ac", "sc"} and choose.chance(35):
            sight.has_control, sight.modules = False, []
            lines += ["  on takeover {", *self.statements.takeover(sight), "  }"]
            sight.has_control, sight.modules, sight.spent = True, modules, 0
        sight.has_choice = choose.chance(50)
        lines += ["  step {"]
        if counter:
            lines += [f"    {counter} = {counter} + 1;"]

        def conditions(at: Sight) -> list[str]:
            return self._mischief(role, counter, at)

        lines += [*self.statements.step(sight, published, conditions), "  }", "}"]
        self.text.append(lines)

    def _takes(self, role: str, period_us: int) -> str:
        """How long the steps of a node take: less than its period, or several of them."""
        choose = self.choose
        if role == "sc" or not choose.chance(25 if role == "ac" else 50):
            return ""
        most = period_us * choose.pick((1, 2, 4))
        high = choose.pick((most, 1 + choose.below(most)))
        low = choose.pick((high, 1 + choose.below(high)))
        return f" takes [{low}us, {high}us];"

    def _latch(self, module: list[str], system: list[str]) -> None:
        """Perhaps a latch, and a button that the innermost system draws."""
        choose = self.choose
        if not choose.chance(40):
            return
        if choose.chance(15):
            module.insert(-1, "  returns never;")
            return
        button = self.names.fresh("topic")
        age = choose.pick((9, 30, 80, 400))
        self.text.append([f"input topic {button} : bool max_age {age}ms;"])
        module.insert(-1, f"  returns after {button};")
        system.insert(1, f"  input {button} every {choose.pick((7, 20, 50, 130))}ms;")

    def _bursts(self, role: str, topic: Topic) -> bool:
        """Whether a step of a node may publish several messages on a topic."""
        share = 75 if topic.name in self.queued else 35
        return role == "node" and not has_list(topic.type) and self.choose.chance(share)

    def _messages(self, topic: Topic, bursts: dict[str, int]) -> str:
        return f"[<={bursts[topic.name]}]" if topic.name in bursts else ""

    def _queue(self, role: str, topic: Topic) -> tuple[int, str] | None:
        """Whether a topic is read as a queue: how many values it holds, and how it is written."""
        choose = self.choose
        if not choose.chance(60 if topic.name in self.bursting else 15):
            return None
        size = choose.pick((1, 2, 3, 8))
        hard = choose.chance(40 if role == "ac" else 12)
        policy = "fault" if hard else choose.pick(("", "drop_oldest", "drop_newest"))
        return size, f" queue {size} {policy}".rstrip()

    def _contracts(
        self, reads: list[Seen], writes: list[Seen], modules: list[str], hidden: set[str]
    ) -> list[str]:
        """`assumes` and `guarantees` over what the node reads and publishes.

        A local of the node hides what has its name, and may not be read.
        """
        choose = self.choose
        clauses = []
        for word, topics in (("assumes", reads), ("guarantees", [*reads, *writes])):
            if not choose.chance(15):
                continue
            risk = choose.pick((0, 0, 10))
            sight = self._sight(
                topics=topics, modules=modules, has_time=True, risk=risk, fuel=30, frames=[{}]
            )
            condition = self.expressions.make(BOOL, sight, 2)
            if not hidden & set(re.findall(r"\w+", condition)):
                clauses.append(f"  {word} {condition};")
        return clauses

    def _locals(self, lines: list[str], sight: Sight) -> str:
        """Locals with their first values; gives the name of a step counter, if there is one."""
        choose = self.choose
        before = self._sight()
        counter = ""
        if choose.chance(75):
            counter = self.statements.local_name(sight)
            lines.append(f"  var {counter}: int;")
            sight.declare(Seen(counter, INT))
        for _ in range(choose.count(0, 4)):
            t = self.types.any()
            value = ""
            if choose.chance(45):
                value = f" = {self.expressions.literal(t, before)}"
            name = self.statements.local_name(sight)
            lines.append(f"  var {name}: {text_of(t)}{value};")
            sight.declare(Seen(name, t, assignable=True))
        return counter

    def _mischief(self, role: str, counter: str, sight: Sight) -> list[str]:
        """Conditions under which the step faults: often and for a while in an AC, else late."""
        choose = self.choose
        if not choose.chance(70 if role == "ac" else 8):
            return []
        if role != "ac":
            return [f"time > {choose.pick(('0.4', '0.9', '1.6', '2.5'))}"]
        conditions = []
        for _ in range(choose.count(1, 2)):
            options = ["in_control && time > 0.3 && time < 0.6", "time > 0.8 && time < 1.0"]
            if counter and not any(counter in frame for frame in sight.frames[1:]):
                k = choose.pick((17, 40, 90))
                options += [
                    f"{counter} % {k} == {choose.below(k)}",
                    f"in_control && {counter} % {k} < 3",
                ]
            options.append(f"{self.expressions.make(BOOL, sight, 1)} && {options[-1]}")
            conditions.append(choose.pick(options))
        return conditions

    def _modes(self) -> list[str]:
        """Modules whose mode this code may read."""
        if not self.module_names or not self.choose.chance(25):
            return []
        return [self.choose.pick(self.module_names)]

    # ------------------------------------------------------------ modules

    def _module(self, name: str, outputs: list[Topic]) -> None:
        choose = self.choose
        ac, sc = self.names.fresh("node"), self.names.fresh("node")
        period = choose.pick((10_000, 20_000, 35_000, 50_000))
        small = [p for p in PERIODS_US if p <= period]
        self._node(ac, choose.pick(small), outputs, role="ac")
        self._node(sc, choose.pick(small), outputs, role="sc")
        sight = self._sight(
            topics=[t.seen for t in self.topics],
            modules=self._modes(),
            risk=choose.pick((0, 0, 10)),
            fuel=40,
        )
        ttf, safer = self._predicates(sight)
        lines = [f"rta {name} {{", f"  ac {ac};", f"  sc {sc};", f"  period {period}us;"]
        lines.append(f"  safe {self.expressions.make(BOOL, sight, 1)};")
        if not choose.chance(4):  # without them the module never trusts its AC
            lines += [f"  ttf {ttf};", f"  safer {safer};"]
        if choose.chance(60):
            lines.append(f"  clean {choose.pick((1, 2, 5))};")
        self.text.append([*lines, "}"])
        self.latchable.append(self.text[-1])
        self.parts.append(Part("module", name, outputs))

    def _predicates(self, sight: Sight) -> tuple[str, str]:
        """`ttf` and `safer`: mostly a threshold with hysteresis on something that moves."""
        choose = self.choose
        signal = self._signal()
        if signal is None or choose.chance(10):
            made = [self.expressions.make(BOOL, sight, 2) for _ in range(2)]
            return made[0], made[1]
        text, low, high = signal
        cut = low + (high - low) * choose.pick((0.6, 0.75, 0.5))
        back = low + (high - low) * choose.pick((0.5, 0.35, 0.2))
        if isinstance(low, int):
            cut, back = int(cut), int(back)
        ttf, safer = (
            f"{text} > {cut}",
            f"{text} < {max(back, low + 1) if isinstance(low, int) else back}",
        )
        if choose.chance(15):
            ttf = f"{ttf} || {self.expressions.make(BOOL, sight, 1)}"
        if choose.chance(15):
            safer = f"{safer} && {self.expressions.make(BOOL, sight, 1)}"
        if choose.chance(10):
            ttf = f"{ttf} || {self._faulty(sight)}"
        if choose.chance(10):
            safer = f"{safer} && !{self._faulty(sight)}"
        if choose.chance(12):
            ttf = f"{self._undefined(sight)} {choose.pick(('&&', '||'))} {ttf}"
        if choose.chance(12):
            safer = f"{self._undefined(sight)} || {safer}"
        return ttf, safer

    def _undefined(self, sight: Sight) -> str:
        """A comparison one of whose operands is a NaN for many values of what is read."""
        choose = self.choose
        x, y = (self.expressions.make(FLOAT, sight, 1) for _ in range(2))
        of = choose.pick(
            ("sqrt({x})", "acos({x})", "log({x})", "sin(1.0e5 * {x})", "max({y}, sqrt({x}))",
             "({x} * 1.0e308) * 10.0 - ({x} * 1.0e308) * 10.0", "clamp({x}, 0.5, {y})",
             "saturate({y}, sqrt({x}))", "norm(vec2({y}, sqrt({x})))")
        )  # fmt: skip
        a, b = (of.format(x=f"({x})", y=f"({y})"), f"({y})")[:: choose.pick((1, -1))]
        compared = f"({a} {choose.pick(('<', '<=', '>', '>=', '==', '!='))} {b})"
        return f"!{compared}" if choose.chance(40) else compared

    def _faulty(self, sight: Sight) -> str:
        """False, or a fault: unknown is unsafe."""
        n = self.expressions.read(INT, sight, flows=False) or "1"
        return f"({self.expressions.make(BOOL, sight, 1)} && 7 / ({n} - {n}) > 0)"

    def _signal(self) -> tuple[str, float, float] | None:
        """A number in a topic that nobody in particular holds still, and where it moves."""
        moving = [t for t in self.topics if t.input]
        moving += [t for part in self.parts if part.kind == "plant" for t in part.drives]
        signals: list[tuple[str, float, float]] = []
        for topic in moving:
            for route in routes(topic.type):
                if route.through_list:
                    continue
                text = topic.name
                for step in route.steps:
                    if isinstance(step, ArrayType):
                        text += f"[{self.choose.below(step.size)}]"
                    else:
                        text += f".{step}"
                fields = tuple(s for s in route.steps if isinstance(s, str))
                bound = topic.values.at(fields)
                if isinstance(route.type, FloatType):
                    signals.append((text, *(bound or (-2.0, 3.0))))
                elif isinstance(route.type, IntType) and (bound or not route.type.is_full):
                    low, high = bound or (route.type.low, route.type.high)
                    signals.append((text, max(int(low), -1000), min(int(high), 1000)))
        return self.choose.pick(signals) if signals else None

    # ------------------------------------------------------------ plants

    def _plant(self, name: str, drives: list[Topic]) -> None:
        choose = self.choose
        reads = choose.some([t for t in self.topics if t not in drives], 0, 2)
        lines = [f"plant {name} period {self._period()}us {{"]
        if reads:
            lines.append(f"  reads {', '.join([t.name for t in reads])};")
        frame: dict[str, Seen] = {}
        sight = self._sight(
            topics=[t.seen for t in reads], has_time=True, has_period=True, fuel=40, frames=[frame],
            risk=choose.pick((0, 0, 0, 0, 1)),
        )  # fmt: skip
        states = self._states(lines, sight)
        disturbances = self._disturbances(lines, sight)
        sight.has_fair, sight.has_choice = False, choose.chance(40)
        for _ in range(choose.count(0, 2)):
            typed = choose.chance(50)
            t = self.types.any() if typed else choose.pick((FLOAT, INT, BOOL))
            chosen = sight.has_choice and choose.chance(60)
            make = self.expressions
            value = (
                make.chosen(t, sight, 2, flows=typed)
                if chosen
                else make.make(t, sight, 2, flows=typed)
            )
            own = self.statements.local_name(sight)
            lines.append(f"  let {own}{': ' + text_of(t) if typed else ''} = {value};")
            sight.declare(Seen(own, t))
        lines += self._dynamics(states, disturbances, sight)
        if choose.chance(60):
            steps = f" substeps {choose.count(1, 3)}" if choose.chance(50) else ""
            lines.append(f"  integrate {choose.pick(tuple(SCHEMES))}{steps};")
        for topic in drives:
            careful = topic.values.bounds and choose.chance(92)
            value = (
                self.expressions.inside(topic.type, topic.values, sight)
                if careful
                else self._shown(topic, states, sight)
            )
            lines.append(f"  drives {topic.name} = {value};")
        lines += self._measured(drives)
        self.text.append([*lines, "}"])
        self.parts.append(Part("plant", name, drives, states))

    def _states(self, lines: list[str], sight: Sight) -> list[Seen]:
        choose = self.choose
        states: list[Seen] = []
        for _ in range(choose.count(1, 4)):
            t = choose.weighted(((6, FLOAT), (2, self.types.vector()), (2, self.types.any())))
            start = ""
            if (t == FLOAT or is_vector(t)) and choose.chance(30):
                start = f" in {choose.pick(('[-1.0, 1.0]', '[0.5, 2.0]', '[1.0, 1.0]'))}"
            elif choose.chance(50):
                start = f" = {self.expressions.literal(t, self._sight())}"
            own = self.statements.local_name(sight)
            lines.append(f"  state {own}: {text_of(t)}{start};")
            states.append(Seen(own, t))
            sight.declare(states[-1])
        return states

    def _disturbances(self, lines: list[str], sight: Sight) -> list[Seen]:
        choose = self.choose
        disturbances: list[Seen] = []
        for _ in range(choose.count(0, 2)):
            t = FLOAT if choose.chance(60) else self.types.vector()
            hold = (
                f" hold {choose.pick(('20ms', '7ms', '33ms', '1ms'))}" if choose.chance(50) else ""
            )
            own = self.statements.local_name(sight)
            limits = choose.pick(("[-0.5, 0.5]", "[-3.0, 1.0]"))
            lines.append(f"  disturbance {own}: {text_of(t)} in {limits}{hold};")
            disturbances.append(Seen(own, t))
            sight.declare(disturbances[-1])
        return disturbances

    def _dynamics(self, states: list[Seen], disturbances: list[Seen], sight: Sight) -> list[str]:
        choose = self.choose
        lines = []
        for state in choose.shuffled(states):
            t, chooses = state.type, sight.has_choice
            if (t == FLOAT or is_vector(t)) and not choose.chance(25):
                sight.has_choice = False
                lines.append(
                    f"  der {state.name} = {self._derivative(state, states, disturbances, sight)};"
                )
                sight.has_choice = chooses
            elif choose.chance(85):
                lines.append(f"  next {state.name} = {self._next(state, sight)};")
        return lines

    def _derivative(
        self, state: Seen, states: list[Seen], disturbances: list[Seen], sight: Sight
    ) -> str:
        """Mostly something that stays bounded and keeps moving."""
        choose = self.choose
        t, name = state.type, state.name
        more = [d.name for d in disturbances if d.type == t]
        push = f" + {choose.pick(more)}" if more and choose.chance(70) else ""
        if choose.chance(10):
            return self.expressions.make(t, sight, 2)
        if t != FLOAT:
            drive = self.expressions.make(t, sight, 1, flows=False)
            return f"saturate({drive}, 2.0) - {choose.pick(('1.0', '3.0'))} * {name}{push}"
        others = [s.name for s in states if s.type == FLOAT and s.name != name]
        form = choose.below(4)
        if form == 0 and others:
            return f"{choose.pick(others)} - 0.2 * {name}{push}"
        if form == 1 and others:
            return f"-4.0 * {choose.pick(others)} - 0.1 * {name}{push}"
        if form == 2:
            speed = choose.pick(("2.0", "5.0", "11.0"))
            return f"3.0 * sin({speed} * time) - 0.3 * {name}{push}"
        return f"clamp({self.expressions.make(FLOAT, sight, 2)}, -4.0, 4.0) - {name}{push}"

    def _next(self, state: Seen, sight: Sight) -> str:
        choose = self.choose
        t, name = state.type, state.name
        if isinstance(t, IntType) and choose.chance(60):
            if t.is_full:
                return f"({name} + 1) % {choose.pick((7, 100, 1000))}"
            return f"({name} < {t.high} ? {name} + 1 : {t.low})"
        if t == BOOL and choose.chance(50):
            return f"!{name}"
        return self.expressions.make(t, sight, 2)

    def _shown(self, topic: Topic, states: list[Seen], sight: Sight) -> str:
        whole = [s.name for s in states if fits(s.type, topic.type)]
        if whole and self.choose.chance(80):
            return self.choose.pick(whole)
        return self.expressions.make(topic.type, sight, 2)

    def _measured(self, drives: list[Topic]) -> list[str]:
        choose = self.choose
        lines = []
        for topic in drives:
            paths = [
                ".".join((topic.name, *r.fields))
                for r in routes(topic.type)
                if r.fields is not None and (r.type == FLOAT or is_vector(r.type))
            ]
            if paths and choose.chance(50):
                bound = choose.pick(("0.02", "0.0", "0.5"))
                lines.append(f"  measured {choose.pick(paths)} within {bound};")
        return lines

    # ------------------------------------------------------------ systems

    def _systems(self) -> list[list[str]]:
        choose = self.choose
        top = self.names.fresh("instance")
        lines = [f"system {top} default {{"]
        if not choose.chance(33):
            truths, items = self._instances()
            inputs = [t.name for t in self.topics if t.input]
            lines += items + self._closing(
                [t.seen for t in self.topics], truths, list(self.module_names), inputs
            )
            return [[*lines, "}"]]
        sub = self.names.fresh("instance")
        truths, items = self._instances()
        inner = [f"system {sub} {{", *items, *self._forces(self.module_names), "}"]
        return [inner, [*lines, *self._two_of(sub, truths), "}"]]

    def _instances(self) -> tuple[list[Seen], list[str]]:
        """Items that instantiate every part once, and some of them twice with other topics."""
        choose = self.choose
        truths: list[Seen] = []
        lines = []
        self.module_names = [p.name for p in self.parts if p.kind == "module"]  # none below another
        for part in choose.shuffled(self.parts):
            name = part.name
            if part.kind == "plant" or choose.chance(30):
                name = self.names.fresh("instance")
                lines.append(f"  {name}: {part.name}{self._inside([])};")
            else:
                lines.append(f"  {part.kind} {part.name}{self._inside([])};")
            if part.kind == "module":
                self.module_names = [name if m == part.name else m for m in self.module_names]
            if part.kind == "plant":
                truths.append(self._truth(name, part))
            if part.kind != "module" and part.drives and choose.chance(15):
                again = self.names.fresh("instance")
                renames = []
                for topic in part.drives:
                    copy = self._topic(topic.type, complete=False, like=topic)
                    renames.append(f"{topic.name} = {copy.name}")
                lines.append(f"  {again}: {part.name}{self._inside(renames)};")
                if part.kind == "plant":
                    truths.append(self._truth(again, part))
        return truths, lines

    def _inside(self, wires: list[str]) -> str:
        """`{ wires and settings }` of an instance, or nothing."""
        inside = [*wires, *self._own()]
        return f" {{ {', '.join(inside)} }}" if inside else ""

    def _own(self) -> list[str]:
        """Parameters that an instance has of its own."""
        if not self.choose.chance(20):
            return []
        return [
            f"set {p.name} = {self._setting(p)}"
            for p in self.world.parameters
            if self.choose.chance(60)
        ]

    def _truth(self, instance: str, part: Part) -> Seen:
        return Seen(f"{instance}.truth", RecordType(tuple((s.name, s.type) for s in part.states)))

    def _forces(self, modules: list[str]) -> list[str]:
        choose = self.choose
        return [
            f"  force {m} {choose.pick(('ac', 'sc'))};" for m in modules if choose.chance(10)
        ]  # fmt: skip

    def _closing(
        self, topics: list[Seen], truths: list[Seen], modules: list[str], inputs: list[str]
    ) -> list[str]:
        """Everything of the main system but its instances."""
        choose = self.choose
        lines = self._forces(modules)
        for name in inputs:
            if choose.chance(90):
                every = choose.pick((20, 50, 130, 7, 300))
                lines.append(f"  input {name}{self._values(name)} every {every}ms;")
        lines += [
            f"  set {p.name} = {self._setting(p)};"
            for p in self.world.parameters
            if choose.chance(40)
        ]
        sight = self._sight(
            topics=topics, modules=modules, has_time=True, risk=choose.pick((0, 0, 10)), fuel=40
        )
        for _ in range(choose.count(0, 2)):
            sight.frames = [{t.name: t for t in truths}]
            condition = self.expressions.make(BOOL, sight, 2)
            if choose.chance(10):
                condition = f"{condition} && !{self._faulty(sight)}"
            lines.append(f"  {choose.pick(('always', 'never'))} {condition};")
        return [*lines, "  until 10s;"]

    def _values(self, name: str) -> str:
        """The values that an input is drawn from, where not all of its set."""
        choose = self.choose
        topic = next((t for t in self.topics if t.name == name.rpartition(".")[2]), None)
        if topic is None or not choose.chance(25):
            return ""
        values = [
            self.expressions.fixed(topic.type, topic.values) for _ in range(choose.count(1, 4))
        ]
        return f" in {{ {', '.join(values)} }}"

    def _setting(self, parameter: Seen) -> str:
        if parameter.type == FLOAT:
            return self.choose.pick(("-2.5", "0.0", "7.0"))
        return self.choose.pick(("true", "false") if parameter.type == BOOL else ("-5", "50", "0"))

    def _two_of(self, sub: str, truths: list[Seen]) -> list[str]:
        """Two instances of a sub-system, the second with some topics renamed to outer ones."""
        choose = self.choose
        one, two = self.names.fresh("instance"), self.names.fresh("instance")
        used = self._mentioned()
        renamed = [t for t in used if choose.chance(25)]
        wired = [t for t in used if t.input and t not in renamed and choose.chance(25)]
        if choose.chance(50):
            wires = [f"{t.name} = {one}.{t.name}" for t in wired]
            table = self._inside([*(f"{t.name} = {t.name}" for t in renamed), *wires])
            lines = [f"  {two}: {sub}{table};", f"  {one}: {sub}{self._inside([])};"]
        else:
            array, i = one, two
            one, two = f"{array}[0]", f"{array}[1]"
            wires = [f"{t.name} = {array}[1 - {i}].{t.name}" for t in wired]
            table = self._inside([*(f"{t.name} = {t.name}" for t in renamed), *wires])
            items = f"{array}[{i} - 1]: {sub}{self._inside([])}; {array}[{i}]: {sub}{table};"
            lines = [f"  for {i} in 1..2 {{ {items} }}"]
        topics = [Seen(f"{one}.{t.name}", t.type) for t in used]
        topics += [Seen(t.name if t in renamed else f"{two}.{t.name}", t.type) for t in used]
        inputs = [
            f"{i}.{t.name}"
            for i in (one, two)
            for t in used
            if t.input and not (i == two and (t in renamed or t in wired))
        ]
        inputs += [t.name for t in renamed if t.input]
        inner = [Seen(f"{i}.{t.name}", t.type) for i in (one, two) for t in truths]
        modules = [f"{i}.{m}" for i in (one, two) for m in self.module_names]
        return lines + self._closing(topics, inner, modules, inputs)

    def _mentioned(self) -> list[Topic]:
        """Topics that some instance of the sub-system drives, and inputs that some node reads."""
        text = "\n".join(line for lines in self.text for line in lines)
        driven = {t.name for part in self.parts for t in part.drives}
        words = ("  subscribes ", "  reads ")
        read = {
            name.strip(" ;")
            for line in text.splitlines()
            if line.startswith(words)
            for name in line.split(maxsplit=1)[1].split(",")
        }
        return [t for t in self.topics if t.name in driven or (t.input and t.name in read)]


@st.composite
def programs(draw: DrawFn) -> str:
    """The text of a program that checks without errors."""
    return ProgramMaker(Chooser(draw)).run()


def program(number: int) -> str:
    """Program `number`: always the same one.

    Hypothesis is asked for two examples: the first is the simplest of all, the second a random
    one. More in one run would be small variations of each other, which test little. Its habit of
    trying constants from whatever modules are loaded is switched off: what a number means must
    not depend on who asks.
    """
    texts: list[str] = []

    @seed(number)
    @settings(
        max_examples=2, database=None, phases=(Phase.generate,), deadline=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(programs())
    def note(text: str) -> None:
        texts.append(text)

    with patch.object(
        HypothesisProvider, "_maybe_draw_constant", lambda *_, **__: None, create=True
    ):
        note()
    return texts[-1]

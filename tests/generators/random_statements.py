"""Random statements: bodies of functions, steps and takeover blocks.

Purpose: declarations, assignments to parts, pushes, branches, loops, early returns, publications,
and `mischief`: now and then, under a condition, exactly one step fault of a chosen kind.
Non-goals: expressions, declarations of nodes.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from generators.random_types import fits, routes, text_of
from generators.visible_names import Callable, Seen, Sight
from soter.language.model.types import (
    BOOL,
    FLOAT,
    INT,
    ArrayType,
    FloatType,
    IntType,
    ListType,
)

if TYPE_CHECKING:
    from collections.abc import Callable as Callable_
    from collections.abc import Iterator

    from generators.hypothesis_choices import Chooser
    from generators.random_expressions import ExpressionMaker
    from generators.random_names import Namer
    from generators.random_types import Route, TypeMaker, ValueSet
    from soter.language.model.types import Type


OVERFLOWS = (
    "9223372036854775807 - abs(N) + 3", "(-9223372036854775808 + 0) / -1",
    "-(-9223372036854775808)",
    "abs(-9223372036854775808 + abs(N) * 0)", "-9223372036854775807 - abs(N) - 2",
    "3037000500 * 3037000500", "-9223372036854775807 * (2 + abs(N))", "-4294967296 * -2147483648",
)  # fmt: skip
"""Ints beyond 64 bits, N being -2 to 2."""
NO_INTS = ("1.0e19 + X", "9223372036854775808.0", "-9223372036854777856.0", "sqrt(-1.0 - X)",
           "-1.0e300 * 1.0e300")  # fmt: skip
"""Floats that no int can hold, X being no less than 0."""


@dataclass(frozen=True)
class Output:
    """A topic that a node publishes."""

    name: str
    type: Type
    values: ValueSet
    most: int = 1
    """How many messages a step may publish."""


class StatementMaker:
    """Makes statements of one program; lines are collected with their indentation."""

    def __init__(
        self, choose: Chooser, names: Namer, types: TypeMaker, expressions: ExpressionMaker
    ) -> None:
        self.choose = choose
        self.names = names
        self.types = types
        self.expressions = expressions
        self.lines: list[str] = []
        self.depth = 1
        self.result: Type | None = None
        """Inside a function: what it returns."""

    # ------------------------------------------------------------ lines

    def put(self, text: str) -> None:
        """One line at the present depth."""
        self.lines.append("  " * self.depth + text)

    @contextmanager
    def braces(self, head: str, at: Sight, rounds: int = 1) -> Iterator[None]:
        """A block with a scope of its own, run up to `rounds` times."""
        self.put(head + " {")
        self.depth += 1
        at.frames.append({})
        at.rounds *= rounds
        yield
        at.rounds //= rounds
        at.frames.pop()
        self.depth -= 1
        self.put("}")

    def local_name(self, at: Sight) -> str:
        """A name for a new local: it may hide outer ones, but no type or function."""
        taken = set(at.frames[-1]) | at.world.reserved
        return self.names.outside("value", taken)

    def _new_name(self, at: Sight) -> str:
        """A name for a local that hides nothing."""
        return self.names.outside("value", {s.name for s in at.values()} | at.world.reserved)

    # ------------------------------------------------------------ statements

    def block(self, at: Sight, low: int, high: int, nesting: int = 2) -> None:
        """Some statements."""
        for _ in range(self.choose.count(low, high)):
            self.statement(at, nesting)

    def statement(self, at: Sight, nesting: int) -> None:
        """One statement, if it can be afforded."""
        if not at.spend(1):
            return
        choose = self.choose
        kind = choose.weighted(
            (
                (5, self._let), (3, self._var), (8, self._assign), (4, self._if),
                (2, self._for_range), (2, self._for_each), (3, self._push), (1, self._assert),
            )
            if nesting > 0
            else ((4, self._let), (2, self._var), (8, self._assign), (3, self._push))
        )  # fmt: skip
        kind(at, nesting)

    def _let(self, at: Sight, _nesting: int) -> None:
        choose = self.choose
        if choose.chance(45):
            t: Type = choose.pick((FLOAT, INT, BOOL))
            value, written = self.expressions.make(t, at, 2, flows=False), ""
        else:
            t = self.types.any()
            value, written = self.expressions.make(t, at, 2), f": {text_of(t)}"
        name = self.local_name(at)
        self.put(f"let {name}{written} = {value};")
        at.declare(Seen(name, t))

    def _var(self, at: Sight, _nesting: int) -> None:
        choose = self.choose
        t = self.types.any()
        value = "" if choose.chance(30) else f" = {self.expressions.make(t, at, 2)}"
        name = self.local_name(at)
        self.put(f"var {name}: {text_of(t)}{value};")
        at.declare(Seen(name, t, assignable=True))

    def _places(self, at: Sight) -> list[tuple[Seen, Route]]:
        return [
            (s, r) for s in at.locals() if s.assignable for r in routes(s.type, 3)
        ]  # fmt: skip

    def _assign(self, at: Sight, _nesting: int) -> None:
        places = self._places(at)
        if not places:
            self._var(at, 0)
            return
        seen, route = self.choose.pick(places)
        self.assign(seen, route, at)

    def assign(self, seen: Seen, route: Route, at: Sight) -> None:
        """Assign a part; elements of lists only where there are such, mostly."""
        choose = self.choose
        text, guards = seen.name, []
        for step in route.steps:
            if isinstance(step, str):
                text += f".{step}"
                continue
            size = step.size if isinstance(step, ArrayType) else step.capacity
            if isinstance(step, ArrayType) or choose.chance(at.risk):
                text += f"[{self.expressions.index(size, at)}]"
                continue
            k = choose.below(2)
            guards.append(f"{text}.len > {k}" if size > k else "false")
            text += f"[{min(k, size - 1)}]"
        value = self._next_value(text, route.type, at)
        if not guards:
            self.put(f"{text} = {value};")
            return
        self.put(f"if {' && '.join(guards)} {{ {text} = {value}; }}")

    def _next_value(self, text: str, t: Type, at: Sight) -> str:
        """A new value; accumulators are made often, since state is what traces compare."""
        choose = self.choose
        if isinstance(t, IntType) and t.is_full and choose.chance(50):
            step = choose.pick(("1", "3", "-2"))
            return choose.pick(
                (f"({text} + {step})", f"(({text} * 31 + {step}) % 1009)", f"(({text} + 1) % 7)")
            )
        if isinstance(t, FloatType) and choose.chance(40):
            more = self.expressions.make(FLOAT, at, 1, flows=False)
            scale = choose.pick(("0.5", "0.9", "1.0"))
            return f"({scale} * {text} + saturate({more}, {choose.pick(('1.0', '10.0'))}))"
        return self.expressions.make(t, at, 2)

    def _push(self, at: Sight, _nesting: int) -> None:
        lists = [
            (s, r)
            for s, r in self._places(at)
            if isinstance(r.type, ListType) and not r.through_list
        ]
        if not lists:
            self._assign(at, 0)
            return
        seen, route = self.choose.pick(lists)
        text = self.expressions.along(seen.name, route, at)
        assert isinstance(route.type, ListType)
        value = self.expressions.make(route.type.element, at, 2)
        if self.choose.chance(at.risk):
            self.put(f"push {text}, {value};")
            return
        self.put(f"if {text}.len < {route.type.capacity} {{ push {text}, {value}; }}")
        if self.choose.chance(40):
            self.put(f"else {{ {text} = []; }}")

    def _assert(self, at: Sight, _nesting: int) -> None:
        condition = self.expressions.make(BOOL, at, 1)
        if not self.choose.chance(at.risk):
            condition = f"{condition} || true"
        message = self.choose.pick(("", ', "as it should"'))
        self.put(f"assert {condition}{message};")

    def _if(self, at: Sight, nesting: int) -> None:
        choose = self.choose
        words = ["if"] + ["elseif"] * choose.weighted(((6, 0), (2, 1), (1, 2)))
        for word in words:
            with self.braces(f"{word} {self.expressions.make(BOOL, at, 2)}", at):
                self._inner(at, nesting)
        if choose.chance(45):
            with self.braces("else", at):
                self._inner(at, nesting)

    def _inner(self, at: Sight, nesting: int) -> None:
        """The inside of a branch or loop, which in a function may leave it."""
        self.block(at, 0, 2, nesting - 1)
        if self.result is not None and self.choose.chance(35):
            self.leave(at)
            if self.choose.chance(15):
                self.block(at, 1, 1, 0)

    def leave(self, at: Sight) -> None:
        """A return."""
        assert self.result is not None
        self.put(f"return {self.expressions.make(self.result, at, 2)};")

    def _for_range(self, at: Sight, nesting: int) -> None:
        choose = self.choose
        low = choose.pick((0, 0, 0, -2, 1))
        high = choose.count(0, 4)
        name = self.local_name(at)
        with self.braces(f"for {name} in {low}..{high}", at, max(high - low, 1)):
            at.frames[-1][name] = Seen(name, INT, below=high if low >= 0 else 0)
            at.frames.append({})
            self._inner(at, nesting)
            at.frames.pop()

    def _for_each(self, at: Sight, nesting: int) -> None:
        choose = self.choose
        sequences = [
            (s, r)
            for s in at.values()
            for r in routes(s.type, 3)
            if isinstance(r.type, (ArrayType, ListType)) and not r.through_list
        ]
        if sequences and choose.chance(85):
            seen, route = choose.pick(sequences)
            text, t = self.expressions.along(seen.name, route, at), route.type
        else:
            t = ArrayType(choose.pick((FLOAT, INT)), choose.count(1, 3))
            text = self.expressions.literal(t, at, 1, flows=False)
        assert isinstance(t, (ArrayType, ListType))
        size = t.size if isinstance(t, ArrayType) else t.capacity
        name = self.local_name(at)
        with self.braces(f"for {name} in {text}", at, size):
            at.frames[-1][name] = Seen(name, t.element)
            at.frames.append({})
            self._inner(at, nesting)
            at.frames.pop()

    # ------------------------------------------------------------ functions

    def function(self, world_sight: Sight, name: str) -> tuple[list[str], Callable]:
        """A whole function."""
        choose = self.choose
        at = world_sight
        parameters = [self.types.any() for _ in range(choose.count(0, 3))]
        result = self.types.any()
        at.frames = [{}]
        words = []
        for t in parameters:
            own = self.local_name(at)
            at.declare(Seen(own, t))
            words.append(f"{own}: {text_of(t)}")
        self.lines, self.depth, self.result = [], 1, result
        at.frames.append({})
        self.block(at, 0, 4)
        if choose.chance(20):
            self._branching_end(at)
        else:
            self.leave(at)
        self.result = None
        head = f"fun {name}({', '.join(words)}): {text_of(result)} {{"
        made = Callable(name, tuple(parameters), result, max(at.spent, 1), at.risk > 0)
        return [head, *self.lines, "}"], made

    def _branching_end(self, at: Sight) -> None:
        """The last statement is an `if` that returns on every path."""
        for head in (f"if {self.expressions.make(BOOL, at, 2)}", "else"):
            with self.braces(head, at):
                self.block(at, 0, 2, 1)
                self.leave(at)

    # ------------------------------------------------------------ steps

    def step(
        self, at: Sight, outputs: list[Output], conditions: Callable_[[Sight], list[str]]
    ) -> list[str]:
        """The body of a node's step; `conditions` gives when something is to go wrong."""
        choose = self.choose
        self.lines, self.depth, self.result = [], 2, None
        at.frames.append({})
        early = [o for o in outputs if choose.chance(15)]
        for output in early:
            self._publish(output, at)
        self.block(at, 1, 5)
        for output in outputs:
            if choose.chance(12):
                with self.braces(f"if {self.expressions.make(BOOL, at, 1)}", at):
                    self._publish(output, at)
            elif not choose.chance(4):
                self._publish(output, at)
        for condition in conditions(at):
            with self.braces(f"if {condition}", at):
                self._mischief(at, outputs)
        if choose.chance(20):
            self.block(at, 1, 2)
        at.frames.pop()
        return self.lines

    def takeover(self, at: Sight) -> list[str]:
        """The body of `on takeover`."""
        self.lines, self.depth, self.result = [], 2, None
        at.frames.append({})
        self.block(at, 1, 3, 1)
        at.frames.pop()
        return self.lines

    def _publish(self, output: Output, at: Sight) -> None:
        choose = self.choose
        if choose.chance(at.risk):
            value = self.expressions.make(output.type, at, 2)
        else:
            whole = [
                s.name for s in at.values()
                if fits(s.type, output.type) and not output.values.bounds
            ]  # fmt: skip
            value = (
                choose.pick(whole)
                if whole and choose.chance(25)
                else self.expressions.inside(output.type, output.values, at)
            )
        self._messages(output, f"publish {output.name} = {value};", at)

    def _messages(self, output: Output, line: str, at: Sight) -> None:
        """One message, or several where the node may publish several: seldom one too many."""
        choose = self.choose
        if output.most > 1 and choose.chance(60):
            times = output.most + (1 if choose.chance(10) else -1 if choose.chance(50) else 0)
            with self.braces(f"for {self._new_name(at)} in 0..{times}", at):
                self.put(line)
        else:
            self.put(line)

    def _mischief(self, at: Sight, outputs: list[Output]) -> None:
        """One way to go wrong, of each kind of fault."""
        choose = self.choose
        n = self.expressions.read(INT, at, flows=False) or "3"
        x = self.expressions.read(FLOAT, at, flows=False) or "2.0"
        kind = choose.pick(
            ("overflow", "narrow", "index", "divide", "modulo", "convert", "assert", "capacity",
             "nonfinite", "range")
        )  # fmt: skip
        name = self._new_name(at)
        if kind in {"nonfinite", "range"} and self._bad_publication(kind, at, outputs):
            return
        lines = {
            "overflow": [f"let {name} = {choose.pick(OVERFLOWS).replace('N', f'({n} % 3)')};"],
            "narrow": [f"let {name}: int in [0, 9] = 10 + abs({n} % 3);"],
            "index": [f"var {name}: float[3];", f"{name}[3 + abs({n} % 3)] = {x};"],
            "divide": [f"let {name} = 1.0 / ({x} - {x});"],
            "modulo": [f"let {name} = 7 {choose.pick('/%')} ({n} - {n});"],
            "convert": [f"let {name} = int({choose.pick(NO_INTS).replace('X', f'abs({x})')});"],
            "assert": [f'assert {x} != {x}, "mischief";'],
            "capacity": [f"var {name}: int[<=2] = [1, 2];", f"push {name}, {n};"],
        }.get(kind, [f"let {name} = {choose.pick('123')} / (1 - 1);"])
        for line in lines:
            self.put(line)

    def _bad_publication(self, kind: str, at: Sight, outputs: list[Output]) -> bool:
        """Publish a NaN, an infinity, or something outside the set, and nothing after it."""
        for output in outputs:
            path = self._leaf(output.type, output.values, kind)
            if path is None:
                continue
            bound = output.values.at(path)
            name = self._new_name(at)
            place = ".".join((name, *path))
            whole = self.expressions.fixed(output.type, output.values)
            if kind == "nonfinite":
                bad = self.choose.pick(("sqrt(-1.0)", "(1.0e308 * 10.0)", "(-1.0e308 * 10.0)"))
            else:
                assert bound is not None
                over = self.choose.chance(50)
                bad = str(bound[1] + 1 if over else bound[0] - 1)
            self.put(f"var {name}: {text_of(output.type)} = {whole};")
            self.put(f"{place} = {bad};")
            self.put(f"publish {output.name} = {name};")
            return True
        return False

    def _leaf(self, t: Type, values: ValueSet, kind: str) -> tuple[str, ...] | None:
        """The path of a leaf that can be set to something bad."""
        for route in routes(t):
            fields = route.fields
            if fields is None:
                continue
            if isinstance(route.type, FloatType) and (kind == "nonfinite" or values.at(fields)):
                return fields
            bound = values.at(fields)
            room = (
                isinstance(route.type, IntType)
                and bound is not None
                and (route.type.low < bound[0] and bound[1] < route.type.high)
            )
            if room and kind == "range":
                return fields
        return None

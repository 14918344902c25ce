"""Random expressions of a wanted type.

Purpose: every operator, builtin and kind of value, well typed by construction. What may fault is
mostly written with care (`abs(i % n)` as an index, a guarded divisor) so that programs live long
enough to be interesting, and without care as often as the place's `risk` says.
Non-goals: statements. Parentheses stand around every operation: precedence is the parser's matter.

`flows` says whether the checker knows the wanted type there (an assignment, an argument); where it
does not (an operand), only expressions are made that have exactly that type by themselves.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from generators.random_types import (
    MODE,
    ValueSet,
    fits,
    routes,
)
from soter.language.model.types import (
    BOOL,
    FLOAT,
    INT,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    is_vector,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from generators.hypothesis_choices import Chooser
    from generators.random_types import Route
    from generators.visible_names import Seen, Sight
    from soter.language.model.types import Type

FLOATS = (
    "0.0", "1.0", "0.5", "-1.0", "2.0", "10.0", "-0.0", "3.25", "-7.5", "1.0e-3", "100.0", "0.1",
)  # fmt: skip
WILD_FLOATS = (
    "1.0e308", "-1.0e300", "5.0e-324", "1.0e-310", "9007199254740993.0", "9.3e18", "1.0e16",
    "-9223372036854775808.0", "1.7976931348623157e308", "(1.0e308 * 10.0)", "sqrt(-1.0)",
    "4503599627370495.5",
)  # fmt: skip
INTS = ("0", "1", "2", "-1", "3", "7", "10", "-5", "100", "-12", "1_000")
WILD_INTS = (
    "9223372036854775807", "-9223372036854775808", "4294967296", "3037000500", "-2147483649",
    "65536",
)  # fmt: skip
EDGES = (
    "int(-9223372036854775808.0)", "(-9223372036854775808 % -1)", "(-7 / 2)", "(-7 % 2)",
    "(7 / -2)", "(7 % -2)", "int(-0.9)", "int(9223372036854774784.0)", "abs(-9223372036854775807)",
    "(9223372036854775807 + 0)", "(-9223372036854775807 - 1)", "(3037000499 * 3037000499)",
)  # fmt: skip
"""Operations just inside what does not fault."""
COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")
PRELUDE_1 = tuple(
    [(name, 1) for name in ("sign", "radians", "degrees")]
    + [("wrap_angle", 2)]
    + [(name, 4) for name in ("sin", "cos", "atan", "tanh", "asin", "acos", "tan", "exp", "log")]
)
PRELUDE_2 = (("atan2", 5), ("hypot", 3), ("pow", 12))
PRELUDE_3 = (("clamp", 1), ("lerp", 1), ("smoothstep", 2))
DURATIONS = ("1ms", "20ms", "1500us", "2s", "7ns", "0.25s")


class ExpressionMaker:
    """Makes expressions of one program."""

    def __init__(self, choose: Chooser) -> None:
        self.choose = choose

    # ------------------------------------------------------------ entry

    def make(self, t: Type, at: Sight, depth: int = 2, *, flows: bool = True) -> str:
        """An expression of type `t`."""
        choose = self.choose
        if depth > 0 and not choose.chance(12):
            other = self._composed(t, at, depth, flows=flows)
            if other is not None:
                return other
        return self.simple(t, at, flows=flows)

    def _composed(self, t: Type, at: Sight, depth: int, *, flows: bool) -> str | None:
        choose = self.choose
        if choose.chance(9):
            return self._conditional(t, at, depth, flows=flows)
        if at.has_choice and choose.chance(7):
            return self.chosen(t, at, depth, flows=flows)
        if choose.chance(14):
            called = self._call(t, at, depth)
            if called is not None:
                return called
        if isinstance(t, FloatType):
            return self._float(at, depth)
        if isinstance(t, IntType):
            return self._int_in(t, at, depth)
        if isinstance(t, BoolType):
            return self._bool(at, depth)
        if is_vector(t) and choose.chance(60):
            return self._vector(t, at, depth)
        if flows and isinstance(t, (RecordType, ArrayType, ListType)):
            return self.literal(t, at, depth)
        return None

    # ------------------------------------------------------------ what needs no operation

    def simple(self, t: Type, at: Sight, *, flows: bool = True) -> str:
        """A value that can be seen, or a literal."""
        if self.choose.chance(72):
            seen = self.read(t, at, flows=flows)
            if seen is not None:
                return seen
        return self.literal(t, at, 0, flows=flows)

    def read(self, t: Type, at: Sight, *, flows: bool = True) -> str | None:
        """Some part of something that can be seen."""
        parts: list[tuple[Seen, Route]] = []
        for seen in at.values():
            for route in routes(seen.type):
                if not fits(route.type, t):
                    continue
                aggregate = isinstance(t, (RecordType, ArrayType, ListType))
                if route.through_list and aggregate and not flows:
                    continue
                parts.append((seen, route))
        if not parts:
            return None
        seen, route = self.choose.pick(parts)
        return self.along(seen.name, route, at, flows=flows)

    def along(self, root: str, route: Route, at: Sight, *, flows: bool = True) -> str:
        """The text of a part of `root`; a list on the way is only read where it has elements."""
        text = root
        for n, step in enumerate(route.steps):
            if isinstance(step, str):
                text += f".{step}"
            elif isinstance(step, ArrayType):
                text += f"[{self.index(step.size, at)}]"
            else:
                assert isinstance(step, ListType)
                if self.choose.chance(at.risk):
                    text += f"[{self.index(step.capacity, at)}]"
                    continue
                rest = type(route)(route.steps[n + 1 :], route.type)
                inner = self.along(f"{text}[abs({self._number(at)} % {text}.len)]", rest, at)
                otherwise = self.literal(route.type, at, 0, flows=flows)
                return f"({text}.len > 0 ? {inner} : {otherwise})"
        return text

    def index(self, size: int, at: Sight) -> str:
        """An index that is inside an array of this size, mostly."""
        choose = self.choose
        if choose.chance(at.risk):
            return f"({self._number(at)} + {choose.below(2)})"
        loops = [s.name for s in at.locals() if 0 < s.below <= size]
        if loops and choose.chance(70):
            return choose.pick(loops)
        if choose.chance(50):
            return str(choose.below(size))
        return f"abs({self._number(at)} % {size})"

    def _number(self, at: Sight) -> str:
        """Some int that is read without an index, or a literal."""
        paths = [
            ".".join((seen.name, *route.fields))
            for seen in at.values()
            for route in routes(seen.type)
            if isinstance(route.type, IntType) and route.fields is not None
        ]
        return self.choose.pick(paths) if paths else self.choose.pick(INTS)

    def literal(self, t: Type, at: Sight, depth: int = 0, *, flows: bool = True) -> str:
        """A value written out; its parts are expressions where there is depth left."""
        choose = self.choose
        if isinstance(t, FloatType):
            return choose.pick(WILD_FLOATS if choose.chance(at.risk + 1) else FLOATS)
        if isinstance(t, IntType):
            return self.int_literal(t, at)
        if isinstance(t, BoolType):
            return choose.pick(("true", "false"))
        if isinstance(t, EnumType):
            return f"{t.name}.{choose.pick(t.members)}"

        def part(u: Type) -> str:
            return (
                self.make(u, at, depth - 1, flows=flows)
                if depth > 0
                else self.simple(u, at, flows=flows)
            )

        if isinstance(t, RecordType):
            fields = [f"{n}: {part(f)}" for n, f in t.fields]
            if flows and choose.chance(30):
                fields = choose.shuffled(fields)
            return "{ " + ", ".join(fields) + " }"
        if isinstance(t, ArrayType):
            return "[" + ", ".join([part(t.element) for _ in range(t.size)]) + "]"
        assert isinstance(t, ListType)
        assert flows, "a list literal needs a type from outside"
        return "[" + ", ".join([part(t.element) for _ in range(choose.count(0, t.capacity))]) + "]"

    def int_literal(self, t: IntType, at: Sight) -> str:
        """An int inside the range."""
        choose = self.choose
        if t.is_full:
            wild = not at.constant and choose.chance(at.risk + 1)
            return choose.pick(WILD_INTS if wild else INTS)
        near = sorted({t.low, t.high, min(max(0, t.low), t.high), min(max(3, t.low), t.high)})
        return str(choose.pick(near))

    # ------------------------------------------------------------ any type

    def _conditional(self, t: Type, at: Sight, depth: int, *, flows: bool) -> str:
        condition = self.make(BOOL, at, depth - 1)
        one, other = (self.make(t, at, depth - 1, flows=flows) for _ in range(2))
        return f"({condition} ? {one} : {other})"

    def chosen(self, t: Type, at: Sight, depth: int, *, flows: bool = True) -> str:
        """`choose`: one of a few values, a whole type, or an interval."""
        choose = self.choose
        word = "fair choose" if at.has_fair and choose.chance(40) else "choose"
        if choose.chance(35):
            if isinstance(t, BoolType):
                return f"({word} bool)"
            if isinstance(t, EnumType) and t.name != MODE.name:
                return f"({word} {t.name})"
            if isinstance(t, IntType) and flows:
                low = choose.below(20) if t.is_full else t.low
                high = min(low + choose.below(6), t.high)
                return f"({word} [{low}, {high}])"
        options = [self.make(t, at, depth - 1, flows=flows) for _ in range(choose.count(1, 4))]
        return f"({word} {{ {', '.join(options)} }})"

    def _call(self, t: Type, at: Sight, depth: int) -> str | None:
        fitting = [
            (f, r)
            for f in at.world.functions
            if not at.constant and (not f.risky or at.risk)
            for r in routes(f.result, 2)
            if fits(r.type, t) and not r.through_list
        ]
        if not fitting:
            return None
        fun, route = self.choose.pick(fitting)
        if not at.spend(fun.cost):
            return None
        arguments = ", ".join([self.make(p, at, depth - 1) for p in fun.parameters])
        return self.along(f"{fun.name}({arguments})", route, at)

    # ------------------------------------------------------------ bool

    def _bool(self, at: Sight, depth: int) -> str:
        choose = self.choose
        kind = choose.weighted(
            (
                (6, self._compared), (4, self._logic), (2, self._not), (2, self._special_bool),
                (2, self._lazy), (1, self._same),
            )
        )  # fmt: skip
        made: str | None = kind(at, depth)
        return made if made is not None else self._compared(at, depth)

    def _compared(self, at: Sight, depth: int) -> str:
        choose = self.choose
        enums: list[Type] = [*at.world.enums, MODE]
        t = choose.weighted(((6, FLOAT), (4, INT), (1, BOOL), (2, choose.pick(enums))))
        op = choose.pick(COMPARISONS if t in {FLOAT, INT} else ("==", "!="))
        left = self.make(t, at, depth - 1, flows=False)
        return f"({left} {op} {self.make(t, at, depth - 1, flows=False)})"

    def _same(self, at: Sight, _depth: int) -> str:
        """Something compared with itself: only NaN differs, and compilers like to warn."""
        t = self.choose.pick((FLOAT, INT, BOOL))
        text = self.simple(t, at, flows=False)
        op = self.choose.pick(("==", "!=") if t == BOOL else COMPARISONS)
        return f"({text} {op} {text})"

    def _logic(self, at: Sight, depth: int) -> str:
        left, right = (self.make(BOOL, at, depth - 1) for _ in range(2))
        return f"({left} {self.choose.pick(('&&', '||'))} {right})"

    def _not(self, at: Sight, depth: int) -> str:
        return f"!{self.make(BOOL, at, depth - 1)}"

    def _lazy(self, at: Sight, _depth: int) -> str | None:
        """A right side that would fault where the left side decides."""
        choose = self.choose
        n = self.read(INT, at, flows=False)
        if n is None or at.constant:
            return None
        if choose.chance(50):
            return f"({n} != 0 && {choose.pick(INTS)} / {n} > {choose.pick(INTS)})"
        arrays = [s for s in at.values() if s.type == ArrayType(FLOAT, 3)]
        if arrays:
            name = choose.pick(arrays).name
            return f"({n} < 0 || {n} >= {name}.len || {name}[{n} - 0] > 0.0)"
        return f"({n} == 0 || 100 % {n} < 3)"

    def _special_bool(self, at: Sight, _depth: int) -> str | None:
        choose = self.choose
        options = ["in_control"] if at.has_control else []
        options += [
            f"(mode({m}) == Mode.{choose.pick(MODE.members)})"
            for m in at.modules
            if not at.shadowed(m)
        ]
        if at.durations():
            left, right = self._duration(at), self._duration(at)
            options.append(f"({left} {choose.pick(COMPARISONS)} {right})")
        return choose.pick(options) if options else None

    # ------------------------------------------------------------ int

    def _int_in(self, t: IntType, at: Sight, depth: int) -> str:
        if t.is_full:
            return self._int(at, depth)
        choose = self.choose
        inner = self.make(INT, at, depth - 1)
        if choose.chance(at.risk) and not at.constant:
            return f"({inner} + {choose.below(2)})"
        return f"min(max({inner}, {t.low}), {t.high})"

    def _int(self, at: Sight, depth: int) -> str:
        choose = self.choose
        if at.constant:
            return f"({choose.pick(INTS)} {choose.pick('+-*')} {choose.pick(INTS)})"
        kind = choose.weighted(
            (
                (5, "sum"), (2, "product"), (2, "quotient"), (1, "negated"), (2, "extreme"),
                (1, "abs"), (2, "from_float"), (2, "length"), (1, "same"), (1, "edge"),
            )
        )  # fmt: skip
        if kind == "length":
            return self._length(at)
        if kind == "from_float":
            return self._int_of_float(at, depth)
        if kind == "edge":
            return f"({choose.pick(EDGES)} % 1009)"
        a = self.make(INT, at, depth - 1)
        if kind == "negated":
            return f"-({a})" if choose.chance(30) else f"(-{a})"
        if kind in {"abs", "same"}:
            return f"abs({a})" if kind == "abs" else f"int({a})"
        b = self.make(INT, at, depth - 1)
        if kind == "extreme":
            return f"{choose.pick(('min', 'max'))}({a}, {b})"
        if kind == "sum":
            return f"({a} {choose.pick('+-')} {b})"
        careless = choose.chance(at.risk)
        if kind == "product":
            return f"({a} * {b})" if careless else f"(({a} % 1000) * ({b} % 1000))"
        op = choose.pick("/%")
        if careless:
            return f"({a} {op} {b})"
        return f"({a} {op} {choose.pick(('2', '3', '-7', '10', '(1 + abs(' + b + ' % 9))'))})"

    def _length(self, at: Sight) -> str:
        sequences = [
            (s, r)
            for s in at.values()
            for r in routes(s.type)
            if isinstance(r.type, (ArrayType, ListType)) and not r.through_list
        ]
        if not sequences:
            return self.choose.pick(INTS)
        seen, route = self.choose.pick(sequences)
        return self.along(seen.name, route, at) + ".len"

    def _int_of_float(self, at: Sight, depth: int) -> str:
        x = self.make(FLOAT, at, depth - 1, flows=False)
        if self.choose.chance(at.risk):
            return f"int({x})"
        return f"({x} > -1.0e9 && {x} < 1.0e9 ? int({x}) : {self.choose.pick(INTS)})"

    # ------------------------------------------------------------ float

    def _float(self, at: Sight, depth: int) -> str:
        choose = self.choose
        kind: Callable[[Sight, int], str | None] = choose.weighted(
            (
                (8, self._arithmetic), (3, self._machine), (3, self._prelude),
                (2, self._special_float), (2, self._reduced), (1, self._negated),
                (2, self._float_of_int),
            )
        )  # fmt: skip
        made = kind(at, depth)
        return made if made is not None else self._arithmetic(at, depth)

    def _operand(self, at: Sight, depth: int) -> str:
        return self.make(FLOAT, at, depth - 1, flows=False)

    def _arithmetic(self, at: Sight, depth: int) -> str:
        choose = self.choose
        a, op = self._operand(at, depth), choose.pick("+-**/")
        if op != "/":
            return f"({a} {op} {self._operand(at, depth)})"
        if not choose.chance(at.risk) or at.constant:
            form = choose.below(3)
            if form == 0 or at.constant:
                return f"({a} / {choose.pick(('2.0', '-0.5', '3.0', '10'))})"
            b = self._operand(at, depth)
            if form == 1:
                return f"({a} / (abs({b}) + 1.0))"
            return f"({b} != 0.0 ? {a} / {b} : 0.0)"
        return f"({a} / {self._operand(at, depth)})"

    def _negated(self, at: Sight, depth: int) -> str:
        return f"(-{self._operand(at, depth)})"

    def _machine(self, at: Sight, depth: int) -> str:
        choose = self.choose
        name = choose.pick(("abs", "min", "max", "sqrt", "floor", "saturate", "float"))
        a = self._operand(at, depth)
        if name in {"min", "max", "saturate"}:
            return f"{name}({a}, {self._operand(at, depth)})"
        if name == "sqrt" and not choose.chance(at.risk + 10):
            return f"sqrt(abs({a}))"
        return f"{name}({a})"

    def _prelude(self, at: Sight, depth: int) -> str | None:
        choose = self.choose
        table, arity = choose.weighted(
            ((4, (PRELUDE_1, 1)), (2, (PRELUDE_2, 2)), (4, (PRELUDE_3, 3)))
        )
        name, cost = choose.pick(table)
        if not at.spend(cost):
            return None
        return f"{name}({', '.join([self.make(FLOAT, at, depth - 1) for _ in range(arity)])})"

    def _special_float(self, at: Sight, _depth: int) -> str | None:
        choose = self.choose
        options = ["time"] if at.has_time and not at.shadowed("time") else []
        options += ["dt"] if at.has_period and not at.shadowed("dt") else []
        if not at.constant:
            options += [f"age({s.name})" for s in at.topics if not at.shadowed(s.name)]
        options.append(f"seconds({self._duration(at)})")
        return choose.pick(options)

    def _duration(self, at: Sight) -> str:
        """A time: constants, parameters, and what may be computed with them."""
        choose = self.choose
        known = (*at.durations(), choose.pick(DURATIONS))
        one = choose.pick(known)
        if at.constant or choose.chance(75):
            return one
        kind = choose.pick(("sum", "chosen", "times", "part"))
        if kind == "sum":
            return f"({one} {choose.pick('+-')} {choose.pick(known)})"
        if kind == "chosen":
            return f"({self.simple(BOOL, at)} ? {one} : {choose.pick(known)})"
        n = self._number(at)
        if kind == "part":
            return f"({one} / {n if choose.chance(at.risk) else choose.pick(('2', '-3', '7'))})"
        return f"({one} * {n if choose.chance(at.risk) else f'({n} % 50)'})"

    def _float_of_int(self, at: Sight, depth: int) -> str:
        return f"float({self.make(INT, at, depth - 1)})"

    def _reduced(self, at: Sight, depth: int) -> str | None:
        choose = self.choose
        if not at.world.vectors:
            return None
        t = choose.pick(at.world.vectors)
        a = self.make(t, at, depth - 1, flows=False)
        if choose.chance(40):
            return f"norm({a})"
        return f"dot({a}, {self.make(t, at, depth - 1, flows=False)})"

    # ------------------------------------------------------------ vectors

    def _vector(self, t: Type, at: Sight, depth: int) -> str:
        choose = self.choose
        kind = choose.weighted(
            ((4, "sum"), (2, "left"), (1, "right"), (2, "over"), (1, "minus"), (1, "limit"))
        )
        a = self.make(t, at, depth - 1, flows=False)
        if kind == "sum":
            return f"({a} {choose.pick('+-')} {self.make(t, at, depth - 1, flows=False)})"
        if kind == "minus":
            return f"(-{a})"
        s = self.make(FLOAT, at, depth - 1, flows=False)
        if kind == "limit":
            return f"saturate({a}, {s})"
        if kind == "left":
            return f"({s} * {a})"
        if kind == "right":
            return f"({a} * {s})"
        if choose.chance(at.risk) and not at.constant:
            return f"({a} / {s})"
        return f"({a} / {choose.pick(('2.0', '-4.0', '3'))})"

    # ------------------------------------------------------------ inside a set

    def inside(
        self, t: Type, values: ValueSet, at: Sight, path: tuple[str, ...] = (), depth: int = 2
    ) -> str:
        """An expression whose value lies in a topic's set, NaN apart."""
        choose = self.choose
        bound = values.at(path)
        if isinstance(t, FloatType):
            x = self.make(FLOAT, at, depth)
            low, high = bound or (-1.0e9, 1.0e9)
            if choose.chance(25):
                return f"({x} > {low} && {x} < {high} ? {x} : {min(max(0.0, low), high)})"
            if bound is None:
                return x if choose.chance(80) else f"saturate({x}, {high})"
            return f"clamp({x}, {low}, {high})"
        if isinstance(t, IntType):
            low_int, high_int = (
                (t.low, t.high)
                if bound is None
                else (max(t.low, int(bound[0])), min(t.high, int(bound[1])))
            )
            return f"min(max({self.make(INT, at, depth - 1)}, {low_int}), {high_int})"
        if isinstance(t, RecordType):
            return (
                "{ "
                + ", ".join(
                    [
                        f"{n}: {self.inside(f, values, at, (*path, n), depth - 1)}"
                        for n, f in t.fields
                    ]
                )
                + " }"
            )
        if isinstance(t, (ArrayType, ListType)):
            size = t.size if isinstance(t, ArrayType) else choose.count(0, t.capacity)
            part = [self.inside(t.element, values, at, path, depth - 1) for _ in range(size)]
            return "[" + ", ".join(part) + "]"
        return self.make(t, at, depth)

    def fixed(self, t: Type, values: ValueSet, path: tuple[str, ...] = ()) -> str:
        """A constant inside a topic's set: a default, a fail-safe value."""
        choose = self.choose
        bound = values.at(path)
        if isinstance(t, FloatType):
            low, high = bound or (-5.0, 5.0)
            return str(choose.pick([min(max(0.0, low), high), low, high, (low + high) / 2.0]))
        if isinstance(t, IntType):
            low_int, high_int = (
                (t.low, t.high)
                if bound is None
                else (max(t.low, int(bound[0])), min(t.high, int(bound[1])))
            )
            return str(choose.pick([min(max(0, low_int), high_int), low_int, high_int]))
        if isinstance(t, BoolType):
            return choose.pick(("false", "true"))
        if isinstance(t, EnumType):
            return f"{t.name}.{choose.pick(t.members)}"
        if isinstance(t, RecordType):
            return (
                "{ "
                + ", ".join([f"{n}: {self.fixed(f, values, (*path, n))}" for n, f in t.fields])
                + " }"
            )
        assert isinstance(t, (ArrayType, ListType))
        size = t.size if isinstance(t, ArrayType) else choose.count(0, t.capacity)
        return "[" + ", ".join([self.fixed(t.element, values, path) for _ in range(size)]) + "]"

"""The checked tree read over terms of a solver, expression by expression.

Purpose: what a step does to an environment, its publications, and under which condition it faults.
Truths, ints and enums are exact, ages are compared as whole nanoseconds; of everything else nothing
is known but that the same function of the same values is the same.
Non-goals: time (`transition_system.py`). What is not on the list of this file is not rechecked.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Any, ClassVar

import z3

from soter.certificate.induction.exactness_rules import (
    is_exact,
    is_plain,
    is_short,
    is_simple,
    parts_of_value,
    passes_on,
)
from soter.certificate.induction.known_values import folded
from soter.certificate.induction.solver_values import (
    LARGEST,
    OPAQUE,
    SMALLEST,
    Elapsed,
    Seconds,
    applied,
    both,
    contents,
    either,
    element,
    extent,
    known,
    length,
    negation,
    one_of,
    opaque,
    true,
    unknown,
)
from soter.certificate.terms.terms import NotRecheckedError
from soter.language.evaluate.predicates.numbers_in_predicates import operands_in
from soter.language.model import typed
from soter.language.model.types import (
    ArrayType,
    BoolType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.language.model.system import Scope
    from soter.language.model.types import Type

Term = Any
ROUNDS_MAX = 4_000
"""Statements of one step."""


# ---------------------------------------------------------------- ages


def age_compared(op: str, ns: Term, limit: float) -> Term:
    """`float(ns) / 1e9 op limit`, found by trying whole nanoseconds around the exact quotient.

    NotRecheckedError where the limit is no time.
    """
    if limit != limit:  # noqa: PLR0124 - NaN
        return z3.BoolVal(op == "!=")
    if abs(limit) == float("inf"):
        raise NotRecheckedError("an age is compared with infinity")
    near = int(Fraction(limit) * 10**9)
    first = _first(near, lambda n: n / 1e9 >= limit)
    beyond = _first(near, lambda n: n / 1e9 > limit)
    return {
        "<": ns < first,
        ">=": ns >= first,
        "<=": ns < beyond,
        ">": ns >= beyond,
        "==": z3.And(ns >= first, ns < beyond),
        "!=": z3.Or(ns < first, ns >= beyond),
    }[op]


def _first(near: int, there: Callable[[float], bool]) -> int:
    """The least n from which on it is so; rounding moves it by little."""
    width = max(4, abs(near) // 2**50)
    low, high = max(0, near - width), near + width
    if low > 0 and there(float(low)):
        raise NotRecheckedError("a threshold of an age that is too large")
    if not there(float(max(high, 0))):
        if high <= 0:
            return 0
        raise NotRecheckedError("a threshold of an age that is too large")
    while low < high:
        middle = (low + high) // 2
        if there(float(middle)):
            high = middle
        else:
            low = middle + 1
    return low


# ---------------------------------------------------------------- code


@dataclass
class VisibleValues:
    """What a piece of code sees: topics, ages and the mode at one instant."""

    scope: Scope
    topic: Callable[[int], Term]
    age: Callable[[int], Term]
    mode: Term
    module: int
    in_control: Term
    facts: list[Term]
    others: dict[int, Term] = field(default_factory=dict)
    """Modes of other modules, as far as they were read: anything, the same for all of a step."""

    def mode_of(self, e: typed.ModeRead) -> Term:
        """The mode that is read. NotRecheckedError where it is not known whose."""
        index = self.scope.modules.get(e.module)
        if index is None:
            raise NotRecheckedError("the mode of an unknown module")
        if index == self.module:
            return self.mode
        if index not in self.others:
            self.others[index] = unknown(e.type, "mode of another", self.facts)
        return self.others[index]


@dataclass
class SolverReading:
    """One step, predicate or function body being read."""

    sight: VisibleValues
    env: dict[typed.Variable, Term] = field(default_factory=dict)
    fault: Term = field(default_factory=lambda: z3.BoolVal(False))
    doubt: Term = field(default_factory=lambda: z3.BoolVal(False))
    """That a function which is not read faults, or the gate refuses what it made."""
    said: dict[typed.TopicSymbol, tuple[Term, Term]] = field(default_factory=dict)
    returned: Term = field(default_factory=lambda: z3.BoolVal(False))
    result: Term = None
    rounds: int = 0
    looked_at: frozenset[typed.TypedExpr] = frozenset()
    """Operands of comparisons that may be NaN, which is a fault in `ttf` and `safer`."""
    deep: bool = False
    """Whether functions that only pass on what they are given are read whatever their length."""

    def truth(self, e: typed.TypedExpr) -> tuple[Term, Term]:
        """The value of a predicate, and whether it faults. NotRecheckedError as `value`."""
        value = self.value(e, z3.BoolVal(True))
        return value, z3.Or(self.fault, self.doubt)

    def _faulty(self, where: Term, condition: Term) -> None:
        self.fault = z3.Or(self.fault, z3.And(where, true(condition)))

    # ------------------------------------------------------------ statements

    def run(self, statements: Sequence[typed.TypedStmt], where: Term) -> None:
        """In order; after a return, and where nobody gets, nothing is done.

        NotRecheckedError for what is not known.
        """
        for s in statements:
            self.rounds += 1
            if self.rounds > ROUNDS_MAX:
                raise NotRecheckedError("a step of too many statements")
            here = both(where, negation(self.returned))
            if z3.is_false(here):
                continue
            if isinstance(s, typed.TypedDeclare):
                self.env[s.variable] = self.value(s.value, here)
            elif isinstance(s, typed.TypedAssign):
                self._assign(s, here)
            elif isinstance(s, typed.TypedPublish):
                value = self.value(s.value, here)
                flag, old = self.said.get(s.topic, (z3.BoolVal(False), value))
                self.said[s.topic] = (z3.Or(flag, here), either(here, value, old))
            elif isinstance(s, typed.TypedReturn):
                value = self.value(s.value, here)
                self.result = value if self.result is None else either(here, value, self.result)
                self.returned = one_of(self.returned, here)
            elif isinstance(s, typed.Assert):
                self._faulty(here, z3.Not(self.value(s.condition, here)))
            elif isinstance(s, typed.TypedIf):
                self._if(s, here)
            elif isinstance(s, typed.ForRange):
                for k in range(s.low, s.high):
                    self.env[s.variable] = z3.IntVal(k)
                    self.run(s.body, where)
            elif isinstance(s, typed.ForEach) and parts_of_value(s.sequence.type) is not None:
                for item in self.value(s.sequence, here):
                    self.env[s.variable] = item
                    self.run(s.body, where)
            else:
                raise NotRecheckedError(
                    f"`{type(s).__name__.removeprefix('Typed').lower()}` in a step"
                )

    def _if(self, s: typed.TypedIf, where: Term) -> None:
        left = where
        for condition, body in s.arms:
            c = self.value(condition, left)
            self.run(body, both(left, c))
            left = both(left, negation(c))
        self.run(s.otherwise, left)

    def _assign(self, s: typed.TypedAssign, where: Term) -> None:
        """Of a variable or a part of it: its indices first, in order, then the value."""
        path = [p if isinstance(p, int) else self.value(p, where) for p in s.place.path]
        old = self.env[s.place.variable]
        new = self.value(s.value, where)
        self.env[s.place.variable] = either(
            where, self._put(old, s.place.variable.type, path, new, where), old
        )

    def _put(self, old: Term, t: Type, path: Sequence[Any], new: Term, where: Term) -> Term:
        """A value of a type with another part at a path; an index that it has not is a fault."""
        if not path:
            return new
        at, rest = path[0], path[1:]
        types = parts_of_value(t)
        if types is None:
            raise NotRecheckedError("an assignment at an index of what is not told apart")
        if isinstance(t, RecordType):
            part = self._put(old[at], types[at], rest, new, where)
            return (*old[:at], part, *old[at + 1 :])
        self._faulty(where, z3.Or(at < 0, at >= len(types)))
        parts = []
        for k, (part, of) in enumerate(zip(old, types, strict=True)):
            here = z3.BoolVal(at.as_long() == k) if z3.is_int_value(at) else at == k
            parts.append(either(here, self._put(part, of, rest, new, both(where, here)), part))
        return tuple(parts)

    # ------------------------------------------------------------ expressions

    def value(self, e: typed.TypedExpr, where: Term) -> Term:
        """The value, where it is evaluated. NotRecheckedError for what is not known."""
        sight = self.sight
        constant = folded(e, self.env, sight.scope.params, self.looked_at)
        if constant is not None:
            contents(e.type, constant, sight.facts)
            return known(e.type, constant)
        if isinstance(e, typed.Literal):
            contents(e.type, e.value, sight.facts)
            return known(e.type, e.value)
        if isinstance(e, typed.ParamRead):
            return known(e.type, sight.scope.params[e.param])
        if isinstance(e, typed.VarRead):
            return self.env[e.variable]
        if isinstance(e, typed.TopicRead):
            return sight.topic(sight.scope.topics[e.topic])
        if isinstance(e, typed.AgeRead):
            return Elapsed(sight.age(sight.scope.topics[e.topic]))
        if isinstance(e, typed.ModeRead):
            return sight.mode_of(e)
        if isinstance(e, typed.InControl):
            return sight.in_control
        if isinstance(e, (typed.TimeRead, typed.PeriodRead)):
            return unknown(e.type, "time", sight.facts)
        if type(e) in self._READ_BY:
            return self._READ_BY[type(e)](self, e, where)
        if isinstance(e, typed.Conditional):
            c = self.value(e.condition, where)
            then = self.value(e.then, both(where, c))
            return either(c, then, self.value(e.otherwise, both(where, negation(c))))
        if isinstance(e, typed.TypedField):
            return self.value(e.target, where)[e.index]
        if isinstance(e, typed.Aggregate) and parts_of_value(e.type) is not None:
            order = e.order or tuple(range(len(e.elements)))
            pairs = zip(order, e.elements, strict=True)
            value_by_position = {k: self.value(x, where) for k, x in pairs}
            return tuple(value_by_position[k] for k in range(len(value_by_position)))
        if isinstance(e, typed.Vector) and e.op in "+-*" and isinstance(e.type, RecordType):
            return by_component(e.op, self.value(e.left, where), self.value(e.right, where))
        raise NotRecheckedError(
            f"`{type(e).__name__.removeprefix('Typed').lower()}` in what is proved by induction"
        )

    def _narrowed(self, e: typed.Narrow, where: Term) -> Term:
        value = self.value(e.operand, where)
        low, high = extent(e.type)
        self._faulty(where, z3.Or(value < low, value > high))
        return value

    def _counted(self, e: typed.TypedLength | typed.Index, where: Term) -> Term:
        t = e.target.type
        if not isinstance(t, (ListType, ArrayType)):
            raise NotRecheckedError("the length of what is no list")
        sequence = self.value(e.target, where)
        count = length(sequence, t, self.sight.facts)
        if isinstance(e, typed.TypedLength):
            return count
        at = self.value(e.index, where)
        self._faulty(where, z3.Or(at < 0, at >= count))
        return element(sequence, at, t, self.sight.facts)

    def _chosen(self, e: typed.TypedChoose, where: Term) -> Term:
        options = [self.value(o, where) for o in e.options]
        if e.ages is not None:
            raise NotRecheckedError("a fair choice")
        if not options and isinstance(e.type, BoolType):
            return z3.FreshBool("choice")
        number = z3.FreshInt("choice")
        low = 0 if options else e.low
        self.sight.facts.append(z3.And(number >= low, number < low + e.count))
        choice = options[0] if options else number
        for k, option in enumerate(options[1:], 1):
            choice = either(number == k, option, choice)
        return choice

    def _unary(self, e: typed.TypedUnary, where: Term) -> Term:
        value = self.value(e.operand, where)
        if e.op == "!":
            return z3.Not(value)
        if isinstance(value, Seconds):
            return Seconds(-value.value)
        if isinstance(e.type, FloatType):
            return z3.Function("floats negated", OPAQUE, OPAQUE)(opaque(value))
        if not is_plain(e.type):
            raise NotRecheckedError("arithmetic of vectors outside of a function")
        self._faulty(where, value == SMALLEST)
        return -value

    def _binary(self, e: typed.TypedBinary, where: Term) -> Term:
        if e.op in ("&&", "||"):
            a = self.value(e.left, where)
            go_on = a if e.op == "&&" else z3.Not(a)
            b = self.value(e.right, z3.And(where, go_on))
            return z3.And(a, b) if e.op == "&&" else z3.Or(a, b)
        a = self._compared(e.left, where)
        b = self._compared(e.right, where)
        compares = isinstance(e.type, BoolType)
        if compares and isinstance(a, Elapsed) and isinstance(b, Seconds):
            return age_compared(e.op, a.ns, b.value)
        if compares and isinstance(a, Seconds) and isinstance(b, Elapsed):
            turned = e.op.translate(str.maketrans("<>", "><"))
            return age_compared(turned, b.ns, a.value)
        if isinstance(e.left.type, FloatType):
            if compares or e.op in "+-*":
                sort = z3.BoolSort() if compares else OPAQUE
                return of_floats(e.op, a, b, sort)
            raise NotRecheckedError("a division of floats outside of a function")
        compared = {"==": "__eq__", "!=": "__ne__", "<": "__lt__", "<=": "__le__"}
        compared |= {">": "__gt__", ">=": "__ge__"}
        if e.op in compared:
            return getattr(a, compared[e.op])(b)
        return self._integers(e.op, a, b, where)

    def _compared(self, e: typed.TypedExpr, where: Term) -> Term:
        """An operand, of comparisons one that is no NaN; whether it is hangs on its value alone."""
        value = self.value(e, where)
        if e in self.looked_at and not isinstance(value, Elapsed):
            doubts = [both(where, _is_nan(x)) for x in flat_values(value)]
            self.doubt = z3.Or(self.doubt, *doubts)
        return value

    def _integers(self, op: str, a: Term, b: Term, where: Term) -> Term:
        if op in "/%":
            if not z3.is_int_value(b) or b.as_long() == 0:
                raise NotRecheckedError("a division by what is not known")
            positive = z3.If(a >= 0, a, -a)
            size = positive / abs(b.as_long())
            same = (a >= 0) if b.as_long() > 0 else (a < 0)
            q = z3.If(same, size, -size)
            if op == "%":  # of the smallest one by -1 it is 0
                return a - q * b
            self._faulty(where, z3.And(a == SMALLEST, b == -1))
            return q
        value = a + b if op == "+" else a - b if op == "-" else a * b
        self._faulty(where, z3.Or(value < SMALLEST, value > LARGEST))
        return value

    def _builtin(self, e: typed.Builtin, where: Term) -> Term:
        v = [self._compared(a, where) for a in e.arguments]
        if e.name == "seconds" and z3.is_int_value(v[0]):
            return Seconds(v[0].as_long() / 1e9)
        if is_plain(e.type) and all(is_plain(a.type) for a in e.arguments):
            if e.name in ("min", "max"):
                second = v[1] < v[0] if e.name == "min" else v[1] > v[0]
                return z3.If(second, v[1], v[0])
            if e.name == "abs":
                self._faulty(where, v[0] == SMALLEST)
                return z3.If(v[0] < 0, -v[0], v[0])
        if e.name == "int" or not isinstance(e.type, (FloatType, IntType)):
            raise NotRecheckedError(f"`{e.name}` outside of a function")
        return applied(f"built in {e.name}", v, e.type, self.sight.facts)

    # ------------------------------------------------------------ functions

    def _call(self, e: typed.TypedCall, where: Term) -> Term:
        fun = e.fun
        values = [self.value(a, where) for a in e.arguments]
        if fun.extern or fun.body is None:
            raise NotRecheckedError(f"`{fun.name}` is an extern function")
        exact = all(is_exact(p.type) for p in fun.parameters) and is_exact(fun.result)
        if (exact and is_simple(fun)) or is_short(fun) or (self.deep and passes_on(fun)):
            given = dict(zip(fun.parameters, values, strict=True))
            inner = SolverReading(self.sight, given, rounds=self.rounds, deep=self.deep)
            inner.looked_at = frozenset() if fun.prelude else self.looked_at
            inner.run(fun.body, z3.BoolVal(True))
            self.rounds = inner.rounds
            self._faulty(where, inner.fault)
            self.doubt = z3.Or(self.doubt, z3.And(where, inner.doubt))
            return inner.result
        self.rounds += 1
        params = sorted((p.name, repr(v)) for p, v in self.sight.scope.params.items())
        name = f"fun {fun.name} {id(fun)} {params}"
        nan = " or compares a NaN" if self.looked_at & operands_in(fun) else ""
        faults = applied(f"{name} faults{nan}", values, _BOOL, self.sight.facts)
        self.doubt = z3.Or(self.doubt, z3.And(where, faults))
        return applied(name, values, fun.result, self.sight.facts)

    _READ_BY: ClassVar[dict[type, Callable[[Any, Any, Term], Term]]] = {
        typed.Narrow: _narrowed,
        typed.TypedLength: _counted,
        typed.Index: _counted,
        typed.TypedChoose: _chosen,
        typed.TypedCall: _call,
        typed.Builtin: _builtin,
        typed.TypedUnary: _unary,
        typed.TypedBinary: _binary,
    }


_BOOL = BoolType()


def flat_values(value: Term) -> tuple[Term, ...]:
    """A number, or the components of a vector."""
    return value if isinstance(value, tuple) else (value,)


def _is_nan(x: Term) -> Term:
    if isinstance(x, Seconds):
        return z3.BoolVal(x.value != x.value)
    return z3.Function("floats NaN", OPAQUE, z3.BoolSort())(opaque(x))


def of_floats(op: str, a: Term, b: Term, sort: Any = OPAQUE) -> Term:  # noqa: ANN401 - a sort
    """What a machine operation gives: the same for the same."""
    return z3.Function(f"floats {op}", OPAQUE, OPAQUE, sort)(opaque(a), opaque(b))


def by_component(op: str, a: Term, b: Term) -> Term:
    """The same of vectors, or of a vector and a number."""
    if not isinstance(a, tuple) and not isinstance(b, tuple):
        return of_floats(op, a, b)
    many = len(a if isinstance(a, tuple) else b)
    left, right = (x if isinstance(x, tuple) else (x,) * many for x in (a, b))
    return tuple(by_component(op, x, y) for x, y in zip(left, right, strict=True))

"""What steps and predicates compute, as terms: equal terms are the same function of what is read.

Purpose: Core read symbolically, both sides of every branch, loops unrolled, functions inlined, so
that two pieces of Core can be compared up to a renaming of what they read and write. Terms are
interned: a number stands for one, and equal numbers for equal terms. What commutes exactly (`&&`,
`||`, `==`, `!=`, `+`, `*`, `abs` of a difference, `min` and `max` of ints) has its operands in one
order; nothing else is known of arithmetic, so terms that differ may still be equal.

Faults are a set of (where it is reached, what faults): a step faults iff one of them does. Its
order is of no matter: the first one that does reads values that no fault has spoilt, and which one
was first is no part of a configuration.
Non-goals: which renamings there are (`symmetry.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core import core
from soter.language.model.types import BoolType, IntType

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping, Sequence

    from soter.language.model.types import Value

    Term = int
    Rename = Callable[[core.Cell | core.Fact], Hashable]
    """What a cell or a fact is called in terms."""

STATEMENTS_MAX = 20_000
"""Of one step or predicate, functions inlined and loops unrolled."""
COMMUTES = frozenset({"==", "!=", "+", "*"})
FLIPPED = {">": "<", ">=": "<="}


class TermTooLongError(Exception):
    """A step or predicate of more statements than are followed."""


class InternedTerms:
    """Interned terms."""

    def __init__(self, functions: Sequence[core.Function]) -> None:
        self.functions = {f.name: f for f in functions}
        self._numbers: dict[tuple[Hashable, ...], Term] = {}
        self._parts: list[tuple[Hashable, ...]] = []
        self.true = self.make("const", True)
        self.false = self.make("const", False)

    def make(self, *parts: Hashable) -> Term:
        """The term of an operator and what it is applied to."""
        number = self._numbers.setdefault(parts, len(self._parts))
        if number == len(self._parts):
            self._parts.append(parts)
        return number

    def parts(self, term: Term) -> tuple[Hashable, ...]:
        """What it is made of."""
        return self._parts[term]

    # ------------------------------------------------------------ conditions

    def joined(self, op: str, some: Sequence[Term]) -> Term:
        """`&&` or `||` of conditions, in one order, each once."""
        zero, one = (self.false, self.true) if op == "&&" else (self.true, self.false)
        flat: set[Term] = set()
        for t in some:
            parts = self._parts[t]
            flat |= set(parts[1:]) if parts[0] == op else {t}  # type: ignore[arg-type]
        flat.discard(one)
        if zero in flat:
            return zero
        return flat.pop() if len(flat) == 1 else self.make(op, *sorted(flat)) if flat else one

    def no(self, t: Term) -> Term:
        """The negation."""
        parts = self._parts[t]
        if t in (self.true, self.false):
            return self.true if t == self.false else self.false
        return parts[1] if parts[0] == "not" else self.make("not", t)  # type: ignore[return-value]

    def either(self, condition: Term, then: Term, otherwise: Term) -> Term:
        """One of two values."""
        if condition in (self.true, self.false):
            return then if condition == self.true else otherwise
        if then == otherwise:
            return then
        if otherwise == self.false:
            return self.joined("&&", (condition, then))
        if then == self.true:
            return self.joined("||", (condition, otherwise))
        return self.make("either", condition, then, otherwise)

    # ------------------------------------------------------------ operators

    def binary(self, op: str, a: Term, b: Term) -> Term:
        """A pure operator, or one on ints that may fault."""
        if op in ("&&", "||"):
            return self.joined(op, (a, b))
        if op in FLIPPED:
            return self.make(FLIPPED[op], b, a)
        if op == "*" and a == b and self._parts[a][0] == "-":
            return self.make("square", self._apart(a))  # (x - y)² = (y - x)², bit by bit
        return self.make(op, *sorted((a, b))) if op in COMMUTES else self.make(op, a, b)

    def size(self, op: str, a: Term) -> Term:
        """`abs`: of a difference it is that of the two either way round."""
        difference = "-" if op == "abs" else "sub"
        parts = self._parts[a]
        return self.make(op, self._apart(a) if parts[0] == difference and len(parts) == 3 else a)

    def _apart(self, difference: Term) -> Term:
        _, a, b = self._parts[difference]
        return self.make("apart", *sorted((a, b)))  # type: ignore[type-var]

    def constant(self, value: Value) -> Term:
        """A constant; -0.0 is not 0.0, and 1 is not 1.0."""
        return self.make("const", exact(value))


def exact(value: Value) -> Hashable:
    """A value that equals another one only where they are the same bits of the same type."""
    if isinstance(value, tuple):
        return tuple([exact(v) for v in value])
    if isinstance(value, bool):
        return value
    return value.hex() if isinstance(value, float) else ("int", value)


class TermReading:
    """One step or predicate, read as terms; `rename` says what its cells are called."""

    def __init__(self, terms: InternedTerms, rename: Rename, budget: int = STATEMENTS_MAX) -> None:
        self.terms = terms
        self.rename = rename
        self.env: dict[str, Term] = {}
        self.faults: set[tuple[Term, Term]] = set()
        self.said: dict[int, tuple[Term, Term]] = {}
        """By output: whether it is published, and the last value."""
        self.messages: dict[int, list[tuple[Term, Term]]] = {}
        """By output: all that is published, in order; of outputs that may publish several."""
        self.chosen = 0
        self.left = budget

    # ------------------------------------------------------------ statements

    def run(self, statements: Sequence[core.Stmt], where: Term) -> None:
        """Execute them where a condition holds. `TermTooLongError`."""
        for s in statements:
            self.left -= 1
            if self.left < 0:
                raise TermTooLongError
            self._statement(s, where)

    def _statement(self, s: core.Stmt, where: Term) -> None:
        if isinstance(s, core.Let):
            self.env[s.name] = self.expr(s.value)
        elif isinstance(s, core.Checked):
            self.env[s.name] = self._checked(s)
            self.faults.add((where, self.env[s.name]))
        elif isinstance(s, core.Guard):
            self.faults.add((where, self.terms.make("unless", self.expr(s.condition))))
        elif isinstance(s, core.If):
            self._if(s, where)
        elif isinstance(s, core.Loop):
            for k in range(s.low, s.high):
                self.env[s.variable] = self.terms.constant(k)
                self.run(s.body, where)
        elif isinstance(s, core.Call):
            self.env[s.name] = self._call(s, where)
        else:
            self._change(s, where)

    def _change(self, s: core.Stmt, where: Term) -> None:
        make = self.terms.make
        if isinstance(s, core.Choose):
            self._choose(s)
        elif isinstance(s, core.Set):
            value = self.expr(s.value)
            at = self._path(s.path)
            self.env[s.name] = make("with", self.env[s.name], at, value) if s.path else value
        elif isinstance(s, core.Push):
            at = self._path(s.path)
            pushed = make("pushed", s.type, self.env[s.name], at, self.expr(s.value))
            self.faults.add((where, pushed))
            self.env[s.name] = pushed
        else:
            assert isinstance(s, core.Publish), s
            value = self.expr(s.value)
            if s.limit is not None:
                self.messages.setdefault(s.output, []).append((where, value))
            self.said[s.output] = (self.terms.true, value)

    def _path(self, path: Sequence[int | core.Expr]) -> Term:
        return self.terms.make(
            "path",
            *[self.terms.constant(p) if isinstance(p, int) else self.expr(p) for p in path],
        )

    def _choose(self, s: core.Choose) -> None:
        """The choices of a step are told apart by their number."""
        make, old = self.terms.make, None if s.ages is None else self.env[s.ages]
        self.env[s.name] = make("choice", self.chosen, s.type, s.count, s.low, old)
        if s.ages is not None:
            self.env[s.ages] = make("aged", self.env[s.name])
        self.chosen += 1

    def _if(self, s: core.If, where: Term) -> None:
        terms = self.terms
        condition = self.expr(s.condition)
        before, said = dict(self.env), dict(self.said)
        self.run(s.then, terms.joined("&&", (where, condition)))
        then, told = self.env, self.said
        self.env, self.said = dict(before), dict(said)
        self.run(s.otherwise, terms.joined("&&", (where, terms.no(condition))))
        for name in before:
            self.env[name] = terms.either(condition, then[name], self.env[name])
        for k in {**told, **self.said}:
            nothing = (terms.false, terms.make("nothing"))
            (p, a), (q, b) = told.get(k, nothing), self.said.get(k, nothing)
            self.said[k] = terms.either(condition, p, q), terms.either(condition, a, b)

    def _checked(self, s: core.Checked) -> Term:
        terms = self.terms
        given = [self.expr(o) for o in s.operands]
        limit = None if s.limit is None else self.expr(s.limit)
        if s.op == "abs":
            return terms.size("whole abs", given[0])
        given = sorted(given) if s.op in ("add", "mul") else given
        plain = isinstance(s.type, IntType) and s.type.is_full and limit is None
        return terms.make(s.op, *given, *(() if plain else (s.type, limit)))

    def _call(self, s: core.Call, where: Term) -> Term:
        terms, f = self.terms, self.terms.functions[s.function]
        given = [self.expr(a) for a in s.arguments]
        if f.result is None:  # somebody else's code
            value = terms.make("call", f.name, *given)
            self.faults.add((where, value))
            return value
        inner = TermReading(terms, self.rename, self.left)
        inner.env = {p.name: a for p, a in zip(f.parameters, given, strict=True)}
        inner.run(f.body, where)
        self.left = inner.left
        self.faults |= inner.faults
        return inner.expr(f.result)

    # ------------------------------------------------------------ expressions

    def expr(self, e: core.Expr) -> Term:
        """The term of an expression."""
        terms = self.terms
        if isinstance(e, core.Const):
            return terms.constant(e.value)
        if isinstance(e, core.Var):
            return self.env[e.name]
        if isinstance(e, core.Get):
            return terms.make("read", self.rename(e.cell))
        if isinstance(e, core.Fact):
            return terms.make("fact", self.rename(e))
        if isinstance(e, core.Binary):
            return terms.binary(e.op, self.expr(e.left), self.expr(e.right))
        if isinstance(e, core.Unary):
            return self._unary(e.op, self.expr(e.operand))
        if isinstance(e, core.Select):
            condition, then = self.expr(e.condition), self.expr(e.then)
            return terms.either(condition, then, self.expr(e.otherwise))
        return self._made(e)

    def _unary(self, op: str, operand: Term) -> Term:
        if op == "not":
            return self.terms.no(operand)
        return self.terms.size(op, operand) if op == "abs" else self.terms.make(op, operand)

    def _made(self, e: core.Expr) -> Term:
        make = self.terms.make
        if isinstance(e, core.Extreme):
            both = [self.expr(e.left), self.expr(e.right)]
            both = sorted(both) if isinstance(e.type, (IntType, BoolType)) else both
            return make(e.op, *both)
        if isinstance(e, core.Field):
            return make("field", self.expr(e.target), e.index)
        if isinstance(e, core.Element):
            return make("element", self.expr(e.target), self.expr(e.index))
        if isinstance(e, core.Length):
            return make("length", self.expr(e.target))
        assert isinstance(e, core.Make), e
        return make("make", e.type, *[self.expr(x) for x in e.elements])

    # ------------------------------------------------------------ results

    def faulty(self) -> frozenset[tuple[Term, Term]]:
        """Where it faults. A difference that has a size in 64 bits has none that overflows."""
        parts = self.terms.parts
        sized = {
            (where, frozenset(parts(parts(t)[1])[1:]))  # type: ignore[arg-type]
            for where, t in self.faults
            if parts(t)[0] == "whole abs" and parts(parts(t)[1])[0] == "apart"  # type: ignore[arg-type]
        }
        return frozenset(
            [
                (where, t)
                for where, t in self.faults
                if parts(t)[0] != "sub" or (where, frozenset(parts(t)[1:])) not in sized
            ]
        )


Computed = tuple["Hashable", ...]


def of_predicate(terms: InternedTerms, p: core.Predicate | None, rename: Rename) -> Computed:
    """A condition: its value, and where it faults."""
    if p is None:
        return ("none",)
    reading = TermReading(terms, rename)
    reading.run(p.body, terms.true)
    return "predicate", reading.expr(p.value), reading.faulty()


def of_step(
    terms: InternedTerms,
    step: core.NodeStep | core.PlantStep,
    rename: Rename,
    topic: Mapping[int, int],
) -> Computed:
    """What a step computes: locals or states, publications, faults, draws."""
    reading = TermReading(terms, rename)
    kept = step.locals if isinstance(step, core.NodeStep) else step.states
    for x in kept:
        reading.env[x.name] = terms.make("read", rename(x.cell))
    more: tuple[Hashable, ...] = ()
    if isinstance(step, core.NodeStep):
        _at_times(reading, step.takeover, "takes over")
        reading.run(step.body, terms.true)
    else:
        more = _plant(reading, step, topic)
    outputs = [
        (
            topic.get(o.topic, o.topic),
            o.type,
            o.bounds,
            o.burst,
            reading.said.get(k),
            tuple(reading.messages.get(k, ())),
        )
        for k, o in enumerate(step.outputs)
    ]
    after = frozenset([(rename(x.cell), x.type, reading.env[x.name]) for x in kept])
    return "step", after, frozenset(outputs), reading.faulty(), *more


def _at_times(reading: TermReading, some: Sequence[core.Stmt], when: str) -> None:
    """Statements that are executed in some steps only, which the engine tells."""
    terms, before = reading.terms, dict(reading.env)
    condition = terms.make(when)
    reading.run(some, condition)
    for name, old in before.items():
        reading.env[name] = terms.either(condition, reading.env[name], old)


def _plant(
    reading: TermReading, step: core.PlantStep, topic: Mapping[int, int]
) -> tuple[Hashable, ...]:
    """All but the first step integrate; draws are told apart by their numbers."""
    terms = reading.terms
    for k, (name, t, draws) in enumerate(step.disturbances):
        drawn = tuple([(d.low, d.high, d.hold_ns) for d in draws])
        reading.env[name] = terms.make("drawn", k, t, drawn)
    reading.run(step.choose, terms.true)
    _at_times(reading, step.integrate, "integrates")
    reading.run(step.publish, terms.true)
    of = [topic.get(o.topic, o.topic) for o in step.outputs]
    noise = [(of[o], leaf, d.low, d.high, d.hold_ns) for o, leaf, d in step.noise]
    return frozenset(noise), step.extern

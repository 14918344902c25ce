"""What steps and predicates compute, as terms: equal terms are the same function of what is read.

Purpose: `TermReading` executes Core over terms (`core/core_walks.py`), both sides of every branch,
so that two steps can be compared up to a renaming of what they read and write. Terms are interned:
a number stands for each, and equal terms have equal numbers. What commutes exactly (`&&`, `||`,
`==`, `!=`, `+`, `*`, `abs` of a difference, `min` and `max` of ints) has its operands in one order;
nothing else is known of arithmetic, so terms that differ may still be equal.

Faults are a set of (where it is reached, what faults): a step faults iff one of them does. Its
order is of no matter: the first one that does reads values that no fault has spoilt, and which one
was first is no part of a configuration.
Non-goals: which renamings there are (`symmetry.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core_walks import Execution
from soter.language.model.types import BoolType, IntType

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping, Sequence

    from soter.core.core_walks import Join
    from soter.language.model.types import Type, Value

    Term = int
    Rename = Callable[[core.Cell | core.Fact], Hashable]
    """What a cell or a fact is called in terms."""

COMMUTES = frozenset({"==", "!=", "+", "*"})
FLIPPED = {">": "<", ">=": "<="}


class InternedTerms:
    """Makes terms, each of them once."""

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
        """The operator and operands of a term."""
        return self._parts[term]

    # ------------------------------------------------------------ conditions

    def connect(self, op: str, conditions: Sequence[Term]) -> Term:
        """The `&&` or `||` of conditions, sorted, each once."""
        zero, one = (self.false, self.true) if op == "&&" else (self.true, self.false)
        flat: set[Term] = set()
        for t in conditions:
            parts = self._parts[t]
            flat |= set(parts[1:]) if parts[0] == op else {t}  # type: ignore[arg-type]
        flat.discard(one)
        if zero in flat:
            return zero
        return flat.pop() if len(flat) == 1 else self.make(op, *sorted(flat)) if flat else one

    def negate(self, t: Term) -> Term:
        """The negation."""
        parts = self._parts[t]
        if t in (self.true, self.false):
            return self.true if t == self.false else self.false
        return parts[1] if parts[0] == "not" else self.make("not", t)  # type: ignore[return-value]

    def either(self, condition: Term, then: Term, otherwise: Term) -> Term:
        """The value `then` where the condition holds, else `otherwise`."""
        if condition in (self.true, self.false):
            return then if condition == self.true else otherwise
        if then == otherwise:
            return then
        if otherwise == self.false:
            return self.connect("&&", (condition, then))
        if then == self.true:
            return self.connect("||", (condition, otherwise))
        return self.make("either", condition, then, otherwise)

    # ------------------------------------------------------------ operators

    def binary(self, op: str, a: Term, b: Term) -> Term:
        """A pure operator, or one on ints that may fault."""
        if op in ("&&", "||"):
            return self.connect(op, (a, b))
        if op in FLIPPED:
            return self.make(FLIPPED[op], b, a)
        if op == "*" and a == b and self._parts[a][0] == "-":
            return self.make("square", self._apart(a))  # (x - y)² = (y - x)², bit by bit
        return self.make(op, *sorted((a, b))) if op in COMMUTES else self.make(op, a, b)

    def absolute(self, op: str, a: Term) -> Term:
        """The operation `abs`; of a difference it is the same either way round."""
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
    """A key that is equal for two values only if they have the same bits and type."""
    if isinstance(value, tuple):
        return tuple([exact(v) for v in value])
    if isinstance(value, bool):
        return value
    return value.hex() if isinstance(value, float) else ("int", value)


class TermReading(Execution["Term"]):
    """Reads one step or predicate as terms; `rename`: the names of its cells."""

    def __init__(self, terms: InternedTerms, rename: Rename) -> None:
        super().__init__(terms.functions)
        self.terms = terms
        self.rename = rename
        self.where = terms.true
        self.faults: set[tuple[Term, Term]] = set()
        self.messages: dict[int, list[tuple[Term, Term]]] = {}
        """For outputs that may publish several messages, all that is published, in order."""
        self.chosen = 0

    # ------------------------------------------------------------ statements

    def _guard(self, condition: Term) -> None:
        self.faults.add((self.where, self.terms.make("unless", condition)))

    def _changed(
        self, s: core.Set | core.Push, old: Term, path: list[int | Term], value: Term
    ) -> Term:
        make = self.terms.make
        given = zip(s.path, path, strict=True)
        at = make("path", *[self.terms.constant(p) if isinstance(e, int) else p for e, p in given])
        if isinstance(s, core.Set):
            return make("with", old, at, value) if s.path else value
        pushed = make("pushed", s.type, old, at, value)
        self.faults.add((self.where, pushed))
        return pushed

    def _publish(self, s: core.Publish, value: Term) -> None:
        if s.limit is not None:
            self.messages.setdefault(s.output, []).append((self.where, value))
        super()._publish(s, value)

    def _choose(self, s: core.Choose) -> Term:
        """A term for a choice, by its number in the step."""
        make, old = self.terms.make, None if s.ages is None else self.frame.variables[s.ages]
        choice = make("choice", self.chosen, s.type, s.count, s.low, old)
        if s.ages is not None:
            self.frame.variables[s.ages] = make("aged", choice)
        self.chosen += 1
        return choice

    def _known(self, _: Term) -> None:
        """None, so that both sides of every branch are followed."""

    def _reached(self, where: Term, condition: Term, truth: bool) -> Term:
        return self.terms.connect(
            "&&", (where, condition if truth else self.terms.negate(condition))
        )

    def _join(self, condition: Term, *_: None) -> Join[Term]:
        def join(a: Term | None, b: Term | None, _: Type) -> Term:
            a, b = (self.terms.make("nothing") if x is None else x for x in (a, b))
            return self.terms.either(condition, a, b)

        return join

    def _checked(self, s: core.Checked, operands: list[Term], limit: Term | None) -> Term:
        terms = self.terms
        if s.op == "abs":
            value = terms.absolute("whole abs", operands[0])
        else:
            given = sorted(operands) if s.op in ("add", "mul") else operands
            plain = isinstance(s.type, IntType) and s.type.is_full and limit is None
            value = terms.make(s.op, *given, *(() if plain else (s.type, limit)))
        self.faults.add((self.where, value))
        return value

    def call(self, f: core.Function, arguments: tuple[Term, ...]) -> Term:
        """The result of a function; for extern code a term of its own."""
        if f.result is not None:
            return super().call(f, arguments)
        value = self.terms.make("call", f.name, *arguments)
        self.faults.add((self.where, value))
        return value

    # ------------------------------------------------------------ expressions

    def _operation(self, e: core.Expr, *operands: Term) -> Term:
        terms, make = self.terms, self.terms.make
        if isinstance(e, core.Const):
            return terms.constant(e.value)
        if isinstance(e, core.Get):
            return make("read", self.rename(e.cell))
        if isinstance(e, core.Fact):
            return make("fact", self.rename(e))
        if isinstance(e, core.Binary):
            return terms.binary(e.op, *operands)
        if isinstance(e, core.Unary):
            return self._unary(e.op, *operands)
        if isinstance(e, core.Select):
            return terms.either(*operands)
        if isinstance(e, core.Extreme):
            commutes = isinstance(e.type, (IntType, BoolType))
            return make(e.op, *(sorted(operands) if commutes else operands))
        if isinstance(e, core.Field):
            return make("field", *operands, e.index)
        if isinstance(e, core.Make):
            return make("make", e.type, *operands)
        assert isinstance(e, (core.Element, core.Length)), e
        return make("element" if isinstance(e, core.Element) else "length", *operands)

    def _unary(self, op: str, operand: Term) -> Term:
        if op == "not":
            return self.terms.negate(operand)
        return self.terms.absolute(op, operand) if op == "abs" else self.terms.make(op, operand)

    # ------------------------------------------------------------ results

    def faulty(self) -> frozenset[tuple[Term, Term]]:
        """The places where it faults; a difference whose `abs` is in 64 bits does not overflow."""
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


def predicate_terms(terms: InternedTerms, p: core.Predicate | None, rename: Rename) -> Computed:
    """A condition: its value, and where it faults."""
    if p is None:
        return ("none",)
    reading = TermReading(terms, rename)
    reading.run(p.body)
    return "predicate", reading.expr(p.value), reading.faulty()


def step_terms(
    terms: InternedTerms,
    step: core.NodeStep | core.PlantStep,
    rename: Rename,
    topic: Mapping[int, int],
) -> Computed:
    """What a step computes: locals or states, publications, faults, draws.

    A step with a shield equals no other, so that it is never renamed.
    """
    if isinstance(step, core.NodeStep) and step.shield is not None:
        return "shield", object()
    reading = TermReading(terms, rename)
    kept = step.locals if isinstance(step, core.NodeStep) else step.states
    for variable in kept:
        reading.bind(variable.name, variable.type, terms.make("read", rename(variable.cell)))
    draws: tuple[Hashable, ...] = ()
    if isinstance(step, core.NodeStep):
        takes = terms.make("takes over")
        reading.branch(takes, lambda: reading.run(step.takeover), lambda: None)
        reading.run(step.body)
    else:
        draws = _plant_terms(reading, step, topic)
    outputs = [
        (
            topic.get(output.topic, output.topic),
            output.type,
            output.bounds,
            output.burst,
            reading.frame.outputs.get(number, ())[:2],
            tuple(reading.messages.get(number, ())),
        )
        for number, output in enumerate(step.outputs)
    ]
    after = frozenset(
        [
            (rename(variable.cell), variable.type, reading.frame.variables[variable.name])
            for variable in kept
        ]
    )
    return "step", after, frozenset(outputs), reading.faulty(), *draws


def _plant_terms(
    reading: TermReading, step: core.PlantStep, topic: Mapping[int, int]
) -> tuple[Hashable, ...]:
    """What a plant's step computes; all but the first one integrate; draws go by number."""
    terms = reading.terms
    for number, (name, t, draws) in enumerate(step.disturbances):
        drawn = tuple([(d.low, d.high, d.hold_ns) for d in draws])
        reading.bind(name, t, terms.make("drawn", number, t, drawn))
    reading.run(step.choose)
    integrates = terms.make("integrates")
    reading.branch(integrates, lambda: reading.run(step.integrate), lambda: None)
    reading.run(step.publish)
    topics = [topic.get(output.topic, output.topic) for output in step.outputs]
    noise = [(topics[output], leaf, d.low, d.high, d.hold_ns) for output, leaf, d in step.noise]
    return frozenset(noise), step.extern

"""Core read over terms: what a step publishes, and whether it faults, as a function of its reads.

Purpose: statements and expressions of Core with both sides of every branch, joined by conditions.
What terms cannot say exactly is an uninterpreted function of what it is computed from.
Non-goals: when a step runs and what it then reads (`transition_relation.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from soter.core import core
from soter.language.model.types import (
    BOOL,
    FLOAT,
    INT,
    INT_MAX,
    INT_MIN,
    ArrayType,
    BoolType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.verify.induction.solver_terms import Age, is_known, is_tuple, is_whole, parts

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.language.model.types import Type
    from soter.verify.induction.solver_terms import SolverTerms, Term

STATEMENTS_MAX = 20_000
"""Of one step or predicate, loops unrolled."""
INLINE_MAX = 60
"""Statements of a function that is read where it is called; a longer one is uninterpreted."""
SWAPPED = {">": "<", ">=": "<=", "<": ">", "<=": ">=", "==": "==", "!=": "!="}


class StepTooLongError(Exception):
    """A step that takes more statements than are followed."""


class Reads(Protocol):
    """What a step sees."""

    def cell(self, cell: core.Cell, t: Type) -> Term:
        """The content of a topic."""

    def fact(self, fact: core.Fact) -> Term:
        """`time`, `in_control`, a mode, an age."""


class Evaluation:
    """One step, or one predicate."""

    def __init__(
        self,
        terms: SolverTerms,
        functions: Mapping[str, core.Function],
        reads: Reads,
        budget: int = 0,
    ) -> None:
        self.terms = terms
        self.functions = functions
        self.reads = reads
        self.env: dict[str, Term] = {}
        self.types: dict[str, Type] = {}
        self.fault: Term = False
        self.doubt: Term = False
        """A fault that hangs on something uninterpreted: there may be none."""
        self.published: dict[int, tuple[Term, Term, Type]] = {}
        """By output: whether there is a publication, its value."""
        self.left = budget or STATEMENTS_MAX
        self.uninterpreted: dict[str, None] = {}
        """Functions of the program of which nothing but their arguments was looked at."""

    def bind(self, name: str, t: Type, value: Term) -> None:
        """A temporary."""
        self.env[name], self.types[name] = value, t

    # ------------------------------------------------------------ statements

    def run(self, statements: Sequence[core.Stmt], where: Term = True) -> None:
        """Execute them; `where`: under which condition they are reached. `StepTooLongError`."""
        for s in statements:
            self.left -= 1
            if self.left < 0:
                raise StepTooLongError
            self._statement(s, where)

    def _statement(self, s: core.Stmt, where: Term) -> None:
        terms = self.terms
        if isinstance(s, core.Let):
            self.bind(s.name, s.value.type, self.expr(s.value))
        elif isinstance(s, core.Checked):
            self._checked(s, where)
        elif isinstance(s, core.Choose):
            self._choose(s)
        elif isinstance(s, core.Guard):
            self._faults(where, terms.no(self.expr(s.condition)))
        elif isinstance(s, core.Call):
            self._call(s, where)
        elif isinstance(s, core.Set):
            steps = [p if isinstance(p, int) else self.expr(p) for p in s.path]
            new = self._with(self.env[s.name], s.type, steps, self.expr(s.value), s.value.type)
            self.bind(s.name, s.type, new)
        elif isinstance(s, core.Push):
            self._push(s, where)
        elif isinstance(s, core.If):
            self._if(s, where)
        elif isinstance(s, core.Loop):
            for k in range(s.low, s.high):
                self.bind(s.variable, INT, k)
                self.run(s.body, where)
        else:
            assert isinstance(s, core.Publish)
            assert s.limit is None, "bursts are not followed"
            self.published[s.output] = (True, self.expr(s.value), s.value.type)

    def _faults(self, where: Term, condition: Term) -> None:
        fault = self.terms.both(where, condition)
        if self.terms.is_opaque(condition):
            self.doubt = self.terms.either(self.doubt, fault)
        else:
            self.fault = self.terms.either(self.fault, fault)

    def _if(self, s: core.If, where: Term) -> None:
        terms = self.terms
        condition = self.expr(s.condition)
        if isinstance(condition, bool):
            self.run(s.then if condition else s.otherwise, where)
            return
        condition = terms.named(condition, "if")
        before, said = dict(self.env), dict(self.published)
        self.run(s.then, terms.both(where, condition))
        then, told = self.env, self.published
        self.env, self.published = dict(before), dict(said)
        self.run(s.otherwise, terms.both(where, terms.no(condition)))
        for name in before:
            if then[name] is not self.env[name]:
                t = self.types[name]
                self.env[name] = terms.chosen(condition, then[name], self.env[name], t)
        for k in {**told, **self.published}:
            self.published[k] = self._either(condition, told.get(k), self.published.get(k))

    def _either(
        self,
        condition: Term,
        a: tuple[Term, Term, Type] | None,
        b: tuple[Term, Term, Type] | None,
    ) -> tuple[Term, Term, Type]:
        one = a or b
        assert one is not None
        t = one[2]
        (said_a, value_a, _), (said_b, value_b, _) = (x or (False, one[1], t) for x in (a, b))
        terms = self.terms
        return (
            terms.chosen(condition, said_a, said_b, BOOL),
            terms.chosen(condition, value_a, value_b, t),
            t,
        )

    def _choose(self, s: core.Choose) -> None:
        terms = self.terms
        if isinstance(s.type, BoolType):
            value = terms.truth(s.name)
        else:
            value = terms.whole(s.name)
            terms.state(terms.both(s.low <= value, value < s.low + s.count))
        self.bind(s.name, s.type, value)
        if s.ages is not None:
            t = self.types[s.ages]
            self.bind(s.ages, t, terms.fresh(t, s.ages))

    # ------------------------------------------------------------ operations that may fault

    def _checked(self, s: core.Checked, where: Term) -> None:
        values = [self.expr(o) for o in s.operands]
        limit = None if s.limit is None else self.expr(s.limit)
        value, fault = self._operation(s, values, limit)
        self._faults(where, fault)
        self.bind(s.name, s.type, value)

    def _operation(self, s: core.Checked, v: list[Term], limit: Term) -> tuple[Term, Term]:
        """The value where there is no fault, and whether there is one."""
        terms, z3 = self.terms, self.terms.z3
        if s.op == "index":
            return v[0], terms.no(terms.both(v[0] >= 0, v[0] < limit))
        if s.op == "narrow":
            assert isinstance(s.type, IntType)
            return v[0], terms.no(terms.both(s.type.low <= v[0], v[0] <= s.type.high))
        if s.op == "to_int":
            given = [terms.lifted(FLOAT, v[0])]
            return terms.apply("to_int", given, INT), terms.apply("to_int faults", given, BOOL)
        if s.op in ("div", "mod"):
            return self._quotient(s.op, v)
        if s.op == "add":
            value = v[0] + v[1]
        elif s.op == "sub":
            value = v[0] - v[1]
        elif s.op == "mul":
            value = v[0] * v[1]
        elif s.op == "neg":
            value = -v[0]
        else:
            assert s.op == "abs", s.op
            value = abs(v[0]) if is_known(v[0]) else z3.If(v[0] < 0, -v[0], v[0])
        return value, terms.no(terms.both(value >= INT_MIN, value <= INT_MAX))

    def _quotient(self, op: str, v: list[Term]) -> tuple[Term, Term]:
        """Towards zero; by a divisor that is known, else uninterpreted."""
        terms, z3 = self.terms, self.terms.z3
        a, b = v
        if not is_known(b):
            given = [x for y in v for x in terms.flat(y, INT)]
            over = terms.both(a == INT_MIN, b == -1)
            return terms.apply(op, given, INT), terms.either(b == 0, over)
        if b == 0:
            return 0, True
        if is_known(a):
            q = abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)
            return (q if op == "div" else a - q * b), q > INT_MAX and op == "div"
        size = z3.If(a < 0, -a, a) / abs(b)
        q = z3.If(a < 0, -size, size) if b > 0 else z3.If(a < 0, size, -size)
        return (q if op == "div" else a - q * b), (q > INT_MAX if op == "div" else False)

    def _call(self, s: core.Call, where: Term) -> None:
        f = self.functions[s.function]
        arguments = [self.expr(a) for a in s.arguments]
        if f.result is not None and _size(f.body) <= INLINE_MAX:
            inner = Evaluation(self.terms, self.functions, self.reads, self.left)
            for p, a in zip(f.parameters, arguments, strict=True):
                inner.bind(p.name, p.type, a)
            inner.run(f.body)
            value, fault = inner.expr(f.result), inner.fault
            self.doubt = self.terms.either(self.doubt, self.terms.both(where, inner.doubt))
            self.left = inner.left
            self.uninterpreted |= inner.uninterpreted
        else:
            pairs = zip(arguments, f.parameters, strict=True)
            given = [x for a, p in pairs for x in self.terms.flat(a, p.type)]
            name = f"fun {f.name}"
            value = self.terms.apply(name, given, f.result_type)
            fault = self.terms.apply(f"{name} faults", given, BOOL) if f.can_fault else False
            self.uninterpreted[f.source_name] = None
        self._faults(where, fault)
        self.bind(s.name, s.type, value)

    def _push(self, s: core.Push, where: Term) -> None:
        terms = self.terms
        steps = [p if isinstance(p, int) else self.expr(p) for p in s.path]
        old, t = self._at(self.env[s.name], s.type, steps)
        assert isinstance(t, ListType)
        self._faults(where, terms.length(terms.lifted(t, old)) >= t.capacity)
        given = [terms.lifted(t, old), *terms.flat(self.expr(s.value), s.value.type)]
        new = terms.apply("push", given, t)
        self.bind(s.name, s.type, self._with(self.env[s.name], s.type, steps, new, t))

    # ------------------------------------------------------------ parts of values

    def _at(self, value: Term, t: Type, steps: Sequence[Term]) -> tuple[Term, Type]:
        for step in steps:
            value, t = self._part(value, t, step)
        return value, t

    def _part(self, value: Term, t: Type, index: Term) -> tuple[Term, Type]:
        terms = self.terms
        if isinstance(t, RecordType):
            return value[index], t.fields[index][1]
        assert isinstance(t, (ArrayType, ListType))
        if not is_tuple(t):
            given = [terms.lifted(t, value), *terms.flat(index, INT)]
            return terms.apply("element", given, t.element), t.element
        if isinstance(index, int):
            return value[min(max(index, 0), len(value) - 1)], t.element
        element = value[-1]
        for k in range(len(value) - 2, -1, -1):
            element = terms.chosen(index == k, value[k], element, t.element)
        return element, t.element

    def _with(self, old: Term, t: Type, steps: Sequence[Term], new: Term, of: Type) -> Term:
        """A value with one part of it replaced."""
        if not steps:
            return new
        terms, (index, *rest) = self.terms, steps
        if not is_tuple(t):
            given = [terms.lifted(t, old), *terms.flat(new, of)]
            where = [x for s in steps for x in terms.flat(s, INT)]
            return terms.apply("replaced", [*given, *where], t)
        changed = []
        for k, (value, part) in enumerate(zip(old, parts(t), strict=True)):
            if isinstance(index, int) and index != k:
                changed.append(value)
                continue
            replaced = self._with(value, part, rest, new, of)
            here = True if isinstance(index, int) else index == k
            changed.append(terms.chosen(here, replaced, value, part))
        return tuple(changed)

    # ------------------------------------------------------------ expressions

    def expr(self, e: core.Expr) -> Term:
        """The value of an expression."""
        terms = self.terms
        if isinstance(e, core.Const):
            return terms.constant(e.type, e.value)
        if isinstance(e, core.Var):
            return self.env[e.name]
        if isinstance(e, core.Get):
            return self.reads.cell(e.cell, e.type)
        if isinstance(e, core.Fact):
            return self.reads.fact(e)
        if isinstance(e, core.Select):
            then, otherwise = self.expr(e.then), self.expr(e.otherwise)
            return terms.chosen(self.expr(e.condition), then, otherwise, e.type)
        if isinstance(e, core.Field):
            return self.expr(e.target)[e.index]
        if isinstance(e, core.Element):
            return self._part(self.expr(e.target), e.target.type, self.expr(e.index))[0]
        if isinstance(e, core.Length):
            return terms.length(terms.lifted(e.target.type, self.expr(e.target)))
        if isinstance(e, core.Make):
            values = [self.expr(x) for x in e.elements]
            if is_tuple(e.type):
                return tuple(values)
            types = [part.type for part in e.elements]
            return terms.listed(e.type, list(zip(values, types, strict=True)))
        if isinstance(e, core.Unary):
            return self._unary(e)
        if isinstance(e, core.Extreme):
            return self._extreme(e)
        assert isinstance(e, core.Binary), e
        return self._binary(e)

    def _unary(self, e: core.Unary) -> Term:
        value = self.expr(e.operand)
        if e.op == "not":
            return self.terms.no(value)
        if isinstance(value, (int, float)) and e.op in ("to_float", "neg", "abs"):
            known = float(value)
            return known if e.op == "to_float" else -known if e.op == "neg" else abs(known)
        return self.terms.apply(e.op, self.terms.flat(value, e.operand.type), e.type)

    def _extreme(self, e: core.Extreme) -> Term:
        a, b = self.expr(e.left), self.expr(e.right)
        if is_whole(e.type) or (isinstance(a, float) and isinstance(b, float)):
            second = b < a if e.op == "min" else b > a
            return self.terms.chosen(second, b, a, e.type)
        given = [*self.terms.flat(a, e.left.type), *self.terms.flat(b, e.right.type)]
        return self.terms.apply(e.op, given, e.type)

    def _binary(self, e: core.Binary) -> Term:
        terms = self.terms
        a, b = self.expr(e.left), self.expr(e.right)
        t = e.left.type
        if e.op == "&&":
            return terms.both(a, b)
        if e.op == "||":
            return terms.either(a, b)
        if isinstance(t, BoolType) or is_whole(t):
            return _compared(terms, e.op, a, b)
        assert isinstance(t, FloatType), t
        if not isinstance(e.type, BoolType):
            return self._float(e.op, a, b)
        return self._floats_compared(e.op, a, b)

    def _float(self, op: str, a: Term, b: Term) -> Term:
        if isinstance(a, float) and isinstance(b, float):
            if op == "/" and b != 0.0:
                return a / b
            if op != "/":
                return a + b if op == "+" else a - b if op == "-" else a * b
        given = [self.terms.lifted(FLOAT, a), self.terms.lifted(FLOAT, b)]
        return self.terms.apply(f"float {op}", given, FLOAT)

    def _floats_compared(self, op: str, a: Term, b: Term) -> Term:
        terms = self.terms
        if isinstance(a, float) and isinstance(b, float):
            return _compared(terms, op, a, b)
        if isinstance(a, Age) and isinstance(b, float):
            return terms.compare_age(op, a.ns, b)
        if isinstance(a, float) and isinstance(b, Age):
            return terms.compare_age(SWAPPED[op], b.ns, a)
        if op == "!=":
            return terms.no(self._floats_compared("==", a, b))
        if op in (">", ">="):
            a, b, op = b, a, SWAPPED[op]
        given = [terms.lifted(FLOAT, a), terms.lifted(FLOAT, b)]
        return terms.apply(f"float {op}", given, BOOL)


def _compared(terms: SolverTerms, op: str, a: Term, b: Term) -> Term:
    if op == "==":
        return a == b
    if op == "!=":
        return terms.no(a == b)
    return a < b if op == "<" else a <= b if op == "<=" else a > b if op == ">" else a >= b


def _size(statements: Sequence[core.Stmt]) -> int:
    """Statements, loops unrolled."""
    count = 0
    for s in statements:
        count += 1
        if isinstance(s, core.If):
            count += _size(s.then) + _size(s.otherwise)
        elif isinstance(s, core.Loop):
            count += _size(s.body) * (s.high - s.low)
    return count

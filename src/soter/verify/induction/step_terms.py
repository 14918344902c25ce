"""Makes terms of a solver for one step: what it reads and publishes, and whether it faults.

Purpose: `Evaluation` executes Core with terms for values, and joins both ways of a branch by its
condition; a result that terms cannot give exactly is an uninterpreted function of its operands.
`State` is the state between clusters of steps, `StepEffect` has the effects of a step, and
`ClusterView` gives a reader the value and stamp that the last writer before it published.
Non-goals: the walk (`core/execution.py`), when steps run (`transition_relation.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from soter.core import core
from soter.core.execution import Execution
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
from soter.verify.induction.solver_terms import (
    Age,
    is_integer_type,
    is_known,
    is_tuple_type,
    part_types,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.core.execution import Join
    from soter.language.model.types import Type
    from soter.verify.induction.calendar import CalendarStep, Point
    from soter.verify.induction.problem import InductionProblem
    from soter.verify.induction.solver_terms import SolverTerms, Term


INLINE_MAX = 60
"""A function with more statements is not executed where it is called, but uninterpreted."""
SWAPPED = {">": "<", ">=": "<=", "<": ">", "<=": ">=", "==": "==", "!=": "!="}


class Reads(Protocol):
    """The values that a step or predicate reads."""

    def topic_value(self, cell: core.Cell, t: Type) -> Term:
        """The value of a topic."""

    def fact_value(self, fact: core.Fact) -> Term:
        """The value of `time`, `in_control`, a mode or an age."""


class Evaluation(Execution["Term"]):
    """Executes one step or predicate; `fault` is the condition under which it certainly faults."""

    def __init__(
        self, terms: SolverTerms, functions: Mapping[str, core.Function], reads: Reads
    ) -> None:
        super().__init__(functions)
        self.terms = terms
        self.reads = reads
        self.where = True
        self.fault: Term = False
        self.doubt: Term = False
        """The condition of faults that depend on an uninterpreted function, and may be none."""
        self.uninterpreted: dict[str, None] = {}
        """The names of the program's functions that count as uninterpreted."""

    def _guard(self, condition: Term) -> None:
        self._add_fault(self.terms.negated(condition))

    def _add_fault(self, condition: Term) -> None:
        fault = self.terms.all_of(self.where, condition)
        if self.terms.is_opaque(condition):
            self.doubt = self.terms.any_of(self.doubt, fault)
        else:
            self.fault = self.terms.any_of(self.fault, fault)

    def _branch_condition(self, condition: Term) -> Term:
        return self.terms.new_constant_for(condition, "if")

    def _decided_truth(self, condition: Term) -> bool | None:
        return condition if isinstance(condition, bool) else None

    def _where_in_side(self, where: Term, condition: Term, truth: bool) -> Term:
        return self.terms.all_of(where, condition if truth else self.terms.negated(condition))

    def _join_function(self, condition: Term, *_: None) -> Join[Term]:
        def join(a: Term, b: Term, t: Type) -> Term:
            a, b = (b if a is None else a), (a if b is None else b)
            return self.terms.choice(condition, a, b, t)

        return join

    def _chosen_value(self, s: core.Choose) -> Term:
        terms = self.terms
        if isinstance(s.type, BoolType):
            value = terms.unknown_bool(s.name)
        else:
            value = terms.unknown_int(s.name)
            terms.state(terms.all_of(s.low <= value, value < s.low + s.count))
        if s.ages is not None:
            t = self.frame.types[s.ages]
            self.bind(s.ages, t, terms.unknown(t, s.ages))
        return value

    def _publish(self, s: core.Publish, value: Term) -> None:
        assert s.limit is None, "bursts are not followed"
        super()._publish(s, value)

    def _checked_value(self, s: core.Checked, operands: list[Term], limit: Term) -> Term:
        value, fault = self._value_and_fault(s, operands, limit)
        self._add_fault(fault)
        return value

    def _value_and_fault(self, s: core.Checked, v: list[Term], limit: Term) -> tuple[Term, Term]:
        """The value that results without a fault, and the condition for a fault."""
        terms, z3 = self.terms, self.terms.z3
        if s.op == "index":
            return v[0], terms.negated(terms.all_of(v[0] >= 0, v[0] < limit))
        if s.op == "narrow":
            assert isinstance(s.type, IntType)
            return v[0], terms.negated(terms.all_of(s.type.low <= v[0], v[0] <= s.type.high))
        if s.op == "to_int":
            args = [terms.sort_term(FLOAT, v[0])]
            return terms.apply("to_int", args, INT), terms.apply("to_int faults", args, BOOL)
        if s.op == "number":
            return v[0], self._is_nan(v[0])
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
        return value, terms.negated(terms.all_of(value >= INT_MIN, value <= INT_MAX))

    def _is_nan(self, value: Term) -> Term:
        """The condition that a float is NaN; it is uninterpreted if the value is unknown."""
        if isinstance(value, Age):
            return False
        if isinstance(value, float):
            return value != value  # noqa: PLR0124
        return self.terms.apply("is NaN", [self.terms.sort_term(FLOAT, value)], BOOL)

    def _quotient(self, op: str, v: list[Term]) -> tuple[Term, Term]:
        """The quotient rounded towards zero, or the remainder, and the condition for a fault."""
        terms, z3 = self.terms, self.terms.z3
        a, b = v
        if not is_known(b):
            operands = [x for y in v for x in terms.leaves(y, INT)]
            over = terms.all_of(a == INT_MIN, b == -1)
            return terms.apply(op, operands, INT), terms.any_of(b == 0, over)
        if b == 0:
            return 0, True
        if is_known(a):
            q = abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)
            return (q if op == "div" else a - q * b), q > INT_MAX and op == "div"
        size = z3.If(a < 0, -a, a) / abs(b)
        q = z3.If(a < 0, -size, size) if b > 0 else z3.If(a < 0, size, -size)
        return (q if op == "div" else a - q * b), (q > INT_MAX if op == "div" else False)

    def result_of(self, f: core.Function, arguments: tuple[Term, ...]) -> Term:
        """The result of a function; the result of a long or extern function is uninterpreted."""
        terms = self.terms
        if f.result is not None and _statement_count(f.body) <= INLINE_MAX:
            where, fault, doubt = self.where, self.fault, self.doubt
            self.where, self.fault, self.doubt = True, False, False
            value = super().result_of(f, arguments)
            self.where, self.fault, inner = where, fault, self.fault
            self.doubt = terms.any_of(doubt, terms.all_of(where, self.doubt))
        else:
            pairs = zip(arguments, f.parameters, strict=True)
            operands = [x for a, p in pairs for x in terms.leaves(a, p.type)]
            name = f"fun {f.name}"
            value = terms.apply(f"fun {f.meaning or f.name}", operands, f.result_type)
            inner = terms.apply(f"{name} faults", operands, BOOL) if f.can_fault else False
            self.uninterpreted[f.source_name] = None
        self._add_fault(inner)
        return value

    def _with_part(self, s: core.Set | core.Push, old: Term, path: list[Term], value: Term) -> Term:
        t = s.value.type
        if isinstance(s, core.Push):
            value, t = self._list_after_push(s, *self._nested_part(old, s.type, path), value)
        return self._with_new_part(old, s.type, path, value, t)

    def _list_after_push(self, s: core.Push, old: Term, t: Type, value: Term) -> tuple[Term, Type]:
        terms = self.terms
        assert isinstance(t, ListType)
        self._add_fault(terms.length(terms.sort_term(t, old)) >= t.capacity)
        operands = [terms.sort_term(t, old), *terms.leaves(value, s.value.type)]
        return terms.apply("push", operands, t), t

    def _nested_part(self, value: Term, t: Type, steps: Sequence[Term]) -> tuple[Term, Type]:
        for step in steps:
            value, t = self._part_at(value, t, step)
        return value, t

    def _part_at(self, value: Term, t: Type, index: Term) -> tuple[Term, Type]:
        """The part of a value at an index, and its type; beyond an end it is the end's element."""
        terms = self.terms
        if isinstance(t, RecordType):
            return value[index], t.fields[index][1]
        assert isinstance(t, (ArrayType, ListType))
        if not is_tuple_type(t):
            operands = [terms.sort_term(t, value), *terms.leaves(index, INT)]
            return terms.apply("element", operands, t.element), t.element
        if isinstance(index, int):
            return value[min(max(index, 0), len(value) - 1)], t.element
        element = value[-1]
        for k in range(len(value) - 2, -1, -1):
            element = terms.choice(index == k, value[k], element, t.element)
        return element, t.element

    def _with_new_part(
        self, old: Term, t: Type, steps: Sequence[Term], new: Term, of: Type
    ) -> Term:
        """A copy of `old`, of type `t`, with `new`, of type `of`, as the part at `steps`."""
        if not steps:
            return new
        terms, (index, *rest) = self.terms, steps
        if not is_tuple_type(t):
            operands = [terms.sort_term(t, old), *terms.leaves(new, of)]
            where = [x for s in steps for x in terms.leaves(s, INT)]
            return terms.apply("replaced", [*operands, *where], t)
        changed = []
        for k, (value, part) in enumerate(zip(old, part_types(t), strict=True)):
            if isinstance(index, int) and index != k:
                changed.append(value)
                continue
            replaced = self._with_new_part(value, part, rest, new, of)
            here = True if isinstance(index, int) else index == k
            changed.append(terms.choice(here, replaced, value, part))
        return tuple(changed)

    def _operation_value(self, e: core.Expr, *operands: Term) -> Term:
        terms = self.terms
        if isinstance(e, core.Const):
            return terms.constant(e.type, e.value)
        if isinstance(e, core.Get):
            return self.reads.topic_value(e.cell, e.type)
        if isinstance(e, core.Fact):
            return self.reads.fact_value(e)
        if isinstance(e, core.Select):
            return terms.choice(operands[0], operands[1], operands[2], e.type)
        if isinstance(e, core.Field):
            return operands[0][e.index]
        if isinstance(e, core.Element):
            target, index = operands
            return self._part_at(target, e.target.type, index)[0]
        if isinstance(e, core.Length):
            return terms.length(terms.sort_term(e.target.type, *operands))
        if isinstance(e, core.Unary):
            return self._unary(e, *operands)
        if isinstance(e, core.Extreme):
            return self._extreme(e, *operands)
        if isinstance(e, core.Binary):
            return self._binary(e, *operands)
        assert isinstance(e, core.Make), e
        if is_tuple_type(e.type):
            return operands
        types = [part.type for part in e.elements]
        return terms.list_term(e.type, list(zip(operands, types, strict=True)))

    def _unary(self, e: core.Unary, operand: Term) -> Term:
        if e.op == "not":
            return self.terms.negated(operand)
        if isinstance(operand, (int, float)) and e.op in ("to_float", "neg", "abs"):
            known = float(operand)
            return known if e.op == "to_float" else -known if e.op == "neg" else abs(known)
        return self.terms.apply(e.op, self.terms.leaves(operand, e.operand.type), e.type)

    def _extreme(self, e: core.Extreme, a: Term, b: Term) -> Term:
        if is_integer_type(e.type) or (isinstance(a, float) and isinstance(b, float)):
            second = b < a if e.op == "min" else b > a
            return self.terms.choice(second, b, a, e.type)
        operands = [*self.terms.leaves(a, e.left.type), *self.terms.leaves(b, e.right.type)]
        return self.terms.apply(e.op, operands, e.type)

    def _binary(self, e: core.Binary, a: Term, b: Term) -> Term:
        terms = self.terms
        t = e.left.type
        if e.op == "&&":
            return terms.all_of(a, b)
        if e.op == "||":
            return terms.any_of(a, b)
        if isinstance(t, BoolType) or is_integer_type(t):
            return _comparison(terms, e.op, a, b)
        assert isinstance(t, FloatType), t
        if not isinstance(e.type, BoolType):
            return self._float_operation(e.op, a, b)
        return self._float_comparison(e.op, a, b)

    def _float_operation(self, op: str, a: Term, b: Term) -> Term:
        if isinstance(a, float) and isinstance(b, float):
            if op == "/" and b != 0.0:
                return a / b
            if op != "/":
                return a + b if op == "+" else a - b if op == "-" else a * b
        operands = [self.terms.sort_term(FLOAT, a), self.terms.sort_term(FLOAT, b)]
        return self.terms.apply(f"float {op}", operands, FLOAT)

    def _float_comparison(self, op: str, a: Term, b: Term) -> Term:
        terms = self.terms
        if isinstance(a, float) and isinstance(b, float):
            return _comparison(terms, op, a, b)
        if isinstance(a, Age) and isinstance(b, float):
            return terms.age_condition(op, a.ns, b)
        if isinstance(a, float) and isinstance(b, Age):
            return terms.age_condition(SWAPPED[op], b.ns, a)
        if op == "!=":
            return terms.negated(self._float_comparison("==", a, b))
        if op in (">", ">="):
            a, b, op = b, a, SWAPPED[op]
        operands = [terms.sort_term(FLOAT, a), terms.sort_term(FLOAT, b)]
        return terms.apply(f"float {op}", operands, BOOL)


def _comparison(terms: SolverTerms, op: str, a: Term, b: Term) -> Term:
    if op == "==":
        return a == b
    if op == "!=":
        return terms.negated(a == b)
    return a < b if op == "<" else a <= b if op == "<=" else a > b if op == ">" else a >= b


def _statement_count(statements: Sequence[core.Stmt]) -> int:
    """The number of statements when loops are unrolled."""
    count = 0
    for s in statements:
        count += 1
        if isinstance(s, core.If):
            count += _statement_count(s.then) + _statement_count(s.otherwise)
        elif isinstance(s, core.Loop):
            count += _statement_count(s.body) * (s.high - s.low)
    return count


SC, AC = 0, 1
NEVER = -(2**62)


@dataclass
class State:
    """The state between two clusters: the (value, stamp) of topics, the locals and the mode."""

    topics: dict[int, tuple[Term, Term]]
    locals: dict[tuple[int, str], Term]
    mode: Term
    had_control: dict[int, Term] = field(default_factory=dict)
    """Whether SC had control at its last step, by component; used by `on takeover`."""
    latched: dict[int, Term] = field(default_factory=dict)
    """Whether a component has faulted before; False where any fault fails the proof."""


@dataclass(eq=False)
class StepEffect:
    """A step's effects: topics as (whether published, value), and the mode after a DM's step."""

    step: CalendarStep
    published: dict[int, tuple[Term, Term]] = field(default_factory=dict)
    mode: Term | None = None
    before: Term | None = None
    """The mode before a step of the DM."""
    fault: Term = False
    doubt: Term = False
    """The condition of faults that depend on an uninterpreted function, and may be none."""


@dataclass(frozen=True)
class JudgedInstant:
    """The instant `at`, in [earliest, latest] in ns, at which claims are judged if `counts` holds.

    `holds`: the conditions that no step faulted, that `safe` holds, and that each lemma does.
    `later`: the condition that `safe` holds until the next effect, while ages grow.
    """

    counts: Term
    earliest: int
    latest: int
    at: Term
    holds: tuple[Term, ...]
    later: Term
    component: int
    progress: Term = True
    """The condition that the assumptions of P2b in `progress` hold then."""


class StepSurroundings(Protocol):
    """The part of a span of time that a view needs, as `transition_relation.TimeSpan` has it."""

    problem: InductionProblem
    terms: SolverTerms
    writers: list[int]
    state: State
    constant_topics: dict[int, Term]
    """Topics that are constant for P2b, though no node of the relation publishes them."""


class Order(Protocol):
    """The part of a cluster of steps that a view needs, as `transition_relation.Cluster` has it."""

    def topic_at(
        self, index: int, old: tuple[Term, Term], point: Point | None, step: CalendarStep | None
    ) -> tuple[Term, Term]:
        """The value and stamp of a topic after its last publication before a point."""

    def mode_at(self, old: Term, point: Point | None, step: CalendarStep | None) -> Term:
        """The mode after the last decision before a point."""


class ClusterView:
    """The view of a reader at a point of a cluster; the reader sees its own `step`, if any."""

    def __init__(
        self,
        span: StepSurroundings,
        cluster: Order | None,
        now: Term,
        point: Point | None = None,
        step: CalendarStep | None = None,
        *,
        enabled: Term = True,
    ) -> None:
        self.span, self.cluster, self.now, self.point, self.step = span, cluster, now, point, step
        self.enabled = enabled
        self._known: dict[int, tuple[Term, Term]] = {}

    def topic_value(self, cell: core.Cell, t: Type) -> Term:
        """The value of a topic; any value of its set if no node of the relation publishes it."""
        assert cell.kind == "topic", cell
        if cell.owner in self.span.constant_topics:
            return self.span.constant_topics[cell.owner]
        if cell.owner not in self.span.writers:
            topic = self.span.problem.system.topics[cell.owner]
            bounds = topic.bounds if topic.queue_of is None else None
            return self.span.terms.unknown(t, topic.name, bounds)
        return self.value_and_stamp(cell.owner)[0]

    def value_and_stamp(self, index: int) -> tuple[Term, Term]:
        """The value and the stamp of a topic that the relation publishes."""
        if index not in self._known:
            publication = self.span.state.topics[index]
            if self.cluster is not None:
                publication = self.cluster.topic_at(index, publication, self.point, self.step)
            self._known[index] = publication
        return self._known[index]

    def stamp(self, index: int) -> Term:
        """The stamp of a topic; an unknown past time if no node of the relation publishes it."""
        if index in self.span.writers:
            return self.value_and_stamp(index)[1]
        terms = self.span.terms
        stamp = terms.unknown_int("stamp")
        terms.state(stamp <= self.now)
        return stamp

    def mode(self) -> Term:
        """The mode of the module."""
        mode = self.span.state.mode
        return mode if self.cluster is None else self.cluster.mode_at(mode, self.point, self.step)

    def fact_value(self, fact: core.Fact) -> Term:
        """The value of a mode, an age or `in_control`; an unknown value for `time`."""
        if fact.fact == "mode":
            return self.mode()
        if fact.fact == "in_control":
            return self.enabled
        if fact.fact == "age":
            return Age(self.now - self.stamp(fact.index))
        return self.span.terms.unknown(FLOAT, "time")


def integer_if(terms: SolverTerms, condition: Term, then: Term, otherwise: Term) -> Term:
    """The integer term `then` if the condition holds, otherwise the integer term `otherwise`."""
    if isinstance(condition, bool) or then is otherwise:
        return then if condition is not False else otherwise
    return terms.z3.If(condition, then, otherwise)

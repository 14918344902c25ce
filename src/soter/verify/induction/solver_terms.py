"""Makes terms of the solver z3 for values of Soter, and asks the solver questions about them.

Purpose: `SolverTerms` makes the terms. Bools, ints and enums are exact; an age is whole
nanoseconds. All other values (floats, lists, long arrays) are elements of one uninterpreted sort,
and a result computed from them is an uninterpreted function: of equal arguments it gives equal
results, and nothing else is known of it. So each run of the program is a model of the terms, but
not each model is a run. `Query` searches in several ways, each with a limit of work and in a new
context, so that neither the machine's load nor earlier questions change a verdict.
Non-goals: statements (`step_terms.py`), time (`calendar.py`), which questions prove a module
(`prove_or_refute.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.model.types import (
    FLOAT,
    ArrayType,
    BoolType,
    DurationType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    leaves,
)
from soter.language.model.values import Table
from soter.version import pip_command
from soter.workers.interruptible_solver import ask_solver

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.system import Bound
    from soter.language.model.types import Type, Value

    Bounds = Sequence[Bound | None]


QUERY_WORK = 50_000_000
"""The limit for each way of searching, in z3's `rlimit` units: some five seconds of a free core."""
QUERY_MS = 120_000
"""The limit of time for each way, in ms, as some loops of the solver do not count their work."""


class Query:
    """A set of constraints with the question whether some values meet all of them.

    How z3 searches depends on how its context numbers terms, so a context used for other questions
    may answer differently. One way of searching may take a thousand times as long as another way
    (seen: 1.4 million units of work, and more than 470 million). So `check` tries each way in a new
    context, up to `QUERY_WORK`, however long that takes.
    """

    def __init__(self, z3: Term) -> None:
        self._z3 = z3
        self._constraints = z3.SimpleSolver()
        self._asked: Term = None

    def add(self, *truths: Term) -> None:
        """Adds constraints."""
        self._constraints.add(*[self._z3.BoolVal(t) if isinstance(t, bool) else t for t in truths])

    def check(self) -> Term:
        """Asks whether the constraints can be met: z3's `sat`, `unsat` or `unknown`."""
        answer = self._z3.unknown
        for way in (self._with_equations_solved, self._with_default_solver, self._with_simplex):
            self._asked = way(self._z3.Context())
            self._asked.set("rlimit", QUERY_WORK)
            self._asked.set("timeout", QUERY_MS)
            self._asked.set("random_seed", 0)
            self._asked.add(self._constraints.translate(self._asked.ctx).assertions())
            answer = ask_solver(self._asked)
            if answer != self._z3.unknown:
                break
        return answer

    def _with_equations_solved(self, context: Term) -> Term:
        tactics = ("simplify", "propagate-values", "solve-eqs", "smt")
        return self._z3.Then(*[self._z3.Tactic(t, context) for t in tactics]).solver()

    def _with_default_solver(self, context: Term) -> Term:
        return self._z3.SimpleSolver(ctx=context)

    def _with_simplex(self, context: Term) -> Term:
        solver = self._z3.SimpleSolver(ctx=context)
        solver.set("arith.solver", 2)
        return solver

    def model(self) -> Term:
        """Values that meet the constraints, after `sat`."""
        return self._asked.model().translate(self._z3.main_ctx())


Term = Any
"""A bool, int or float of Python if it is known, else a term of the solver or an `Age`; tuples of
these for records and short arrays."""
ARRAY_MAX = 16
"""The length above which an array is one value of the uninterpreted sort."""
ELEMENTS_MAX = 8
"""The number of elements of a constant list that the solver is told."""
AGE_MAX = 2**63


@dataclass(frozen=True)
class Age:
    """An age in seconds, the float `float(ns) / 1e9`, in which `ns` is a term."""

    ns: Term


def require_z3() -> Any:  # noqa: ANN401 - an untyped module
    """Gives the module `z3`; raises `SoterError` D007 if this optional package is not installed."""
    try:
        import z3  # noqa: PLC0415 - an extra
    except ImportError:
        helps = (f"install it: {pip_command('prove')}",)
        missing = Diagnostic("D007", "induction needs the package `z3-solver`", helps=helps)
        raise SoterError((missing,)) from None
    return z3


def is_known(term: Term) -> bool:
    """Whether a scalar is a Python value and not a term of the solver."""
    return isinstance(term, (bool, int, float))


def is_tuple_type(t: Type) -> bool:
    """Whether values of this type are represented as tuples of parts."""
    return isinstance(t, RecordType) or (isinstance(t, ArrayType) and t.size <= ARRAY_MAX)


def part_types(t: Type) -> list[Type]:
    """The type of each part of a record or of a short array, in order."""
    if isinstance(t, RecordType):
        return [f for _, f in t.fields]
    assert isinstance(t, ArrayType)
    return [t.element] * t.size


def structure_text(t: Type) -> str:
    """The structure of a type as text; types with different texts have no common values."""
    if isinstance(t, RecordType):
        return "{" + ", ".join(f"{n}: {structure_text(f)}" for n, f in t.fields) + "}"
    if isinstance(t, ArrayType):
        return f"{structure_text(t.element)}[{t.size}]"
    if isinstance(t, ListType):
        return f"{structure_text(t.element)}[<={t.capacity}]"
    return str(t)


def is_integer_type(t: Type) -> bool:
    """Whether values of this type are represented as integers of the solver."""
    return isinstance(t, (IntType, DurationType, EnumType))


@dataclass
class SolverTerms:
    """Makes terms of the solver; `facts` collects conditions that always hold, for every query."""

    facts: list[Term] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.z3 = require_z3()
        self.sort = self.z3.DeclareSort("value")
        self._count = 0
        self._constants: dict[tuple[Type, str], tuple[Value, Term]] = {}
        self._inside: dict[tuple[Type, object], tuple[Bounds, Term]] = {}
        self._made: list[tuple[Type, Term, list[tuple[Term, Type]]]] = []
        self._ranges_stated: set[tuple[str, int]] = set()
        self._opaque: dict[int, tuple[Term, bool]] = {}

    def all_of(self, *truths: Term) -> Term:
        """The condition that all of these conditions hold."""
        if any(t is False for t in truths):
            return False
        unknown = [t for t in truths if t is not True]
        return True if not unknown else unknown[0] if len(unknown) == 1 else self.z3.And(*unknown)

    def any_of(self, *truths: Term) -> Term:
        """The condition that at least one of these conditions holds."""
        if any(t is True for t in truths):
            return True
        unknown = [t for t in truths if t is not False]
        return False if not unknown else unknown[0] if len(unknown) == 1 else self.z3.Or(*unknown)

    def negated(self, truth: Term) -> Term:
        """The negation of a condition."""
        return not truth if isinstance(truth, bool) else self.z3.Not(truth)

    def query(self) -> Query:
        """A new query that contains all facts collected so far."""
        query = Query(self.z3)
        query.add(*self.facts)
        return query

    def state(self, truth: Term) -> None:
        """Adds a fact, a condition that always holds."""
        if truth is not True:
            self.facts.append(self.z3.BoolVal(False) if truth is False else truth)

    def new_name(self, start: str) -> str:
        """A new name that begins with `start`."""
        self._count += 1
        return f"{start}!{self._count}"

    def unknown(self, t: Type, name: str, bounds: Bounds | None = None) -> Term:
        """A term for an unknown value of a type; `bounds`, if any, limit each leaf."""
        if is_tuple_type(t):
            return tuple(
                self.unknown(part, f"{name}.{k}", bounds_)
                for k, (part, bounds_) in enumerate(_parts_with_bounds(t, bounds))
            )
        if isinstance(t, BoolType):
            return self.z3.Bool(self.new_name(name))
        if is_integer_type(t):
            term = self.z3.Int(self.new_name(name))
            low, high = range_of(t, bounds)
            self.state(self.z3.And(low <= term, term <= high))
            return term
        term = self.z3.Const(self.new_name(name), self.sort)
        if bounds is not None:
            self.state(self._publishable_predicate(t, bounds)(term))
        return term

    def unknown_int(self, name: str) -> Term:
        """A term for an unknown integer."""
        return self.z3.Int(self.new_name(name))

    def unknown_bool(self, name: str) -> Term:
        """A term for an unknown bool."""
        return self.z3.Bool(self.new_name(name))

    def constant(self, t: Type, value: Value) -> Term:
        """The term for a constant value of a type."""
        if is_tuple_type(t):
            return tuple(self.constant(p, v) for p, v in zip(part_types(t), value, strict=True))
        if isinstance(t, (ListType, ArrayType)):
            return self.sort_term(t, value)
        return value

    def sort_term(self, t: Type, value: Term) -> Term:
        """The term of a float, list or array in the solver's uninterpreted sort."""
        if isinstance(value, Age):
            return self.apply("seconds", [value.ns], FLOAT)
        if not isinstance(value, (float, int, tuple, Table)):  # of a table nothing is known
            return value
        key = (t, repr(value))
        if key not in self._constants:
            term = self.z3.Const(f"{structure_text(t)} {value!r}", self.sort)
            self._constants[key] = (value, term)
            for (of, _), (bounds, predicate) in self._inside.items():
                if of == t:
                    self.state(predicate(term) == passes_gate(value, t, bounds))
            if isinstance(t, ListType) and isinstance(value, tuple):
                self._state_list(term, t, value)
        return self._constants[key][1]

    def _state_list(self, term: Term, t: ListType, value: tuple[Value, ...]) -> None:
        """Adds facts about a constant list: the length and the first elements."""
        self.state(self.length(term) == len(value))
        for k, element in enumerate(value[:ELEMENTS_MAX]):
            element_term = self.apply("element", [term, self.z3.IntVal(k)], t.element)
            known = self.constant(t.element, element)
            pairs = zip(
                self.leaves(element_term, t.element), self.leaves(known, t.element), strict=True
            )
            self.state(self.all_of(*[a == b for a, b in pairs]))

    def length(self, term: Term) -> Term:
        """The length of a list."""
        return self.z3.Function("length", self.sort, self.z3.IntSort())(term)

    def _publishable_predicate(self, t: Type, bounds: Bounds) -> Term:
        """The uninterpreted predicate that a value of a type may be published in these bounds."""
        key = (t, tuple(None if b is None else (b.low, b.high) for b in bounds))
        if key not in self._inside:
            name = f"may be published {structure_text(t)} {key[1]}"
            predicate = self.z3.Function(name, self.sort, self.z3.BoolSort())
            self._inside[key] = (bounds, predicate)
            for (of, _), (value, term) in list(self._constants.items()):
                if of == t:
                    self.state(predicate(term) == passes_gate(value, t, bounds))
            for made, term, elements in list(self._made):
                if made == t:
                    self._state_list_publishable(predicate(term), t, elements, bounds)
        return self._inside[key][1]

    def _state_list_publishable(
        self, claim: Term, t: Type, elements: list[tuple[Term, Type]], bounds: Bounds
    ) -> None:
        """Adds the fact that a list may be published if and only if all elements may."""
        size = len(elements)
        element_bounds = (
            [bounds] * size
            if isinstance(t, ListType)
            else [b for _, b in _parts_with_bounds(t, bounds)]
        )
        passes = [
            self.may_publish(v, p, b or ())
            for (v, p), b in zip(elements, element_bounds, strict=True)
        ]
        self.state(claim == self.all_of(*passes))

    def list_term(self, t: Type, elements: list[tuple[Term, Type]]) -> Term:
        """The term of a list or long array; `elements` has pairs of a term and a type."""
        if not elements:
            return self.sort_term(t, ())
        parts = [x for v, p in elements for x in self.leaves(v, p)]
        made = self.apply(f"made {structure_text(t)} {len(elements)}", parts, t)
        self._made.append((t, made, elements))
        for (of, _), (bounds, predicate) in list(self._inside.items()):
            if of == t:
                self._state_list_publishable(predicate(made), t, elements, bounds)
        if isinstance(t, ListType):
            self.state(self.length(made) == len(elements))
        return made

    def may_publish(self, value: Term, t: Type, bounds: Bounds) -> Term:
        """The condition that the gate passes a value, which must be finite and within bounds."""
        if is_tuple_type(t):
            parts = zip(value, _parts_with_bounds(t, bounds), strict=True)
            return self.all_of(*[self.may_publish(v, p, b or ()) for v, (p, b) in parts])
        if isinstance(t, (BoolType, EnumType)):
            return True
        if is_integer_type(t):
            low, high = range_of(t, bounds)
            return self.all_of(low <= value, value <= high)
        if isinstance(value, float):
            return passes_gate(value, t, bounds)
        return self._publishable_predicate(t, bounds)(self.sort_term(t, value))

    def leaves(self, value: Term, t: Type) -> list[Term]:
        """The terms of a value's leaves, as arguments for a function of the solver."""
        if is_tuple_type(t):
            pairs = zip(value, part_types(t), strict=True)
            return [x for v, p in pairs for x in self.leaves(v, p)]
        if isinstance(t, BoolType):
            return [self.z3.BoolVal(value) if isinstance(value, bool) else value]
        if is_integer_type(t):
            return [self.z3.IntVal(value) if isinstance(value, int) else value]
        return [self.sort_term(t, value)]

    def apply(self, name: str, arguments: list[Term], t: Type) -> Term:
        """The value of an uninterpreted function of leaves; adds the range of `t` as a fact."""
        if is_tuple_type(t):
            return tuple(
                self.apply(f"{name}.{k}", arguments, part) for k, part in enumerate(part_types(t))
            )
        sorts = [a.sort() for a in arguments]
        if isinstance(t, BoolType):
            return self._solver_function(name, sorts, self.z3.BoolSort())(*arguments)
        if not is_integer_type(t):
            return self._solver_function(name, sorts, self.sort)(*arguments)
        term = self._solver_function(name, sorts, self.z3.IntSort())(*arguments)
        low, high = range_of(t, None)
        if (name, term.get_id()) not in self._ranges_stated:
            self._ranges_stated.add((name, term.get_id()))
            self.state(self.z3.And(low <= term, term <= high))
        return term

    def is_opaque(self, term: Term) -> bool:
        """Whether a term depends on an uninterpreted function; named terms are not looked into."""
        if is_known(term):
            return False
        known = self._opaque.get(term.get_id())
        if known is None:
            declared = self.z3.Z3_OP_UNINTERPRETED
            opaque = term.sort() == self.sort or (
                term.num_args() and term.decl().kind() == declared
            )
            opaque = bool(opaque) or any(self.is_opaque(x) for x in term.children())
            known = self._opaque[term.get_id()] = term, opaque  # kept: ids are given again
        return known[1]

    def _solver_function(self, name: str, sorts: list[Term], result: Term) -> Term:
        if not sorts:
            constant = self.z3.Const(name, result)
            return lambda: constant
        return self.z3.Function(f"{name}/{len(sorts)}", *sorts, result)

    def choice(self, condition: Term, then: Term, otherwise: Term, t: Type) -> Term:
        """The term `condition ? then : otherwise`, of type `t`."""
        if isinstance(condition, bool):
            return then if condition else otherwise
        if is_tuple_type(t):
            triples = zip(then, otherwise, part_types(t), strict=True)
            return tuple(self.choice(condition, a, b, p) for a, b, p in triples)
        if then is otherwise or (
            is_known(then) and is_known(otherwise) and _is_same_value(then, otherwise)
        ):
            return then
        if isinstance(t, FloatType) and isinstance(then, Age) and isinstance(otherwise, Age):
            return Age(self.z3.If(condition, then.ns, otherwise.ns))
        (a,), (b,) = self.leaves(then, t), self.leaves(otherwise, t)
        return self.z3.If(condition, a, b)

    def named_value(self, value: Term, t: Type, name: str) -> Term:
        """The same value with each term replaced by a new constant, to keep terms small."""
        if is_tuple_type(t):
            pairs = enumerate(zip(value, part_types(t), strict=True))
            return tuple(self.named_value(v, p, f"{name}.{k}") for k, (v, p) in pairs)
        if is_known(value):
            return value
        if isinstance(value, Age):
            return Age(self.new_constant_for(value.ns, name))
        return self.new_constant_for(value, name)

    def new_constant_for(self, term: Term, name: str) -> Term:
        """A new constant that equals a scalar term; a value or constant is returned unchanged."""
        if is_known(term) or self.z3.is_const(term):
            return term
        constant = self.z3.Const(self.new_name(name), term.sort())
        self.facts.append(constant == term)
        return constant

    def age_condition(self, op: str, ns: Term, limit: float) -> Term:
        """The condition `float(ns) / 1e9 op limit`; it is exact, as both functions are monotone."""
        if math.isnan(limit):
            return op == "!="
        reached, passed = _least_ns(limit, after=False), _least_ns(limit, after=True)
        if op == ">":
            return ns >= passed
        if op == ">=":
            return ns >= reached
        if op == "<":
            return ns < reached
        if op == "<=":
            return ns < passed
        same = self.all_of(ns >= reached, ns < passed)
        return same if op == "==" else self.negated(same)


def _is_same_value(a: Term, b: Term) -> bool:
    """Whether two known scalars have the same type and value (0.0 is not -0.0)."""
    return type(a) is type(b) and repr(a) == repr(b)


def _least_ns(limit: float, *, after: bool) -> int:
    """The least ns with float(ns) / 1e9 at least `limit`, or with `after` above `limit`."""
    low, high = 0, AGE_MAX
    while low < high:
        middle = (low + high) // 2
        seconds = float(middle) / 1e9
        if (seconds > limit) if after else (seconds >= limit):
            high = middle
        else:
            low = middle + 1
    return low


def _parts_with_bounds(t: Type, bounds: Bounds | None) -> list[tuple[Type, Bounds | None]]:
    """Each part of a type, with the bounds of the leaves in this part."""
    bounded_parts: list[tuple[Type, Bounds | None]] = []
    at = 0
    for part in part_types(t):
        count = sum(1 for _ in leaves(part))
        bounded_parts.append((part, None if bounds is None else bounds[at : at + count]))
        at += count
    return bounded_parts


def range_of(t: Type, bounds: Bounds | None) -> tuple[int, int]:
    """The range of an int, duration or enum type, within the bounds of its topic."""
    if isinstance(t, EnumType):
        return 0, len(t.members) - 1
    low, high = (t.low, t.high) if isinstance(t, IntType) else (-(2**63), 2**63 - 1)
    if bounds and bounds[0] is not None:
        low, high = max(low, math.ceil(bounds[0].low)), min(high, math.floor(bounds[0].high))
    return low, high


def passes_gate(value: Value, t: Type, bounds: Bounds) -> bool:
    """Whether the gate lets a known value pass."""
    if isinstance(t, (RecordType, ArrayType)):
        parts = zip(value, _parts_with_bounds(t, bounds), strict=True)
        return all(passes_gate(v, p, b or ()) for v, (p, b) in parts)
    if isinstance(t, ListType):
        return all(passes_gate(v, t.element, bounds) for v in value)
    if isinstance(t, (BoolType, EnumType)):
        return True
    if isinstance(t, FloatType) and not math.isfinite(value):
        return False
    return bounds[0] is None or bounds[0].low <= value <= bounds[0].high

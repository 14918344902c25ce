"""Steps and predicates as terms of a solver: what they do and publish, and when they fault.

Purpose: `SolverReading` completes the `CodeReader` of `reading/symbolic_reading.py`: topics, ages
and modes at an instant, choices, elements at unknown indices, and functions that are not read.
`SolverOperations` has operators and built-in functions, computed where all is known. Ages are
compared as whole nanoseconds; of floats it knows only that the same operation on the same values is
the same. It collects what goes wrong as `fault` and `doubt`.
Non-goals: time (`induction_problem.py`). What is not known here is not rechecked.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import z3

from soter.certificate.induction.solver_values import (
    LARGEST,
    OPAQUE,
    SMALLEST,
    Elapsed,
    and_of,
    as_term,
    calls_extern,
    choose,
    element_at,
    element_count,
    negation,
    or_of,
    part_types,
    reads_body,
    unknown_value,
    unread_result,
    value_as_terms,
)
from soter.certificate.reading.symbolic_operations import BUILTINS, COMPARED, FLOATS, INTS
from soter.certificate.reading.symbolic_reading import CallFrame, CodeReader, part_type
from soter.certificate.reading.symbolic_values import index_in_range, is_known, scalar_leaves
from soter.certificate.report import NotRecheckedError
from soter.language.evaluate import arithmetic
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.predicates import operands_compared_by
from soter.language.model import typed
from soter.language.model.types import BOOL, ArrayType, BoolType, FloatType, ListType

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.language.model.system import Scope
    from soter.language.model.types import Type


Term = Any


class SolverOperations:
    """The operators over terms of the solver; adds known facts about new terms to `facts`."""

    negation, and_of, or_of = staticmethod(negation), staticmethod(and_of), staticmethod(or_of)

    def __init__(self, facts: list[Term]) -> None:
        self.facts = facts
        self.path: Term = True
        """Under which condition the code being read runs."""
        self.fault: Term = False
        self.doubt: Term = False
        """The term that a function which is not read faults, or compares a NaN."""

    def add_obligation(self, truth: Term) -> None:
        """Notes that the step faults if the code being read runs and `truth` is false."""
        self.fault = or_of(self.fault, and_of(self.path, negation(truth)))

    def add_doubt(self, doubt: Term) -> None:
        """Notes that the step may fault if the code being read runs and `doubt` is true."""
        self.doubt = or_of(self.doubt, and_of(self.path, doubt))

    def choice_of(self, of: Type, c: Term, a: Term, b: Term) -> Term:
        """The term `c ? a : b`."""
        return choose(c, value_as_terms(of, a, self.facts), value_as_terms(of, b, self.facts))

    def negate(self, x: Term) -> Term:
        """The number `-x`."""
        if is_known(x):
            return arithmetic.neg_int(x) if isinstance(x, int) else -x
        if is_float(x):
            return z3.Function("floats negated", OPAQUE, OPAQUE)(as_term(x))
        self.add_obligation(x != SMALLEST)
        return -x

    def compare(self, op: str, a: Term, b: Term) -> Term:
        """The term that `a op b` holds for two scalars."""
        if isinstance(a, Elapsed) and isinstance(b, float):
            return age_comparison(op, a.ns, b)
        if isinstance(a, float) and isinstance(b, Elapsed):
            return age_comparison(op.translate(str.maketrans("<>", "><")), b.ns, a)
        if (is_float(a) or is_float(b)) and not (is_known(a) and is_known(b)):
            return float_operation(op, a, b, z3.BoolSort())
        return COMPARED[op](a, b)

    def arithmetic(self, op: str, a: Term, b: Term) -> Term:
        """`a op b` of scalars for `+ - * / %`; NotRecheckedError for a division by an unknown."""
        if is_known(a) and is_known(b):
            return INTS[op](a, b) if isinstance(a, int) else FLOATS[op](a, b)
        if is_float(a) or is_float(b):
            if op == "/":
                raise NotRecheckedError("a division of floats outside of a function")
            return float_operation(op, a, b, OPAQUE)
        if op in "/%":
            return self._divide(op, a, b)
        value = a + b if op == "+" else a - b if op == "-" else a * b
        self.add_obligation(and_of(value >= SMALLEST, value <= LARGEST))
        return value

    def _divide(self, op: str, a: Term, b: Term) -> Term:
        if not isinstance(b, int) or b == 0:
            raise NotRecheckedError("a division by what is not known")
        size = z3.If(a >= 0, a, -a) / abs(b)
        q = z3.If(a >= 0 if b > 0 else a < 0, size, -size)
        if op == "%":  # of the smallest one by -1 it is 0
            return a - q * b
        if b == -1:
            self.add_obligation(a != SMALLEST)
        return q

    def min_or_max(self, name: str, a: Term, b: Term) -> Term:
        """The `min` or `max` of two scalars; `name` selects which."""
        if is_known(a) and is_known(b):
            return arithmetic.minimum(a, b) if name == "min" else arithmetic.maximum(a, b)
        if is_float(a) or is_float(b):
            return unread_result(f"built in {name}", [a, b], FloatType(), self.facts)
        return z3.If(b < a if name == "min" else b > a, as_term(b), as_term(a))

    def result_of_builtin(self, name: str, x: Term) -> Term:
        """The result of a built-in function of a scalar; NotRecheckedError for `int` of a float."""
        if is_known(x):
            return BUILTINS[name](x)
        if name == "abs" and not is_float(x):
            self.add_obligation(x != SMALLEST)
            return z3.If(x < 0, -x, x)
        if name == "int":
            raise NotRecheckedError(f"`{name}` outside of a function")
        return unread_result(f"built in {name}", [x], FloatType(), self.facts)

    def demand_between(self, x: Term, low: int, high: int) -> Term:
        """The term `x`; the step faults unless `x` lies between `low` and `high`."""
        if is_known(x):
            return arithmetic.require_in_range(x, low, high)
        self.add_obligation(and_of(x >= low, x <= high))
        return x


def is_float(x: Term) -> bool:
    """Whether a scalar is a float."""
    return isinstance(x, (float, Elapsed)) or (z3.is_expr(x) and x.sort() == OPAQUE)


def float_operation(op: str, a: Term, b: Term, sort: Any) -> Term:  # noqa: ANN401 - a sort
    """The result of a machine operation on floats: unknown, but equal for equal operands."""
    return z3.Function(f"floats {op}", OPAQUE, OPAQUE, sort)(as_term(a), as_term(b))


def is_nan(x: Term) -> Term:
    """The term that a float is NaN."""
    if isinstance(x, float):
        return x != x  # noqa: PLR0124 - NaN
    return z3.Function("floats NaN", OPAQUE, z3.BoolSort())(as_term(x))


# ---------------------------------------------------------------- ages


def age_comparison(op: str, ns: Term, limit: float) -> Term:
    """The term `float(ns) / 1e9 op limit`, by the least whole ns that reach, or exceed, `limit`."""
    if limit != limit:  # noqa: PLR0124 - NaN
        return op == "!="
    least = _least_number_where(lambda n: n / 1e9 >= limit)
    beyond = _least_number_where(lambda n: n / 1e9 > limit)
    if op in ("==", "!="):
        equal = and_of(ns >= least, ns < beyond)
        return equal if op == "==" else negation(equal)
    return {"<": ns < least, ">=": ns >= least, "<=": ns < beyond, ">": ns >= beyond}[op]


def _least_number_where(holds: Callable[[int], bool]) -> int:
    """The smallest n from which `holds` is true onward; above any age if it never is."""
    return bisect_left(range(LARGEST), x=True, hi=LARGEST, key=holds)


Published = dict[typed.TopicSymbol, tuple[Term, Term]]


@dataclass
class VisibleValues:
    """The values that a piece of code sees at an instant: topics, ages and the mode."""

    scope: Scope
    topic: Callable[[int], Term]
    age: Callable[[int], Term]
    mode: Term
    module: int
    in_control: Term
    facts: list[Term]
    others: dict[int, Term] = field(default_factory=dict)
    """Modes of other modules, as far as they were read: anything, the same for all of a step."""


class SolverReading(CodeReader):
    """Reads a step, predicate or function body into terms.

    `looked_at`: operands of comparisons that may be NaN, which is a fault in `ttf` and `safer`.
    `deep`: also read long functions if they only pass on their arguments.
    """

    def __init__(
        self,
        sight: VisibleValues,
        *,
        looked_at: frozenset[typed.TypedExpr] = frozenset(),
        deep: bool = False,
    ) -> None:
        self.sight, self.looked_at, self.deep = sight, looked_at, deep
        self.operations = SolverOperations(sight.facts)
        super().__init__(self.operations, sight.scope.params)

    def truth_and_fault(self, e: typed.TypedExpr) -> tuple[Term, Term]:
        """The terms that a predicate holds and that it faults; raises as `value_of` does."""
        _, value = self.run_under(True, lambda: self.evaluate(e))
        return (False if value is None else value), or_of(
            self.operations.fault, self.operations.doubt
        )

    def run_step(
        self, node: typed.NodeSymbol, before: Sequence[Term], taken: Term = False
    ) -> tuple[tuple[Term, ...], Published]:
        """The locals after a step, and for each topic whether it is published and its value.

        `taken`: whether control was just taken over. NotRecheckedError as in `value_of`.
        """
        frame, facts = CallFrame(dict(zip(node.locals, before, strict=True))), self.sight.facts
        self.run_under(True, lambda: self.run_branch(taken, node.takeover or (), (), frame))
        self.run_under(True, lambda: self.run_block(node.step, frame))
        out = {
            t: (says, value_as_terms(t.type, x, facts)) for t, (says, x) in frame.published.items()
        }
        return tuple(value_as_terms(v.type, frame.variables[v], facts) for v in node.locals), out

    # ------------------------------------------------------------ what names mean

    def _mode_value(self, e: typed.ModeRead, _: CallFrame) -> Term:
        sight, index = self.sight, self.sight.scope.modules.get(e.module)
        if index is None:
            raise NotRecheckedError("the mode of an unknown module")
        if index == sight.module:
            return sight.mode
        if index not in sight.others:
            sight.others[index] = unknown_value(e.type, "mode of another", sight.facts)
        return sight.others[index]

    def _choice_value(self, e: typed.TypedChoose, frame: CallFrame) -> Term:
        options = [self.value_of(o, frame) for o in e.options]
        if e.ages is not None:
            raise NotRecheckedError("a fair choice")
        if not options and isinstance(e.type, BoolType):
            return z3.FreshBool("choice")
        number = z3.FreshInt("choice")
        low = 0 if options else e.low
        self.sight.facts.append(z3.And(number >= low, number < low + e.count))
        choice = options[0] if options else number
        for k, option in enumerate(options[1:], 1):
            choice = self.operations.choice_of(e.type, number == k, option, choice)
        return choice

    def operand(self, e: typed.TypedExpr, frame: CallFrame) -> Term:
        """The value of an operand, with the doubt that it is NaN if it is in `looked_at`."""
        value = self.value_of(e, frame)
        if e in self.looked_at and not isinstance(value, Elapsed):
            self.operations.add_doubt(
                or_of(*(is_nan(x) for x in scalar_leaves(value) if is_float(x)))
            )
        return value

    # ------------------------------------------------------------ parts of values

    def _aggregate_value(self, e: typed.Aggregate, frame: CallFrame) -> Term:
        value = super()._aggregate_value(e, frame)
        if part_types(e.type) is None and not is_known(value):
            raise NotRecheckedError("a list or a large array of what is not known")
        return value

    def _length_value(self, e: typed.TypedLength, frame: CallFrame) -> Term:
        value = self.value_of(e.target, frame)
        if isinstance(value, tuple):
            return len(value)
        return element_count(value, e.target.type, self.sight.facts)

    def _element_value(self, e: typed.Index, frame: CallFrame) -> Term:
        sequence, at = self.value_of(e.target, frame), self.value_of(e.index, frame)
        if isinstance(sequence, tuple) and isinstance(at, int):
            return sequence[index_in_range(at, len(sequence))]
        of, facts = e.target.type, self.sight.facts
        assert isinstance(of, (ListType, ArrayType))
        sequence = value_as_terms(of, sequence, facts)
        self.operations.add_obligation(and_of(at >= 0, at < element_count(sequence, of, facts)))
        return element_at(sequence, at, of, facts)

    def replace_part(self, of: Type, whole: Term, keys: Sequence[Term], new: Term) -> Term:
        """The value with the part at these indices replaced; an index out of range is a fault.

        Raises NotRecheckedError for a part of an array that is a single term.
        """
        if keys and part_types(of) is None:
            raise NotRecheckedError("an assignment at an index of what is not told apart")
        if not keys or isinstance(keys[0], int):
            return super().replace_part(of, whole, keys, new)
        at, rest = keys[0], keys[1:]
        self.operations.add_obligation(and_of(at >= 0, at < len(whole)))
        parts = []
        for k, part in enumerate(whole):
            inner, path = part_type(of, k), and_of(self.operations.path, at == k)
            other = self.run_under(path, partial(self.replace_part, inner, part, rest, new))[1]
            parts.append(
                part if other is None else self.operations.choice_of(inner, at == k, other, part)
            )
        return tuple(parts)

    # ------------------------------------------------------------ functions

    def result_of_call(self, fun: typed.FunSymbol, arguments: Sequence[Term]) -> Term:
        """The result of a call; an unread function gives equal results for equal arguments.

        Raises NotRecheckedError if it calls extern functions, whose results may differ.
        """
        if calls_extern(fun):
            raise NotRecheckedError(f"`{fun.name}` is an extern function, or asks one")
        outside, read = self.looked_at, reads_body(fun, deep=self.deep)
        try:
            if fun.prelude:
                self.looked_at = frozenset()
            if read or is_known(tuple(arguments)):
                return super().result_of_call(fun, arguments)
        except StepFault:
            if read:
                raise
        except NotRecheckedError:
            pass  # its body is not understood
        finally:
            self.looked_at = outside
        facts = self.sight.facts
        params = sorted((p.name, repr(v)) for p, v in self.sight.scope.params.items())
        name = f"fun {fun.name} {id(fun)} {params}"
        nan = " or compares a NaN" if self.looked_at & operands_compared_by(fun) else ""
        pairs = zip(fun.parameters, arguments, strict=True)
        values = [value_as_terms(p.type, x, facts) for p, x in pairs]
        self.operations.add_doubt(unread_result(f"{name} faults{nan}", values, BOOL, facts))
        return unread_result(name, values, fun.result, facts)

    readings: ClassVar[dict[type[typed.TypedExpr], Callable[[Any, Any, CallFrame], Term]]] = {
        **CodeReader.readings,
        typed.TopicRead: lambda self, e, _: self.sight.topic(self.sight.scope.topics[e.topic]),
        typed.AgeRead: lambda self, e, _: Elapsed(self.sight.age(self.sight.scope.topics[e.topic])),
        typed.ModeRead: _mode_value,
        typed.InControl: lambda self, *_: self.sight.in_control,
        typed.TimeRead: lambda self, e, _: unknown_value(e.type, "time", self.sight.facts),
        typed.PeriodRead: lambda self, e, _: unknown_value(e.type, "time", self.sight.facts),
        typed.TypedChoose: _choice_value,
        typed.Aggregate: _aggregate_value,
        typed.TypedLength: _length_value,
        typed.Index: _element_value,
    }

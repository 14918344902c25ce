"""The checked tree read over terms of a solver: what a step does, publishes, and when it faults.

Purpose: `SolverReading`: what `reading/symbolic_reading.py` leaves open: topics, ages and modes at
an instant, choices, elements at indices that are not known, and functions that are not read.
Non-goals: time (`transition_system.py`). What neither file knows is not rechecked.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import z3

from soter.certificate.induction.exactness_rules import asks_extern, is_read, parts_of_value
from soter.certificate.induction.solver_operations import SolverOperations, is_float, is_nan
from soter.certificate.induction.solver_values import (
    Elapsed,
    applied,
    both,
    element,
    length,
    one_of,
    shaped,
    unknown,
)
from soter.certificate.reading.symbolic_operations import in_range
from soter.certificate.reading.symbolic_reading import CallFrame, CodeReader, part_of
from soter.certificate.reading.symbolic_values import flat, is_known
from soter.certificate.terms.terms import NotRecheckedError
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.predicates.numbers_in_predicates import operands_in
from soter.language.model import typed
from soter.language.model.types import BOOL, ArrayType, BoolType, ListType

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.language.model.system import Scope
    from soter.language.model.types import Type

Term = Any
Published = dict[typed.TopicSymbol, tuple[Term, Term]]


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


class SolverReading(CodeReader):
    """One step, predicate or function body being read.

    `looked_at`: operands of comparisons that may be NaN, which is a fault in `ttf` and `safer`.
    `deep`: functions that only pass on what they are given are read whatever their length.
    """

    def __init__(
        self,
        sight: VisibleValues,
        *,
        looked_at: frozenset[typed.TypedExpr] = frozenset(),
        deep: bool = False,
    ) -> None:
        self.sight, self.looked_at, self.deep = sight, looked_at, deep
        self.make = SolverOperations(sight.facts)
        super().__init__(self.make, sight.scope.params)

    def truth(self, e: typed.TypedExpr) -> tuple[Term, Term]:
        """The value of a predicate, and whether it faults. NotRecheckedError as `value`."""
        _, value = self.tried(True, lambda: self.expression(e))
        return (False if value is None else value), one_of(self.make.fault, self.make.doubt)

    def step(
        self, node: typed.NodeSymbol, before: Sequence[Term], taken: Term = False
    ) -> tuple[tuple[Term, ...], Published]:
        """Locals behind a step, and of each topic whether it is published, and what.

        `taken`: control was taken over just now. NotRecheckedError as `value`.
        """
        frame, facts = CallFrame(dict(zip(node.locals, before, strict=True))), self.sight.facts
        self.tried(True, lambda: self.branch(taken, node.takeover or (), (), frame))
        self.tried(True, lambda: self.block(node.step, frame))
        said = {t: (says, shaped(t.type, x, facts)) for t, (says, x) in frame.published.items()}
        return tuple(shaped(v.type, frame.variables[v], facts) for v in node.locals), said

    # ------------------------------------------------------------ what names mean

    def _mode(self, e: typed.ModeRead, _: CallFrame) -> Term:
        sight, index = self.sight, self.sight.scope.modules.get(e.module)
        if index is None:
            raise NotRecheckedError("the mode of an unknown module")
        if index == sight.module:
            return sight.mode
        if index not in sight.others:
            sight.others[index] = unknown(e.type, "mode of another", sight.facts)
        return sight.others[index]

    def _chosen(self, e: typed.TypedChoose, frame: CallFrame) -> Term:
        options = [self.value(o, frame) for o in e.options]
        if e.ages is not None:
            raise NotRecheckedError("a fair choice")
        if not options and isinstance(e.type, BoolType):
            return z3.FreshBool("choice")
        number = z3.FreshInt("choice")
        low = 0 if options else e.low
        self.sight.facts.append(z3.And(number >= low, number < low + e.count))
        choice = options[0] if options else number
        for k, option in enumerate(options[1:], 1):
            choice = self.make.join(e.type, number == k, option, choice)
        return choice

    def operand(self, e: typed.TypedExpr, frame: CallFrame) -> Term:
        """Of comparisons one that is no NaN; whether it is hangs on its value alone."""
        value = self.value(e, frame)
        if e in self.looked_at and not isinstance(value, Elapsed):
            self.make.suspect(one_of(*(is_nan(x) for x in flat(value) if is_float(x))))
        return value

    # ------------------------------------------------------------ parts of values

    def _aggregate(self, e: typed.Aggregate, frame: CallFrame) -> Term:
        value = super()._aggregate(e, frame)
        if parts_of_value(e.type) is None and not is_known(value):
            raise NotRecheckedError("a list or a large array of what is not known")
        return value

    def _length(self, e: typed.TypedLength, frame: CallFrame) -> Term:
        value = self.value(e.target, frame)
        if isinstance(value, tuple):
            return len(value)
        return length(value, e.target.type, self.sight.facts)

    def _index(self, e: typed.Index, frame: CallFrame) -> Term:
        sequence, at = self.value(e.target, frame), self.value(e.index, frame)
        if isinstance(sequence, tuple) and isinstance(at, int):
            return sequence[in_range(at, len(sequence))]
        of, facts = e.target.type, self.sight.facts
        assert isinstance(of, (ListType, ArrayType))
        sequence = shaped(of, sequence, facts)
        self.make.oblige(both(at >= 0, at < length(sequence, of, facts)))
        return element(sequence, at, of, facts)

    def replaced(self, of: Type, whole: Term, keys: Sequence[Term], new: Term) -> Term:
        """A value of a type with another part at a path; an index that it has not is a fault.

        NotRecheckedError for an index of what is not told apart.
        """
        if keys and parts_of_value(of) is None:
            raise NotRecheckedError("an assignment at an index of what is not told apart")
        if not keys or isinstance(keys[0], int):
            return super().replaced(of, whole, keys, new)
        at, rest = keys[0], keys[1:]
        self.make.oblige(both(at >= 0, at < len(whole)))
        parts = []
        for k, part in enumerate(whole):
            inner, path = part_of(of, k), both(self.make.path, at == k)
            other = self.tried(path, partial(self.replaced, inner, part, rest, new))[1]
            parts.append(part if other is None else self.make.join(inner, at == k, other, part))
        return tuple(parts)

    # ------------------------------------------------------------ functions

    def called(self, fun: typed.FunSymbol, arguments: Sequence[Term]) -> Term:
        """What a function gives: of one that is not read, the same for the same.

        NotRecheckedError where that is not so: where it asks extern functions.
        """
        if asks_extern(fun):
            raise NotRecheckedError(f"`{fun.name}` is an extern function, or asks one")
        outside, read = self.looked_at, is_read(fun, deep=self.deep)
        try:
            if fun.prelude:
                self.looked_at = frozenset()
            if read or is_known(tuple(arguments)):
                return super().called(fun, arguments)
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
        nan = " or compares a NaN" if self.looked_at & operands_in(fun) else ""
        pairs = zip(fun.parameters, arguments, strict=True)
        values = [shaped(p.type, x, facts) for p, x in pairs]
        self.make.suspect(applied(f"{name} faults{nan}", values, BOOL, facts))
        return applied(name, values, fun.result, facts)

    readings: ClassVar[dict[type[typed.TypedExpr], Callable[[Any, Any, CallFrame], Term]]] = {
        **CodeReader.readings,
        typed.TopicRead: lambda self, e, _: self.sight.topic(self.sight.scope.topics[e.topic]),
        typed.AgeRead: lambda self, e, _: Elapsed(self.sight.age(self.sight.scope.topics[e.topic])),
        typed.ModeRead: _mode,
        typed.InControl: lambda self, *_: self.sight.in_control,
        typed.TimeRead: lambda self, e, _: unknown(e.type, "time", self.sight.facts),
        typed.PeriodRead: lambda self, e, _: unknown(e.type, "time", self.sight.facts),
        typed.TypedChoose: _chosen,
        typed.Aggregate: _aggregate,
        typed.TypedLength: _length,
        typed.Index: _index,
    }

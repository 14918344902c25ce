"""Expressions that have a value before any step is made: constants, and what is calculated of them.

Purpose: `folded`: the value of an expression that reads nothing but constants, parameters and
variables whose values are known. It is the language's own evaluator that calculates, with the
machine's operations, so that `age(t) > 0.1 - 0.07` is compared as a program compares it.
Non-goals: what is not known (`solver_reading.py`); steps that fault: those are read there as ever.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import z3

from soter.certificate.induction.solver_values import Seconds
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import BudgetExceeded, Environment
from soter.language.evaluate.predicates.numbers_in_predicates import all_operands
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed
from soter.language.model.tree_walk import nodes as parts_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.types import Value

Term = Any
BUDGET = 100_000
"""Operations of one expression."""
_CALCULATED = (
    typed.TypedUnary, typed.TypedBinary, typed.Conditional, typed.Builtin, typed.TypedCall,
    typed.TypedField, typed.Index, typed.TypedLength, typed.Narrow, typed.Vector,
)  # fmt: skip
_CLOSED = (*_CALCULATED, typed.Literal, typed.ParamRead, typed.VarRead, typed.Aggregate)


def known_value(term: Term) -> Value | None:
    """The value of the program that a term is; None where it is not one value."""
    if isinstance(term, Seconds):
        return term.value
    if isinstance(term, tuple):
        values = [known_value(x) for x in term]
        return None if any(v is None for v in values) else tuple(values)
    if z3.is_int_value(term):
        return int(term.as_long())
    if z3.is_true(term) or z3.is_false(term):
        return bool(z3.is_true(term))
    return None


def folded(
    e: typed.TypedExpr,
    env: Mapping[typed.Variable, Term],
    params: Mapping[typed.ParamSymbol, Value],
    looked_at: frozenset[typed.TypedExpr],
) -> Value | None:
    """The value of an expression that is calculated of known ones; None where it is not, or faults.

    `looked_at`: what may not be NaN where it is compared. Where such a thing is in it, it is read.
    """
    if not isinstance(e, _CALCULATED):
        return None
    values = {}
    for n in parts_of([e]):
        if not isinstance(n, _CLOSED):
            return None
        if isinstance(n, typed.VarRead) and n.variable not in values:
            value = known_value(env[n.variable])
            if value is None:
                return None
            values[n.variable] = value
    if looked_at and looked_at & all_operands(e):
        return None
    try:
        return Evaluator(params, None, BUDGET).value(e, Environment(values))
    except (StepFault, BudgetExceeded):
        return None

"""Names the quotient or root in a plant that has no finite range over the grid.

Purpose: where the dynamics have no finite enclosure, `term_without_bound` finds that term by the
ranges of the states on their axes.
Non-goals: the enclosure itself (`verify/enclose/`), which may be finite where these ranges are not,
or the other way round; terms inside functions of the program or the prelude.
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any, ClassVar

from soter.language.evaluate.range_evaluation import RangeEvaluator, TooHardError
from soter.language.evaluate.ranges import Range
from soter.language.evaluate.topic_ranges import reader_of_sets
from soter.language.model import typed as t
from soter.language.model.tree_walk import nodes

if TYPE_CHECKING:
    from soter.language.model.system import Component
    from soter.verify.problem.problem import Problem


class _Ranges(RangeEvaluator):
    """Evaluates ranges; a sine or cosine, a polynomial in the prelude, has the range [-1, 1]."""

    EXPRESSIONS: ClassVar[dict[type, Any]] = {
        **RangeEvaluator.EXPRESSIONS,
        t.TypedCall: lambda self, e: (
            Range(-1.0, 1.0) if e.fun.name in {"sin", "cos"} else self._call(e)
        ),
    }


def term_without_bound(problem: Problem) -> tuple[str, str] | None:
    """The term, and its divisor or the argument of its root, in words; None if none is found."""
    for c in (c for c in problem.system.components if c.plant is not None):
        try:
            if found := _unbounded_term_of_plant(problem, c):
                return found
        except TooHardError:
            continue
    return None


def _unbounded_term_of_plant(problem: Problem, c: Component) -> tuple[str, str] | None:
    evaluator, plant = _Ranges(c.scope, c.period_ns, reader_of_sets(problem.system)), c.plant
    assert plant is not None
    names = {v.name: v for v in (*plant.states, *(d.variable for d in plant.disturbances))}
    q = problem.quantities
    known = zip((*q.states, *q.disturbances), (*problem.states, *problem.disturbances), strict=True)
    for leaf, ends in known:
        if leaf.owner == c.index and not leaf.path and leaf.member in names:
            evaluator.variables[names[leaf.member]] = Range(ends.low, ends.high)
    lets = dict(plant.lets)
    for variable, e in (*lets.items(), *plant.der.items(), *plant.next.items()):
        for part in reversed(list(nodes([e]))):  # inner terms before outer ones
            of = _part_required_positive(part)
            if of is None or not isinstance(part, t.TypedExpr):
                continue
            r = evaluator.bounds(of)
            if not (isfinite(r.low) and isfinite(r.high)) or (r.low <= 0.0 <= r.high):
                where = f"`{of.span.text}`, which by ranges may be anything in [{r.low:.4g}, "
                return f"`{part.span.text}`", f"{where}{r.high:.4g}]"
        if variable in lets:
            evaluator.variables[variable] = evaluator.evaluate(e)
    return None


def _part_required_positive(part: object) -> t.TypedExpr | None:
    """The divisor of a division or the argument of a square root; None for any other term."""
    if isinstance(part, (t.TypedBinary, t.Vector)) and part.op == "/":
        return part.right
    return part.arguments[0] if isinstance(part, t.Builtin) and part.name == "sqrt" else None

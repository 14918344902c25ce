"""One question to the solver, whose answer hangs on nothing but the question.

Purpose: several ways of searching, each up to so much work, each in a context of its own.
Non-goals: terms (`solver_terms.py`), which questions prove a module (`prove_or_refute.py`).
"""

from __future__ import annotations

from typing import Any

from soter.workers.solvers import answer_of

Term = Any
"""A term of the solver, or a bool of Python where it is known."""
QUERY_WORK = 50_000_000
"""Of each way of searching, in the solver's own units: five seconds or so of a free core."""
QUERY_MS = 120_000
"""Some loops of the solver do not count their work."""


class Query:
    """Constraints, and whether they can be met: asked in contexts of the solver's own.

    How the solver searches hangs on how its context numbers terms, so one that has served other
    questions may answer otherwise; and one way of searching may take a thousand times as long as
    another (seen: 1.4 million units of work, and more than 470 million). So each way is tried by
    itself, up to so much work, however long that takes: neither a busy machine nor what a process
    did before changes a verdict.
    """

    def __init__(self, z3: Term) -> None:
        self._z3 = z3
        self._constraints = z3.SimpleSolver()
        self._asked: Term = None

    def add(self, *truths: Term) -> None:
        """More constraints."""
        self._constraints.add(*[self._z3.BoolVal(t) if isinstance(t, bool) else t for t in truths])

    def check(self) -> Term:
        """sat, unsat or unknown."""
        answer = self._z3.unknown
        for way in (self._with_equations_solved, self._as_it_is, self._with_simplex):
            self._asked = way(self._z3.Context())
            self._asked.set("rlimit", QUERY_WORK)
            self._asked.set("timeout", QUERY_MS)
            self._asked.set("random_seed", 0)
            self._asked.add(self._constraints.translate(self._asked.ctx).assertions())
            answer = answer_of(self._asked)
            if answer != self._z3.unknown:
                break
        return answer

    def _with_equations_solved(self, context: Term) -> Term:
        tactics = ("simplify", "propagate-values", "solve-eqs", "smt")
        return self._z3.Then(*[self._z3.Tactic(t, context) for t in tactics]).solver()

    def _as_it_is(self, context: Term) -> Term:
        return self._z3.SimpleSolver(ctx=context)

    def _with_simplex(self, context: Term) -> Term:
        solver = self._z3.SimpleSolver(ctx=context)
        solver.set("arith.solver", 2)
        return solver

    def model(self) -> Term:
        """Values that meet the constraints, after `sat`."""
        return self._asked.model().translate(self._z3.main_ctx())

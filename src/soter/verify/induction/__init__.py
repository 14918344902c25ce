"""Proves modules whose `safe` is about topics of nodes, by k-induction over every schedule.

- `problem.py` makes the problem from the program, and refuses modules that induction is not for.
- `verify.py` gives the verdicts; `prove_or_refute.py` does the induction, or finds a run.
- `transition_relation.py` makes terms for z3 of a span of time, with its steps in every order that
  `calendar.py` allows; `step_terms.py` makes those of one step, `solver_terms.py` of values.
- `handover.py` shows that a view's state jumps only where `enters` holds.
"""

"""Modules whose `safe` speaks of what nodes publish: k-induction over every schedule.

- `problem.py` reads off the program what has to be proved, and refuses what does not fit.
- `verify.py` gives the verdicts; `prove_or_refute.py` does the induction, or finds a run.
- `transition_relation.py` is all that may happen in a span of time, in every order that
  `calendar.py` allows; `step_terms.py` is one step, and `solver_terms.py` its values, for z3.
- `handover.py` shows that a view's state jumps only where `enters` holds.
"""

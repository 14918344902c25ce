"""Modules proved by induction: the program is encoded for a solver once more, by other code.

- `check_claims.py` has z3 show each claim; `handover_jumps.py` those of a hand-over.
- `induction_problem.py` reads the problem, and runs instants as terms of the solver.
- `solver_steps.py` reads steps and predicates as terms; `solver_values.py` has their values.
"""

"""Safety cases: goals, and the evidence that supports them, which is checked as a case is made.

- `safety_case.py` makes the goals of a case, and has their evidence checked.
- `certificate_check.py` has its certificate checked again; `evidence.py` repeats tests and flights.
- `hazard_traceability.py` traces hazards and requirements to properties; `condition_tracing.py`
  goes on to the conditions of the generated C.
- `predicate_inlining.py` writes predicates out for readers who do not read the program.
"""

"""Evaluates expressions and statements: to values, over ranges, and with slopes.

- `expressions.py` and `statements.py` give code its meaning, as Python closures.
- `environment.py` is what code reads; `arithmetic.py` has the operations, bit for bit those of C.
- `predicates.py` evaluates `ttf` and `safer`, in which a comparison with a NaN is a fault.
- `ranges.py` has the operations on ranges, with which `range_evaluation.py` evaluates code;
  `topic_ranges.py` gives the ranges that topics declare.
- `integration_stability.py` bounds slopes, and finds schemes that diverge where the plant does not.
"""

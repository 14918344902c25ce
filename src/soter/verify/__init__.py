"""P2a, P2b, P3: problem, sets, fixpoints, verdicts, certificates (docs/verification.md).

`problem/` reads what is to be shown off a flat system, `time/` derives every time of it; `enclose/`
reads Core over first-order forms with intervals; `grid/` (before `engine/`, C) and `polytope/` are
the methods for groups of plants, `proof_methods.py` their table; `induction/` and `tubes/` prove
whole modules, `module_methods.py` is theirs; `claims/` makes verdicts of groups and their product;
`tables/` and `deploy/` make and check the DM that flies; `attack/` looks for runs that refute,
`diagnosis/` says why nothing was proved, `find_sc.py` looks for a safe controller.
"""

"""P2a, P2b, P3: problem, sets, fixpoints, verdicts, certificates (docs/verification.md).

`problem/` reads what is to be shown off a flat system, `time/` derives every time of it; `enclose/`
reads Core over first-order forms with intervals; `grid/` (before `engine/`, C) and `polytope/` show
groups of states (`proof_methods.py`), `induction/`, `tubes/` whole modules (`module_methods.py`);
`claims/` makes verdicts of groups and their product; `tables/` and `deploy/` make and check the DM
that flies; `attack/` finds runs that refute, `diagnosis/` why nothing is proved, `find_sc.py` SCs.
"""

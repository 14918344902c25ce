"""The prover: shows P2a, P2b and P3 of modules, and writes certificates (docs/verification.md).

`problem/` reads what is to be shown, and its times, off a flat system; `enclose/` reads Core over
first-order forms with intervals; `grid/` (before `engine/`, C) and `polytope/` show groups of
states (`proof_methods.py`), `induction/`, `tubes/` whole modules (`verify_module.py`); `claims/`
makes verdicts of groups and their product; `deploy/` makes and checks the DM that flies;
`refute.py` finds runs that refute, `diagnosis/` why nothing is proved, `find_sc.py` SCs.
"""

"""The prover: shows P2a, P2b and P3 of modules, and writes certificates (docs/verification.md).

`problem/` reads what is to be shown, and its times, off a flat system; `enclose/` writes and runs C
that encloses Core; `grid/` (with `engine/`, in C) and `polytope/` prove groups of states (table:
`proof_methods.py`), `induction/` and `tubes/` whole modules (table: `verify_module.py`); `claims/`
makes verdicts from the proofs of groups; `deploy/` makes and checks the DM that flies; `refute.py`
finds runs that refute, `diagnosis/` why nothing is proved, `find_sc.py` SCs.
"""

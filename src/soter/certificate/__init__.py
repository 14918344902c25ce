"""The independent checker of certificates; it imports nothing that proves or compiles.

It stands on the front end (`language/`, `diagnostics/`). `report/` words its texts, and reads logs
of flights; `workers/` ends processes, and lets Ctrl-C reach z3. The prover uses these rooms, too.

In reading order:
- `rechecker.py` asks claim by claim; `reading/` reads the folder, and the problem and its times off
  the program in it; `terms/` has its expressions over Arb.
- `case_check.py` asks the claims of one combination of parameter values, group by group;
  `proof_methods.py` says what claims rest on, and has the methods of whole modules.
- `cell_sets.py`, `cell_predicates.py`: sets of cells, and on which of them a predicate holds.
- `grid/`, `induction/`, `tubes/`: the methods by which claims are shown.
- `extras/`: what most certificates have not; the files above and `grid/` ask for it through its
  `__init__` alone.
- `scope.py`: what a verdict is about and rests on; `vacuous_proofs.py`: whether it says anything;
  `report.py`: the verdicts and errors.
What is not understood is not confirmed. docs/recheck.md says what each certificate goes through.

Sets, as docs/proof-sets.md has them. C: where `safe` holds. K, in C: SC keeps it. R(H): no command
leads out of K within H. S_0: estimates of states in R(H) only; S_k: of states in G_k only, whose
estimates stay in S_(k-1), whatever is commanded until the DM looks again. Q, in K: SC keeps it, and
`safer` holds there; W_0 = Q, W_1, ...: SC leads to the one before. E: errors of estimates.
"""

"""The independent checker of certificates; imports `language/` and below, nothing of `verify/`.

`folder.py` is the folder; `reading/` reads the problem and its times off the program; `terms/`:
expressions over Arb balls, `cell_predicates.py`: predicates on sets of cells. `rechecker.py` asks
claim by claim; `grid/`, `polytope/`, `induction/` and `tubes/` are the methods by which they are
shown, `proof_methods.py` their table. What is not understood is not confirmed. docs/recheck.md says
which files every certificate of grids goes through, and which belong to an extra.

Sets, as docs/proof-sets.md has them. C: where `safe` holds. K, in C: SC keeps it. R(H): no command
leads out of K within H. S_0: estimates of states in R(H) only; S_k: of states in G_k only, whose
estimates stay in S_(k-1), whatever is commanded until the DM looks again. Q, in K: SC keeps it, and
`safer` holds there; W_0 = Q, W_1, ...: SC leads to the one before. E: errors of estimates.
"""

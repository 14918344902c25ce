"""The independent checker of certificates; imports `language/` and below, nothing of `verify/`.

`folder.py` reads the folder; `reading/` reads the problem and its times off the program; `terms/`
has expressions over Arb balls, `cell_predicates.py` predicates on sets of cells. `rechecker.py`
asks claim by claim; `grid/`, `polytope/`, `induction/` and `tubes/` are the methods by which claims
are shown, `proof_methods.py` is their table. What is not understood is not confirmed.
docs/recheck.md says which files each certificate of grids goes through, and which are of an extra.

Sets, as docs/proof-sets.md has them. C: where `safe` holds. K, in C: SC keeps it. R(H): no command
leads out of K within H. S_0: estimates of states in R(H) only; S_k: of states in G_k only, whose
estimates stay in S_(k-1), whatever is commanded until the DM looks again. Q, in K: SC keeps it, and
`safer` holds there; W_0 = Q, W_1, ...: SC leads to the one before. E: errors of estimates.
"""

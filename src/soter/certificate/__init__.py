"""The independent checker of certificates; imports `language/` and below, nothing of `verify/`.

`format/` is the folder; `reading/` reads the problem off the program, `time/` derives its times;
`terms/`: expressions over Arb balls, `cells/`: predicates on sets of cells. `rechecker.py` asks
claim by claim; `grid/`, `polytope/`, `induction/` and `tubes/` are the methods by which they are
shown, `proof_methods.py` their table. What is not understood is not confirmed. docs/recheck.md says
which files every certificate of grids goes through, and which belong to an extra.
"""

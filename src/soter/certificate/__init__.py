"""The independent checker of certificates; imports `language/` and below, nothing of `verify/`.

`format/` is the folder; `reading/` reads the problem off the program, `time/` derives its times;
`terms/`: expressions over Arb balls; `inclusions/` (grids), `polytope/` and `induction/` check what
a certificate claims, `rechecker.py` claim by claim; what is not understood is not confirmed.
`batches/`: arrays of balls in doubles, with which many boxes are looked at before Arb is asked.
"""

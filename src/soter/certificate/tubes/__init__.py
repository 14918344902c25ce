"""Modules with `rest`, whose decision module follows SC from each estimate: tubes in Arb.

- `check_rest.py` checks each claim of a certificate; `rest_problem.py` reads the problem.
- `sc_answers.py` and `rest_claims.py` show what has to hold before anything flies.
- `tube_chains.py` carries sets of states step by step; `collecting_tube.py` lets runs go on
  together beyond a kink of SC.
"""

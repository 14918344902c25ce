"""Explains why a proof failed or says little, by runs of the model, tried changes and figures.

- `open_claims.py` shows by a run why a claim is not proved; `model_runs.py` finds such runs.
- `habits_of_sc.py` looks for faults of an SC that keeps nothing; `changed_runs.py` for one change
  with which a run stays in C; `unbounded_terms.py` for a rate without bounds.
- `tried_remedies.py` proves again with changes, those in the table of `variations.py`.
- `vacuity.py` tells how little a proof says where AC can hardly ever have control.
"""

"""Hints of a proof that are found: grids and `rest` of modules whose program does not say them.

Purpose: `model_states.py` simulates the plants under SC; `grid_hints.py` and `rest_hints.py` make
hints of that, in the round numbers of `written_numbers.py`; `hint_text.py` writes them into the
program, `proof_search.py` proves one after the other within a budget, `searched_program.py` does it
for the modules of a program.
Non-goals: proofs: what is found is proved as if a person had written it.
"""

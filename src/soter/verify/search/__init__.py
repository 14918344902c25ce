"""The search for hints of a proof: grids and clauses `rest` that a program does not declare.

Purpose: `model_states.py` simulates the plants under SC. From these runs `grid_hints.py` and
`rest_hints.py` make hints, in the round numbers of `written_numbers.py`. `hint_text.py` writes them
into the program. `proof_search.py` tries to prove the module with one after the other, within a
budget, and `searched_program.py` does so for the modules of a program.
Non-goals: proofs, which are those of hints that a person wrote.
"""

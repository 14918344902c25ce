"""Warnings about systems that are well-formed, but hardly do what their author meant.

- `module_lints.py` calls the other files, and warns of parts that look exchanged, and of topics
  that grow too old.
- `step_lints.py`: what a single step does wrong or leaves out, whatever it reads.
- `contradictory_predicates.py`: `ttf`, `safer` and `safe` that contradict each other.
- `refuted_at_once.py`: what a proof or a run would refute at once.
- `rest_lints.py`: clauses `rest`, `moves` and `within` that a run of SC contradicts.
"""

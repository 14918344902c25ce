"""The records of a checked program and of a flat system, walks over them, types and values.

- `types.py` and `values.py`: types, values in Python, and their conversions.
- `typed.py`: the checked program; `tree_walk.py` walks over its trees, and counts what steps cost.
- `system.py`: the flat system; `read_together.py`, how far apart what a DM reads together may be.
- `canonical_text.py` writes a record as a text that does not depend on places in files.
- `proof_verdicts.py`: what was proved; `assumption_words.py`: assumptions in words.
"""

"""Runs the C search in a thread, and puts its numbers into the program's words.

- `search.py` runs one search with the program's names; `explorer_library.py` calls the C in `c/`.
- `reductions.py` explores independent parts alone, and chooses between two reductions.
- `coverage.py` counts what a search has reached, and names what it has not.
- `shrink.py` makes a violating execution smaller.
"""

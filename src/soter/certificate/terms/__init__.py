"""What code computes, over Arb balls: terms, compiled over a set, run as straight-line programs.

- `linear_enclosures.py` has balls, and lines that enclose single functions.
- `straight_line.py` writes a program of such operations once, and runs it on every cell.
- `terms.py` has what code computes, as linear forms over atoms; `compile_terms.py` makes programs
  of these that hold over a whole set.
"""

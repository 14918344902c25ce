"""What is proved of a module, group by group and of their product.

- `claims.py` asks the claims of a case, group by group; `case.py` is the case.
- `start.py` is the claim about the start: where SC gets control, and what it does on defaults.
- `product_sets.py` checks what is claimed of all groups together.
- `choice.py` chooses cells and levels that a program leaves open; `grid_refinement.py` makes finer
  and coarser cells.
- `results.py`: the verdicts, and the sets behind them, as plain data.
"""

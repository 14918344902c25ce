"""What is proved of a module, group by group and of their product.

- `claims.py` asks the claims of a case (`grid/case.py`), group by group.
- `start.py` is the claim about the start: where SC gets control, and what it does on defaults.
- `product_sets.py` checks what is claimed of all groups together.
- `choose_cells_and_levels.py` chooses cells and levels that a program leaves open.
- `results.py`: the verdicts, and the sets behind them, as plain data.
"""

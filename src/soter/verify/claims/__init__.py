"""The claims about a module: about each group of states, or about their product.

- `claims.py` examines the claims of a case (`grid/case.py`), group by group.
- `start.py` has the claim about the start: the initial states, and steps of SC on defaults.
- `product_sets.py` checks claims about all groups together.
- `choose_cells_and_levels.py` chooses cells and levels that a program leaves open.
- `results.py`: the verdicts, and the sets behind them, as plain data.
"""

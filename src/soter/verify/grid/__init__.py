"""Sets of states on grids, computed by the C engine, and the claims proved with them.

- `case.py` is a case: the proofs of all groups under one combination of parameter values.
- `claims.py` shows the claims about one group, and writes its sets into certificates.
- `sets.py` computes C, K and R(H) by the engine; its head has the symbols of this folder.
- `grid_problem.py` has the ranges and times that it starts from, `group_model.py` the group as the
  engine sees it; `grid_refinement.py` makes finer and coarser cells.
- `estimate_sets.py` computes levels of estimates; `recovery.py` the way back to AC (P2b),
  on smaller cells `finer_cells.py`; `resting.py` cells from which SC only comes to rest.
- `scheme_error.py` bounds by how much the simulator's integration differs from the flow.
- `set_figures.py` draws regions of the sets.
"""

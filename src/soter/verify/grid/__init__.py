"""Sets of states on grids, computed by the C engine, and the claims proved with them."""

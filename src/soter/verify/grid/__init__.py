"""Sets on grids, in front of the engine."""

"""Child processes for controllers that are somebody else's code, and for solvers."""

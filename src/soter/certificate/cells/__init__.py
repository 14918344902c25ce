"""Sets of cells of a grid, and predicates on them: what the methods of proof have in common."""

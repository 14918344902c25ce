"""Groups proved by sets of cells of a grid: each claim is an inclusion, shown cell by cell."""

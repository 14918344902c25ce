"""The model of a system that the explorer runs: actors, parts, and the C of configurations."""

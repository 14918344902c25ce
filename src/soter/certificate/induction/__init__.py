"""Modules proved by induction: the program is encoded for a solver once more, by other code."""

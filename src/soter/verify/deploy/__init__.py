"""Computed predicates, and the DM that flies."""

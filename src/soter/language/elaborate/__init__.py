"""Flattens a system of the checked program, checks what belongs together, and warns."""

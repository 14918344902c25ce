"""Execution times of steps, measured on this machine."""

SAMPLES = 20_000
"""Steps of each component that are timed."""
MARGIN = 2.0
"""A suggested `wcet` is the longest time measured, multiplied by this."""

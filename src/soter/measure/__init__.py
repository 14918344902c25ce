"""Execution times of steps, measured on this machine."""

SAMPLES = 20_000
"""Steps of each component that are timed."""
MARGIN = 2.0
"""What the longest is multiplied with, for a `wcet` to begin with."""

"""Execution times of steps, measured on this machine.

`stopwatch.py` times single steps of the trusted thread by the C in `c/`, on states of a run and on
varied ones, and suggests a `wcet` from that.
"""

SAMPLES = 20_000
"""Steps of each component that are timed."""
MARGIN = 2.0
"""A suggested `wcet` is the longest time measured, multiplied by this."""

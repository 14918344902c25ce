"""Execution times of steps, measured on this machine."""

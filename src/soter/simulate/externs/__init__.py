"""Loads and calls externs, the parts of a system that are somebody else's code."""

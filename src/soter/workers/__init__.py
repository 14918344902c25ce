"""Processes of controllers that are somebody else's code."""

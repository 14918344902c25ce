"""Runs that violate what was not proved."""

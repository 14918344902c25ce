"""Systematic testing: every execution of a test, its verdict, and traces that can be replayed."""

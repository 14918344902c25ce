"""Expressions, calls, fields and choices."""

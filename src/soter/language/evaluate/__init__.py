"""Expressions and statements in Python, for constants and for the interpreter."""

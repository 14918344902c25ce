"""Evaluates expressions and statements: to values, over ranges, and with slopes."""

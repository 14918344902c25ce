"""Soter source that comes with the language, and what is known about its errors.

Purpose: package data (`*.soter`, read by `language/load/loader.py`) and `function_error_bounds.py`.
Non-goals: anything that runs; the functions are Soter, not Python.
"""

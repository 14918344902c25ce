"""Generates, compiles and calls C that encloses the step functions and flows of a module."""

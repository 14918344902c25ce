"""Checks the syntax trees of a program: names, types, constants, and every declaration."""

"""Checks nodes, modules, plants, systems, `verify` and `test` blocks."""

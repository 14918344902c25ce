"""Nodes, modules, plants, systems, `verify` and `test` blocks."""

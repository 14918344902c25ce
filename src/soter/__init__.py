"""Soter: a runtime-assurance framework for robots."""

__version__ = "0.1.0"

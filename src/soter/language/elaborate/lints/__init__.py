"""Warnings about modules that are well-formed and yet hardly what was meant."""

"""Traces as data, as choices and as files."""

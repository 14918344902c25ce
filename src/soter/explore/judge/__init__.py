"""Traces in the reference interpreter, without any C."""

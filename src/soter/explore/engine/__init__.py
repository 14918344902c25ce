"""Runs the C search in a thread, and puts its numbers into the program's words."""

"""Reads the files of a program: sources, imports, data."""

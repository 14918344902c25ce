"""Reads the problem off the checked program, and refuses what the re-checker cannot read so."""

"""Searches on a disk: written while they go on, and gone on with later."""

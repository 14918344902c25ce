"""Certificates of sets on grids: inclusions, cell by cell."""

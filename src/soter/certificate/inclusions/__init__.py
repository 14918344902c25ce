"""The inclusions that a certificate claims, of grids."""

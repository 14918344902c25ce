"""From the checked program to a flat system."""

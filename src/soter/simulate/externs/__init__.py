"""Controllers that are somebody else's code."""

"""Binds externs, the parts of a system that are somebody else's code, and calls them."""

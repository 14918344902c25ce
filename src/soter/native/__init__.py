"""Find a compiler, build, cache by content, load."""

"""Many seeded runs of a system, and what they say about it."""

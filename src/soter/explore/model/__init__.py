"""What the explorer is told of a system: actors, parts, and the C of its configurations."""

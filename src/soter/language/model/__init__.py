"""The records of a checked program and of a flat system, walks over them, types and values."""

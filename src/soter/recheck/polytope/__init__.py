"""The same of polytopes."""

"""Linear groups as polytopes."""

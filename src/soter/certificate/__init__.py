"""The independent checker of certificates; imports `program/` and below, nothing of `reach/`."""

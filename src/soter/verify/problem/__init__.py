"""From a flat system to the verification problem of a module."""

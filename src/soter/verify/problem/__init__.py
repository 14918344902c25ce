"""Makes the verification problem of a module from a flat system."""

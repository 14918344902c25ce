"""The re-checker's own derivation of every time."""

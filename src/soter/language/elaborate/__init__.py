"""Makes flat systems of a checked program: each pass, check or warning is a file."""

"""Whether what a robot did is what its proof assumes."""

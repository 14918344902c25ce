"""What code computes, over Arb balls: terms, compiled over a set, run as straight-line programs."""

"""Many boxes at once, in doubles: what this does not show is left to Arb."""

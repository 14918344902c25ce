"""Computed predicates, the check of the DM that flies, and proofs of deployed systems."""

"""Certificates of proofs by induction, checked by an encoding of its own."""

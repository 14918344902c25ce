"""Checked program -> Core; footprints, storage."""

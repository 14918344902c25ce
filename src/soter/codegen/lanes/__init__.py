"""Straight code over several worlds at once, a world a lane: C of campaigns, never what ships."""

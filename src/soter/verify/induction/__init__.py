"""Modules whose `safe` speaks of what nodes publish: k-induction over every schedule."""

"""Campaigns: many seeded runs of a system, and the statistics of them."""

"""The picture of a system: what runs, what it reads and publishes, and who stands in for whom."""

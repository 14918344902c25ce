"""The model of time, and the ways through the flying system."""

"""The sequence view of a trace."""

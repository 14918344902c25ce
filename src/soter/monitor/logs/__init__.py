"""Logs that nobody's `soter run` wrote: what the decision modules would have said to them."""

"""Verdicts of decision modules that follow SC, out of the log of a flight, each checked again."""

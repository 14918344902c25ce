"""What `Program.build` does.

In reading order:

- `inheritance.py` says which proof a deployed system inherits.
- `host_replay.py` makes the run that an image repeats.
- `building.py` builds packages, and images of those that are for a board.
"""

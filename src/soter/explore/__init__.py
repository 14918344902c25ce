"""Systematic testing: every execution of a test, its verdict, and traces that can be replayed.

A configuration is a state and the schedule: time, releases made by each actor, deadlines. `model/`
generates, from the plan of its actors, how one is packed into few bits and which of them each actor
reads and writes; `engine/` searches (C in `engine/c/`, a file for each strategy); `trace.py` is
what a search finds, as data and files; `replay.py` runs it again in the interpreter, before
`judge.py`; `vacuous_tests.py` says whether a test can fail at all. `search_options.py` is the table
of strategies.
"""

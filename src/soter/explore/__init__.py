"""Systematic testing: every execution of a test, its verdict, and traces that can be replayed.

In reading order:
- `command.py` takes a test from its flat system to its result; `search_options.py` has the options
  and the table of strategies.
- `model/` generates, from the plan of the actors of a system, how a configuration is packed into
  few bits and which of them each actor reads and writes; `engine/` searches.
- `trace.py` is what a search finds, as data and files; `replay.py` runs it again in the
  interpreter, before `judge.py`; `trace_view.py` puts it into words, `trace_page.py` on a page.
- `results.py` has the verdicts; `assumptions.py` says what they take for granted.
- `vacuous_tests.py` says whether a test can fail at all, `constant_truth.py` whether a condition
  can have both truth values.

A configuration is a state and the schedule: time, releases made by each actor, deadlines.
"""

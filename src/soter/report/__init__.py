"""Writes what people read after a command: HTML pages, logs, tables.

Purpose: takes plain records (such as `run/record.py`), and writes files and text: `write_html` of
`html.py`, `write_mcap` of `mcap_log.py`, `table` of `tables.py`.
Non-goals: running anything, reading programs, deciding what is safe: the caller fills the records
from its results.
"""

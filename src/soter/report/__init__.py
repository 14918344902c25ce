"""Writes what people read after a command: HTML pages, logs, tables.

Purpose: plain records in (`run/record.py`), files and text out: `write_html` of `html.py`,
`write_mcap` of `mcap_log.py`, `table` of `tables.py`.
Non-goals: running anything, reading programs, deciding what is safe. Nothing here knows the
language or the engines; the caller fills the records from a run.
"""

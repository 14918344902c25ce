"""What a run leaves behind for people: logs, a report in one HTML file, a summary.

Purpose: plain records in (`record`), files and text out: `html.write_html`,
`mcap_log.write_mcap`, `summary.table`.
Non-goals: running anything, reading programs, deciding what is safe. Nothing here knows the
language or the engines; the caller fills the records from a run.
"""

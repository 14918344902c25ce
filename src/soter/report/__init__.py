"""Writes what people read after a command: HTML pages, logs, tables.

Purpose: takes plain records (such as `run/record.py`), and writes files and text: `write_html` of
`html.py`, `write_mcap` of `mcap_log.py`, `table` of `tables.py`.
Non-goals: running anything, reading programs, deciding what is safe: the caller fills the records
from its results. In reading order:

- `wording.py` words numbers, parameters and texts from outside; `tables.py` writes tables for
  terminals and notebooks.
- `templates.py` fills in the templates, which stand beside the code; `parts.html.j2` is shared.
- `html.py` puts style and scripts (`assets/`) into a page; `atomic_write.py` writes files whole.
- `run/` makes the report of a run: `record.py` is what a caller fills, `page.py` the page;
  `counterexample_page.py` fills it for a run that violates, `signals.py` for both.
- `proof_page.py` writes the proof report, and the page of `soter advise`.
- `safety_case.py` holds a safety case as data; `safety_case_page.py` makes its page.
- `sequence_view.py` holds a replayed trace as data and as a table, `trace_log.py` writes its log.
- `mcap_log.py` writes a run as an MCAP log. `judged_curves.py` draws what a judgement compared.
- Two files read, so that the format stands in one room: `mcap_reading.py` reads MCAP files, for
  logs that are read back (`simulate/`), for flights that are checked (`certificate/`), and for logs
  of other systems (`monitor/log_files/`). `bounded_unpack.py` unpacks compressed chunks for it, and
  for the readers of bags there.
"""

"""Runs of systems, in virtual time on either engine or in real time, and their results.

In reading order:

- `run_options.py` has the options of a run, and reads parameters that a user sets.
- `externs/` loads and calls the code of each extern: Python, C, or a separate process.
- `run.py` runs a system in virtual time, natively or in the interpreter.
- `real_time.py` compiles the package of target `posix` and runs it; `flight_recording.py` reads
  its recording.
- `interrupt.py` stops a run at the end of an instant after a user's Ctrl-C.

During a run:
- `run_observer.py` gets every state: it hashes and keeps states, and notes changes of mode.
- `module_safe_check.py` checks whether a module's own `safe` holds at the end of an instant.

After a run:
- `result.py`: a `Run` gives topics, true states, modes and violations by their names.
- `decisions.py` lists *what* each DM saw and did, step by step; `tube_looks.py` computes the tube
  through which SC would have led.
- `explain_decision.py` finds *why* a DM decided so: which part of a predicate, on which values;
  `stale_reads.py` finds the topics that were too old, and why.
- `result_assumptions.py` lists the assumptions of a result in words.
- `run_log.py` writes a run as an MCAP log, and reads such a log back.
- `run_fields.py` makes its plain data for `--json`, `run_report.py` its page with time lines.
"""

"""Runs of systems, in virtual time on either engine or in real time, and their results.

In reading order:

- `run_options.py` has the options of a run, and reads values that a person sets from outside.
- `externs/` finds the code that answers each extern, and calls it: Python, C, a process of its own.
- `run.py` runs a system in virtual time, natively or in the interpreter.
- `real_time.py` compiles the package of target `posix` and runs it; `flight_recording.py` reads
  its recording.
- `interrupt.py` stops a run at the end of an instant when a person presses Ctrl-C.

While a run goes on:
- `run_observer.py` sees every state: it hashes and keeps states, and notes changes of mode.
- `module_safe_check.py` checks whether a module's own `safe` holds when an instant is over.

Afterwards:
- `result.py`: a `Run` gives what happened by the names that people use.
- `decisions.py` lists *what* each DM saw and did, step by step; `tube_looks.py` where SC would have
  led.
- `explain_decision.py` finds *why* a DM decided so: which part of a predicate, on which values;
  `stale_reads.py` which topics were too old, and why.
- `result_assumptions.py` says what a result takes for granted, and what it does not show.
- `run_log.py` writes a run as an MCAP log, and reads such a log back.
- `run_fields.py` makes its plain data for `--json`, `run_report.py` its page with time lines.
"""

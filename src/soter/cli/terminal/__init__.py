"""What commands share: their command line, console, progress, outcomes and crash reports.

- `command_line.py` has the parser of every command, `shared_options.py` options of several.
- `program_loading.py` loads the program of a command; `command_outcome.py` says how it ends.
- `console.py` decides to which stream a text goes, in which characters, and shows progress.
- `child_process.py` runs a command that calls externs in a child, so that a crash is no verdict.
- `stored_outcome.py` tells an outcome again while nothing that it rests on has changed.
- `ci_findings.py` has what continuous integration is told of; `ci_formats.py` writes it as SARIF,
  as JUnit's XML and for GitHub Actions.
- `run_summary.py` prints a run, `log_judgement.py` how modules judge a log of another system, and
  `proof_hints.py` what a search for hints of a proof found.
"""

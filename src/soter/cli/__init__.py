"""The command line: each command has a file here or in `tool/`, and works through `soter.api`.

In reading order:
- `main.py` chooses the command, runs it, and turns every way to end into an exit code.
- `terminal/` is what commands share, `templates/` the texts that `soter new` writes.
- `check.py` tells what is known without a run; `diff.py`, what a change leaves standing.
- `run.py` runs a system, `campaign.py` many times; `measure.py` times single steps.
- `test.py` explores all executions of tests; `replay.py` runs a trace again.
- `verify.py` proves modules, `recheck.py` checks certificates again; `advise.py` finds the longest
  period that verifies, `assure.py` makes a safety case.
- `build.py` writes a program for a target. `new.py` makes a small robot to begin with.
- `monitor.py` judges whether the proved model explains a log; `identify.py` fits parameters to it.
- `policy.py` tells what the file of a learned policy says, and writes it as Soter or C.
- `lsp.py` starts the language server; `tool/` has the commands about the tool itself.
"""

"""The paper's Section IV, rule by rule: the reference interpreter.

Purpose: the meaning of a system, written to be read beside the Figure "Semantics of an RTA
System" and docs/semantics.md; the generated C is compared with it bit by bit.
Non-goals: speed (`simulate/` runs the C), logs and reports, the state image (`core/layout.py`).

In reading order:
- `rules.py`: the rules of the Figure; `configuration.py`: the state that they change; `latches.py`:
  what a module remembers; `shields.py`: which commands are let through.
- `judgements.py` judges properties; `run_record.py` has the sums over a run.
- `publication_gate.py` decides what reaches the topics.
- `interpreter.py` decides which rule comes next, and steps plants.
- `executable_system.py` compiles the code of a system to Python, once.
- `externs.py` makes steps of Python code; `faults.py` says which faults a run meets.
- `draws.py` draws random numbers by counters, so that no draw depends on another; other draws are
  answered by a driver (`answered_draws.py`), adverse (`adverse_draws.py`), written down
  (`recorded_draws.py`).
"""

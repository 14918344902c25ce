"""Reads a certificate, and the problem off its program; refuses what cannot be read so.

- `folder.py` reads the folder, and makes a checked program of what is in it.
- `problem.py` reads plants, ranges and axes off the program; `module_facts.py` is their record.
- `supported_constructs.py` lists what is understood; everything else is refused.
- `module_times.py` reads the times of a module, `derived_times.py` derives them again.
- `case_model.py` has plants, SC and predicates of one case as terms.
- `symbolic_reading.py` evaluates code to values: `symbolic_operations.py` has the operations on
  them, `symbolic_values.py` their parts. `linear_flows.py` solves linear flows in balls.
"""

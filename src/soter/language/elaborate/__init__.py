"""Makes flat systems of a checked program: each pass, check or warning is a file.

- `flatten_system.py` calls the passes in `passes/`, one after the other.
- `faults.py` turns declared faults into faults of components.
- `composition_check.py` checks that the parts fit together, `wellformed.py` P1a and P1b.
- `tested_system.py` makes the system of a test: `timing_faults.py` enters its faults of time,
  `distinguishable_values.py` finds what code can tell apart, `time_grid.py` its grid of times,
  and `explorable.py` what prevents a search.
- `derived_systems.py` takes parts out of systems; `views_for_proofs.py` changes modules for proofs.
- `lints/` warns of what is well-formed and probably not meant.
"""

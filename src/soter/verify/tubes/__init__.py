"""Decision modules (DM) that enclose, in flight, every run of SC from the present estimate.

- `problem.py` is the problem of such a module; `verify.py` gives the verdicts on it.
- `tube_check.py` writes the check of the DM as Soter source, `tube_levels.py` the predicates that
  call it; the parts that all modules share are the `*.soter` files. `tube_precision.py` says how
  precisely SC is followed.
- `expression_graph.py` has real expressions; `module_expressions.py` reads those of a module,
  `sc_step.py` those of SC; `moved_rates.py` takes rates apart, by command and disturbance.
- `generated_functions.py` writes functions that enclose expressions; `enclosures.py` calls them,
  `compiled_calls.py` calls the costly ones in C.
- `rest_claims.py` shows what has to hold before the flight; `leading_back.py` shows its first rule;
  `simulated_runs.py` finds runs that never come back, and `noise_estimate.py` estimates what room
  noise needs and which boxes SC leads back into soon.
- `kinks.py` finds where runs may be collected, `turns.py` which states are angles that turn.
"""

"""Decision modules that enclose, in flight, every run of SC from the present estimate.

- `problem.py` is the problem of such a module; `verify.py` gives the verdicts on it.
- `tube_check.py` writes the check of the DM as Soter source, `tube_levels.py` the predicates that
  call it; the parts that all modules share are the `*.soter` files.
- `expression_graph.py` has real expressions; `module_expressions.py` reads those of a module,
  `sc_step.py` those of SC; `moved_rates.py` takes rates apart, by command and disturbance.
- `generated_functions.py` writes functions that enclose expressions; `enclosures.py` calls them.
- `rest_claims.py` shows what has to hold before anything flies; `leading_back.py` its first rule;
  `noise_estimate.py` estimates what noise needs of a rest that is not shown.
- `kinks.py` finds where runs may be collected, `turns.py` which states are angles that turn.
"""

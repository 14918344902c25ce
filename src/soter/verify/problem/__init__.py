"""Makes the verification problem of a module from a flat system.

- `problem.py` is the problem as data; `extract.py` reads it off a flat system.
- `verification_system.py` makes the system of the module and its plants alone;
  `supported_constructs.py` refuses what a proof cannot follow.
- `inputs.py` finds inputs, ranges and errors of estimates; `axes.py` the states that stand
  together, and `left_out_states.py` those that nothing reads.
- `schedule.py` derives every time of a proof; `cause_effect_chains.py` finds the paths from
  sensors and to plants that it counts, `time_checks.py` refuses times that are not covered.
- `problem_times.py` asks it for the times of a problem, and compares them with declared execution
  times; `switch_latency.py` does so for H. `one_instant.py` asks whether what is read together
  shows one instant.
- `assumptions.py` says in words what all of it takes for granted.
"""

"""Generates C99 from Core: the back end builds a tree of C, and `c_printer.py` prints it.

Each node, plant, predicate and decision module (DM) gets a function named after its source. A step
copies its locals, computes, checks what it publishes, and commits once. A DM finds facts (stale,
ttf, safer, gate fault, clean); a function of these alone, the switching logic of the paper's
Figure, returns the mode. In reading order:

- `unit.py` begins: `generate` puts the header and the source of a program together.
- `nodes.py`, `plants_and_inputs.py`, `decisions.py` write its functions: steps of nodes; steps of
  plants, and topics that are set from outside; DMs, properties and other predicates. Of nodes,
  `queues.py` has the queues behind topics, `held_outputs.py` what a step that takes time publishes.
- `externs.py` writes how C or a driver answers an extern, `faults.py` what a system's faults do.
- `kernel_tables.py` writes the tables that the kernel reads, and what makes the first state.
- `state_access.py`: `Frame` emits the code around a body: it loads, checks, publishes, commits.
  `checked_code` is code that may fault, with the check that returns the step's first fault.
  `sure_outputs` are those that a step always publishes; they need no flag. `flag_is_set` is the
  C condition for a flag of the step, such as `SOTER_ENABLED`, under which outputs are published.
- `body.py`: `Body` translates the expressions and statements of a body from Core to C.
- `value_locations.py`: its base `Places` says where values lie; `plan_body` begins a body.
- `storage_plan.py` makes the plan of places: which large temporaries share one, or point to one.
- `c_types.py` makes structs and checks of types, `c_names.py` chooses names.
- `c_tree.py` has the nodes of the tree of C; `c_printer.py` prints them as text.
- `conditions.py` finds the conditions of that C, and says what its runs show of each.
"""

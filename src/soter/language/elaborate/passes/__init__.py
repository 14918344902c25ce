"""The passes that flatten a system, a file each, over one record (`flattening.py`).

In the order in which they are called:
- `system_numbers.py` gives each instance its parameters, and bounds the size of a system.
- `step_times.py` computes how long steps take, `read_ages.py` how old a topic is when it is read.
- `place_instances.py` makes a flat list of instances; `replace_parts.py` replaces some of them:
  `stand_ins.py` has those that do what a contract permits.
- `topics.py` makes a topic when it is first named; `value_sets.py` computes the values it may have.
- `make_components.py` makes plants, nodes and parts of modules, `make_modules.py` the modules.
- `properties.py` collects what is judged; `stated_values.py` the values that tests state.
- `outside_values.py` says what comes from outside, `memory_topics.py` what has to be remembered.
"""

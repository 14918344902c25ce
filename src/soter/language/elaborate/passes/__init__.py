"""The passes that flatten a system, a file each, over one record (`flattening.py`).

In the order in which they are called:
- `flattening.py` is the record that all of them fill.
- `place_instances.py` makes a flat list of instances; `replace_parts.py` replaces some of them.
- `topics.py` makes a topic when it is first named; `value_sets.py` computes the values it may have.
- `make_components.py` makes plants, nodes and parts of modules, `make_modules.py` the modules.
- `properties.py` collects what is judged; `stated_values.py` the values that tests state.
- `outside_values.py` says what comes from outside, `memory_topics.py` what has to be remembered.
"""

"""The model of a system that the explorer runs: actors, parts, and the C of configurations.

- `exploration_plan.py` finds the actors, their calendars, and parts that share nothing;
  `footprints.py` finds the steps that may not be swapped.
- `explorer_model.py` writes the C of the model; `packed_configuration.py` decides which fields a
  configuration has there, and `bit_packing.py` packs them.
"""

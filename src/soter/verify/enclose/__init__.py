"""Enclosures of the step functions and flows of a module, as generated and compiled C.

- `compiled_enclosures.py` generates the C of one module, compiles it, and calls it over boxes.
- `enclosed_steps.py` makes each function of that C, from the inputs in `enclosure_inputs.py`.
- `core_enclosure.py` turns Core into the operations on forms of `enclosed_operations.py`.
- `enclosure_emitter.py` collects the operations, and prints them as C.
"""

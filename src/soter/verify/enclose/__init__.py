"""Generates, compiles and calls C that encloses the step functions and flows of a module.

- `compiled_enclosures.py` generates the C of one module, compiles it, and calls it over boxes.
- `enclosed_steps.py` puts each of its functions together, of inputs in `enclosure_inputs.py`.
- `core_enclosure.py` turns Core into operations on forms; `enclosed_operations.py` has these.
- `enclosure_emitter.py` collects the operations, and prints them as C.
"""

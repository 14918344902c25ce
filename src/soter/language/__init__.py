"""The language: text -> tree -> checked program -> flat system, with P1a, P1b and composition.

`syntax/` reads and prints; `load/` turns paths into trees; `check/` gives names and types; a
checked program (`model/typed.py`) is elaborated into a flat `System` (`model/system.py`), in which
modules, instances and parameters are resolved; `evaluate/` computes expressions in Python.
`front_end.py` does all of it. Inside, imports point that way only (`.importlinter`).
"""

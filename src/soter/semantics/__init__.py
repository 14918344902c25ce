"""The paper's Section IV, rule by rule: the reference interpreter.

Purpose: the meaning of a system, written to be read beside the Figure "Semantics of an RTA
System" and docs/semantics.md; the generated C is compared with it bit by bit.
Non-goals: speed (`simulate/` runs the C), logs and reports, the state image (`core/layout.py`).
"""

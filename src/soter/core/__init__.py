"""Checked system -> Core, the small language that is compiled and proved.

In reading order: `core.py` is the tree. `lower_expressions.py` keeps the order of evaluation,
`lower_statements.py` makes early returns a single exit, `plants.py` writes the scheme of
integration out, and `steps.py` lowers nodes, decision modules and properties. `layout.py` decides
how a state lies in memory: header, a record per component, module and property, a stamp per topic,
then topics, locals and plant states, ordered by alignment and padded explicitly. A state is its
bytes, a trace the state after every instant; `trace_sha256` hashes it. `core_walks.py` says what a
step reads, `execution.py` runs Core over other values than numbers: enclosures, terms.
`core_check.py` checks what Core promises; `core_text.py` prints it for people.
"""

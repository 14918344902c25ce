"""Core -> C99 through a C tree and a printer.

One function per node, plant, predicate and decision module, named after its source. A step copies
its locals, computes (faults are sticky), checks what it wants to publish, and commits once. The
DM finds facts (stale, ttf, safer, gate fault, clean); a function of these alone, the switching
logic of the paper's Figure, answers.
"""

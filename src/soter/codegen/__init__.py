"""Generates C99 from Core: the back end builds a tree of C, and `c_printer.py` prints it.

Each node, plant, predicate and decision module (DM) gets a function named after its source. A step
copies its locals, computes (its first fault stays: it is sticky), checks what it publishes, and
commits once. A DM finds facts (stale, ttf, safer, gate fault, clean); a function of these alone,
the switching logic of the paper's Figure, returns the mode.
"""

"""Modules with `rest`, whose decision module follows SC from each estimate: tubes in Arb."""

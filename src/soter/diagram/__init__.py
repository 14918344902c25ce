"""The picture of a system: what runs, what it reads and publishes, and who stands in for whom.

`system_graph.py` makes boxes and arrows of a system, `layered_layout.py` places them, and `svg.py`
draws them.
"""

"""Groups proved by sets of cells of a grid: each claim is an inclusion, shown cell by cell.

- `grid_group.py` reads the tables of a group, and turns each claim into tasks about cells.
- `group_claims.py` shows the inclusions; `sc_chains.py` has the chains of periods that it asks.
- `flow_chains.py` leads a set over one hold, taken apart by `chain_form_layout.py`.
- `flow_enclosures.py` encloses the flow over a span of time.
"""

"""Checks nodes, modules, plants, systems, `verify` and `test` blocks.

- `node.py`, `plant.py` and `module.py` check what a system is made of; `plans.py` makes one SC of
  several plans, and `verify_block.py` checks what `soter verify` needs.
- `system.py` checks systems and tests; `system_items.py` the items that both share.
- `instances.py` makes single instances of arrays, and finds the topic to which a wire leads.
"""

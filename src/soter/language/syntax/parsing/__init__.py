"""The parser: `parser.py` makes the tree of a file, on top of the other files here.

- `token_cursor.py` looks ahead, reports once, and finds where to go on after an error.
- `literals_and_operators.py` and `expressions.py` read expressions, `types.py` types and sets,
  `statements.py` statements and blocks.
- `items.py` has the rows of which the tables of bodies consist; `bodies.py` reads by such tables.
- `declarations.py` has the tables of plants and nodes, and reads functions; `modules.py` those of
  modules, `systems.py` those of systems and tests; `instance_arrays.py` reads loops over items.
"""

"""Checks the syntax trees of a program: names, types, constants, and every declaration.

- `checker.py` is the way in; `checker_interface.py` is what checkers of one program ask each other.
- `scope.py` finds the declaration of a name; `unknown_names.py` guesses what a wrong one meant.
- `constants_and_types.py` computes constants, and resolves types.
- `declarations.py` checks signatures, then bodies; `parts/` the larger declarations.
- `statements.py` checks blocks; `expr.py` expressions, over the base classes in
  `expression_base.py`, `dots_and_brackets.py`, `call.py` and `operators_and_choices.py`.
- `call_hints.py` guesses what was meant where nothing of that name can be called.
"""

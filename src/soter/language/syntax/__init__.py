"""Reads and prints source text: the lexer, the parser, the syntax tree, the printer.

- `tree.py` is what a text says, over the cheap dataclasses of `node.py`.
- `lexer.py` makes tokens, `hash_lines.py` explains what it finds of other languages behind a `#`;
  `parsing/` makes trees of files.
- `schemes.py` lists schemes of integration; `their_words.py`, words of other languages.
- `printer.py` lays a text out for `soter fmt`.
"""

"""Reads and prints source text: the lexer, the parser, the syntax tree, the printer.

- `tree.py` is what a text says, over the cheap dataclasses of `node.py`.
- `tokens.py` is the lexer; `parser.py` makes trees of files, with the parts in `parsing/`.
- `schemes.py` lists schemes of integration; `their_words.py`, words of other languages.
- `printer.py` lays a text out for `soter fmt`.
"""

"""Reads and prints source text: the lexer, the parser, the syntax tree, the printer."""

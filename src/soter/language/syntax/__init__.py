"""Text to tree and back: the lexer, the parser, the tree, the printer."""

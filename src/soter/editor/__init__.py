"""The language server: what Soter knows of a program, where it is written."""

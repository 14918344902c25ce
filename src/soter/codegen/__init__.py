"""Core -> C99 through a C tree and a printer."""

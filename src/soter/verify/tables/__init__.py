"""Sets as the tables and half-spaces that a DM reads."""

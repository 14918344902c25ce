"""From paths to trees: program files, imports, data."""

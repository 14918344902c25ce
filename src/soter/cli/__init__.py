"""The command line: each command has a file here or in `tool/`, and works through `soter.api`."""

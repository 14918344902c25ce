"""The command line: one file a command, all of them through `soter.api`."""

"""The problem as the re-checker reads it off the checked program."""

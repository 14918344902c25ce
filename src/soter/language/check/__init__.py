"""From trees to the checked program."""

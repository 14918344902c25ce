"""The language server: shows in an editor what Soter knows of a program."""

"""The folder, and the program in it."""

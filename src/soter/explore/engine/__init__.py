"""The C search behind one thread, and its numbers in the program's words."""

"""C as a tree, its printer, names and types."""

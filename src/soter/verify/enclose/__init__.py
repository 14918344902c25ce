"""Step functions and flows of a module read over other numbers, in C, and the library of them."""

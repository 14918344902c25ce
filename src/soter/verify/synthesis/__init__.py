"""A safe controller that is found."""

"""A safety case: goals, what supports them, what they rest on; a page, JSON, StrictDoc."""

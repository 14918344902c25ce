"""Systems that run in the world: what they inherit, and the thread that keeps their times."""

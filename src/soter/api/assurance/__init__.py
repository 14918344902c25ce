"""Safety cases: goals, and the evidence that supports them, which is checked as a case is made."""

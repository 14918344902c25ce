"""Safety cases: what supports a claim, checked while the case is made."""

"""What chance decides: draws, and the faults that a system declares."""

"""P2a, P2b, P3: problem, sets, fixpoints, verdicts, certificates (docs/verification.md)."""

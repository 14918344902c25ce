"""What a system is put through: tests, parts that stand in by contract, faults."""

"""What soter build emits."""

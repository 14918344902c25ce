"""Groups proved by half-spaces (polytopes): each claim is an inclusion, shown by weak duality."""

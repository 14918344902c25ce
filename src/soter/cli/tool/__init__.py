"""Commands about the tool itself: its layout, its cache, what shells know of it."""

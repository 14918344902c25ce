"""Whether what a test asks could ever be answered with no."""

"""Names of programs: what they mean, wherever they are written, finished or not."""

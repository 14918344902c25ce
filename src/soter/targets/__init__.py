"""What `soter build` writes: a file or a folder for each target, and what targets share."""

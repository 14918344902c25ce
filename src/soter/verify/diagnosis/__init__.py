"""Why nothing was proved, or proved of nothing: figures, experiments, pictures."""

"""Where large values of generated C lie: by address, and as few copies as can be shown to do."""

"""The passes that flatten a system, a file each, over one record (`flattening.py`)."""

"""The report page of a run: its records, figures and texts."""

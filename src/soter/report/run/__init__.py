"""The report page of a run: its records, figures, texts and the replay on the diagram."""

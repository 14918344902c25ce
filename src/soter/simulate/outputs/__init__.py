"""What a run is told as: log, report, figures, notes."""

"""What commands share: their command line, console, progress, outcomes and crash reports."""

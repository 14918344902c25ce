"""What a command prints with: the console, progress, outcomes and crashes."""

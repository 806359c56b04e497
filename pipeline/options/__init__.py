"""What can be asked for: every option with its meaning, default and range."""

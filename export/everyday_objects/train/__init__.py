"""Training, sampling and exporting the default model."""

"""The networks of the default model."""

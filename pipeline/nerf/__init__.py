"""A text's own shape: the radiance field, its rendering, a step of its training."""

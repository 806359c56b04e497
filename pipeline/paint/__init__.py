"""A given mesh: what views read of its colours, a step of painting it, and its file with new colours."""

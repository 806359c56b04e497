"""The local page and its HTTP API: asks, a queue, what is there to see and to download."""

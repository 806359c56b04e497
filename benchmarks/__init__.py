"""Measurements, with their results: `python -m benchmarks`."""

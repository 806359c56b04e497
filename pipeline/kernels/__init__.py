"""Compiled (numba) inner loops on plain arrays; the typed functions around them are in `pipeline.scene`."""

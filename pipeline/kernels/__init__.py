"""Compiled inner loops (numba) on plain arrays; the typed functions around them are in other rooms."""

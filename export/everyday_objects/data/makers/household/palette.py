"""Colours that things of the house always have."""

from export.everyday_objects.data.shapes import fixed

YELLOW = fixed(0.98, 0.82, 0.2)
BLUE = fixed(0.2, 0.5, 0.9)
GREEN = fixed(0.4, 0.72, 0.25)
CREAM = fixed(0.98, 0.93, 0.8)

"""Colours that things outdoors always have."""

from export.everyday_objects.data.shapes import fixed

STONE = fixed(0.56, 0.55, 0.53)
DARK_STONE = fixed(0.42, 0.41, 0.4)
DARK_WOOD = fixed(0.33, 0.2, 0.1)

"""Makers of objects: a random generator in, the parts of one object out; y up, the front to +z."""

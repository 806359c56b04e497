"""The mathematics of a scene: cameras, fields, rendering, occupancy, meshes, textures."""

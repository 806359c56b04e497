"""The scene: cameras, field, volume rendering, occupancy, meshes. Mathematics; no files except meshes and
checkpoints.
"""

"""Triangle meshes: the type, its files, surfaces, texture coordinates and textures."""

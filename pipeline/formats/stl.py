"""Binary STL: triangles and nothing else."""

import numpy as np

from pipeline.mesh.mesh import Mesh, face_normals


def stl_bytes(mesh: Mesh) -> bytes:
    """Return a solid as binary STL; a slicer takes its units for millimetres, and +Z for up."""
    normals = face_normals(mesh)
    record = np.zeros(len(mesh.faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    record["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    record["corners"] = mesh.vertices[mesh.faces]
    return b"latent-nerf-onnx".ljust(80) + np.uint32(len(record)).tobytes() + record.tobytes()

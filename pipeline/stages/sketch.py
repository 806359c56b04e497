"""Stage `sketch`: the user's mesh or drawing as a solid in the scene, tabulated once for the training.

Letters: v vertices, f faces.
"""

import numpy as np

from pipeline.mesh.mesh import Mesh, write_ply
from pipeline.run.stage import Context, execute
from pipeline.sketch.lattice import save_sketch, solid_cells
from pipeline.sketch.reading import read_sketch
from pipeline.sketch.winding import orient_outwards, place, tabulate

_THIN = 2e-3
"""A solid that fills a smaller share of the box is probably a sheet, or far smaller than a stray vertex."""


def main(context: Context) -> None:
    """Read the mesh or drawing that the user gave; write its lattice and the solid as a mesh."""
    options, path = context.job.sketch_field, context.inputs["sketch"]
    mesh = read_sketch(path, options.thickness)
    used = np.unique(mesh.faces)
    faces = np.searchsorted(used, mesh.faces)
    vertices = place(mesh.vertices[used].astype(np.float64), options.radius)
    faces = orient_outwards(vertices, faces)
    sketch = tabulate(vertices, faces, options.cells, str(path))
    save_sketch(context.outputs["sketch"], sketch)
    write_ply(context.outputs["mesh"], Mesh(vertices.astype(np.float32), faces.astype(np.int32)))
    inside = float((sketch.winding > 0.5).mean())
    warnings = context.metrics.setdefault("warnings", [])
    if inside < _THIN:
        warnings.append(
            f"the sketch fills only {100 * inside:.2f} % of the scene: check that its surface is closed, "
            "and that no stray part makes it small"
        )
    context.metrics.update(
        vertices=len(vertices),
        faces=len(faces),
        inside_share=inside,
        occupied_share=float(solid_cells(sketch, options.cells).mean()),
    )


if __name__ == "__main__":
    execute("sketch", main)

"""A sketch file, mesh or drawing, as triangles."""

from pathlib import Path

from pipeline.errors import InputError
from pipeline.mesh.file_checks import FORMATS
from pipeline.mesh.mesh import Mesh
from pipeline.sketch.svg import DRAWINGS


def check_ending(path: Path) -> None:
    """Raise InputError for a file that is neither a mesh nor a drawing by its name."""
    if path.suffix.lower() not in DRAWINGS + FORMATS:
        raise InputError(
            f"{path}: the ending is {path.suffix or 'missing'}, expected a mesh ({' '.join(FORMATS)}) "
            f"or a drawing ({' '.join(DRAWINGS)})"
        )


def read_sketch(path: Path, thickness: float) -> Mesh:
    """Return the triangles of a mesh file, or of a drawing extruded to `thickness` times its longer side.

    Positions are float64, in the file's units.

    Raises:
        InputError: see `readers.read_mesh` and `drawing.read_silhouette`.
    """
    check_ending(path)
    if path.suffix.lower() not in DRAWINGS:
        from pipeline.mesh.readers import read_mesh  # neither way needs what the other imports

        mesh = read_mesh(path)
        return Mesh(mesh.vertices, mesh.faces)
    from pipeline.sketch import drawing

    try:
        return drawing.extrude(drawing.read_silhouette(path), thickness)
    except ValueError as error:
        raise InputError(f"{path} shows no silhouette ({error}): draw the object larger") from None

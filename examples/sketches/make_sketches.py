"""Writes the sketches beside this file: the paper's shapes, put together from primitives.

    python examples/sketches/make_sketches.py

Each is a soup of parts that overlap freely; nothing is joined, which is all that SKETCH= needs. +y is up, the
front faces +z, the units do not matter. Change a number, or compose something of your own.
"""

from pathlib import Path

import numpy as np
import trimesh
from trimesh import creation

HERE = Path(__file__).parent
Point = tuple[float, float, float]
Parts = dict[str, trimesh.Trimesh]


def ellipsoid(centre: Point, radii: Point, tilt_degrees: float = 0.0) -> trimesh.Trimesh:
    """Return an ellipsoid, turned about the x axis (positive: its top comes forwards)."""
    mesh = creation.icosphere(subdivisions=2)
    turn = trimesh.transformations.rotation_matrix(np.radians(tilt_degrees), [1, 0, 0])
    return mesh.apply_scale(radii).apply_transform(turn).apply_translation(centre)


def box(low: Point, high: Point) -> trimesh.Trimesh:
    """Return the box between two corners."""
    return creation.box(bounds=[low, high])


def rod(start: Point, end: Point, radius: float, end_radius: float | None = None) -> trimesh.Trimesh:
    """Return a straight piece with flat ends, round, with another radius at its end if given."""
    mesh = creation.cylinder(radius=1.0, segment=[start, end], sections=16)
    axis = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    along = (mesh.vertices - start) @ axis
    foot = np.asarray(start) + along[:, None] * axis
    share = (along / along.max())[:, None]
    radii = radius + ((radius if end_radius is None else end_radius) - radius) * share
    mesh.vertices = foot + (mesh.vertices - foot) * radii
    return mesh


def limb(start: Point, end: Point, radius: float, end_radius: float | None = None) -> list[trimesh.Trimesh]:
    """Return a rod with a ball at either end."""
    last = radius if end_radius is None else end_radius
    return [
        rod(start, end, radius, last),
        ellipsoid(start, (radius,) * 3),
        ellipsoid(end, (last,) * 3),
    ]


def prism(outline: list[tuple[float, float]], axis: str, start: float, end: float) -> trimesh.Trimesh:
    """Return a convex outline, extruded along x (then its points are (z, y)) or along z (then (x, y))."""
    points = [(a, y, c) for c in (start, end) for a, y in outline]
    corners = [(c, y, a) for a, y, c in points] if axis == "x" else points
    return trimesh.convex.convex_hull(np.array(corners, np.float64))


def join(*meshes: trimesh.Trimesh | list[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Return several meshes as one part."""
    flat = [piece for mesh in meshes for piece in (mesh if isinstance(mesh, list) else [mesh])]
    return trimesh.util.concatenate(flat)


def both(build: "trimesh.Trimesh | list[trimesh.Trimesh]") -> trimesh.Trimesh:
    """Return a part together with its mirror image in x."""
    mesh = join(build)
    mirrored = mesh.copy()
    mirrored.vertices[:, 0] *= -1
    mirrored.faces = mirrored.faces[:, ::-1]
    return join(mesh, mirrored)


def animal() -> Parts:
    """Return a four-legged animal."""
    return {
        "body": ellipsoid((0, 0, 0), (0.3, 0.3, 0.55)),
        "front_legs": both(limb((0.17, -0.1, 0.33), (0.17, -0.6, 0.33), 0.1, 0.08)),
        "hind_legs": both(limb((0.17, -0.1, -0.33), (0.17, -0.6, -0.33), 0.11, 0.08)),
        "neck": join(limb((0, 0.1, 0.4), (0, 0.4, 0.6), 0.16)),
        "head": ellipsoid((0, 0.47, 0.68), (0.18, 0.18, 0.22)),
        "snout": join(limb((0, 0.42, 0.8), (0, 0.4, 0.95), 0.1, 0.08)),
        "ears": both(rod((0.11, 0.55, 0.6), (0.15, 0.78, 0.58), 0.07, 0.02)),
        "tail": join(limb((0, 0.12, -0.5), (0, 0.35, -0.75), 0.06, 0.04)),
    }


def house() -> Parts:
    """Return a house with a gable roof, its door to the front."""
    return {
        "walls": box((-0.5, -0.5, -0.42), (0.5, 0.15, 0.42)),
        "roof": prism([(-0.62, 0.08), (0.62, 0.08), (0.0, 0.62)], "z", -0.52, 0.52),
        "chimney": box((0.22, 0.2, -0.25), (0.38, 0.66, -0.09)),
        "porch": box((-0.16, -0.5, 0.3), (0.16, -0.12, 0.5)),
        "step": box((-0.24, -0.5, 0.3), (0.24, -0.44, 0.6)),
    }


def car() -> Parts:
    """Return a car that drives towards the front."""
    side = [(-0.62, 0.12), (0.35, 0.12), (0.12, 0.42), (-0.45, 0.42)]
    return {
        "body": box((-0.38, -0.12, -0.85), (0.38, 0.16, 0.85)),
        "cabin": prism(side, "x", -0.33, 0.33),
        "front_wheels": both(rod((0.26, -0.14, 0.52), (0.43, -0.14, 0.52), 0.19)),
        "rear_wheels": both(rod((0.26, -0.14, -0.52), (0.43, -0.14, -0.52), 0.19)),
    }


def hand() -> Parts:
    """Return an open hand, its palm to the front."""
    tips = [(-0.34, 0.5, 0.09), (-0.12, 0.68, 0.1), (0.1, 0.62, 0.1), (0.31, 0.4, 0.085)]
    fingers = {
        f"finger_{n}": join(limb((0.75 * x, 0.0, 0), (x, y, 0), radius, 0.8 * radius))
        for n, (x, y, radius) in enumerate(tips)
    }
    return {
        "palm": ellipsoid((-0.01, -0.22, 0), (0.36, 0.36, 0.16)),
        **fingers,
        "thumb": join(limb((-0.2, -0.3, 0.04), (-0.6, 0.05, 0.1), 0.12, 0.09)),
        "wrist": rod((0, -0.4, 0), (0, -0.75, 0), 0.19, 0.17),
    }


def teddy_bear() -> Parts:
    """Return a sitting teddy bear."""
    return {
        "body": ellipsoid((0, -0.15, 0), (0.36, 0.42, 0.32)),
        "head": ellipsoid((0, 0.45, 0.03), (0.3, 0.28, 0.28)),
        "muzzle": ellipsoid((0, 0.38, 0.28), (0.13, 0.11, 0.12)),
        "ears": both(ellipsoid((0.24, 0.68, 0), (0.12, 0.12, 0.07))),
        "arms": both(limb((0.28, 0.1, 0.08), (0.52, -0.14, 0.24), 0.13)),
        "legs": both(limb((0.2, -0.42, 0.1), (0.32, -0.45, 0.5), 0.16)),
    }


def lego_man() -> Parts:
    """Return a toy figure of blocks."""
    return {
        "torso": prism([(-0.3, -0.1), (0.3, -0.1), (0.22, 0.32), (-0.22, 0.32)], "z", -0.15, 0.15),
        "head": rod((0, 0.3, 0), (0, 0.6, 0), 0.17),
        "stud": rod((0, 0.55, 0), (0, 0.67, 0), 0.09),
        "hips": box((-0.3, -0.2, -0.15), (0.3, -0.05, 0.15)),
        "legs": both(box((0.02, -0.65, -0.15), (0.29, -0.12, 0.15))),
        "feet": both(box((0.02, -0.65, 0.0), (0.29, -0.54, 0.24))),
        "arms": both(limb((0.26, 0.24, 0), (0.38, -0.05, 0.1), 0.085)),
        "hands": both(rod((0.38, -0.08, 0.06), (0.39, -0.12, 0.22), 0.08)),
    }


SKETCHES = {f.__name__: f for f in (animal, house, car, hand, teddy_bear, lego_man)}


def to_obj(parts: Parts) -> str:
    """Return the parts as an OBJ file, each under its name."""
    lines, first = [], 1
    for name, mesh in parts.items():
        lines.append(f"o {name}")
        lines += ["v {:.4f} {:.4f} {:.4f}".format(*vertex) for vertex in mesh.vertices.tolist()]
        lines += ["f {} {} {}".format(*face) for face in (mesh.faces + first).tolist()]
        first += len(mesh.vertices)
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for name, build in SKETCHES.items():
        (HERE / f"{name}.obj").write_text(to_obj(build()), encoding="ascii")

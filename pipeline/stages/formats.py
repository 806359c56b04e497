"""Stage `formats`: the asset in the other files that FORMATS names."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pipeline.formats.asset import Asset, read_asset
from pipeline.formats.ply import ply_bytes
from pipeline.formats.printing import MILLIMETRES, advice, printable, solid
from pipeline.formats.stl import stl_bytes
from pipeline.formats.threemf import threemf_bytes
from pipeline.formats.usdz import usdz_bytes
from pipeline.mesh.mesh import Mesh
from pipeline.run.stage import Context, execute


def solid_colours(asset: Asset, mesh: Mesh) -> np.ndarray:
    """Return the colour of every vertex of a solid (v 3), that of the asset's vertex nearest to it."""
    x, y, z = MILLIMETRES * asset.vertices.T
    place = np.stack([x, -z, y], axis=1)
    place -= (place.min(axis=0) + place.max(axis=0)) / 2
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    _, nearest = cKDTree(place).query(mesh.vertices - middle)
    return asset.colours[nearest]


def main(context: Context) -> None:
    """Read asset.glb; write the files that are asked for, and measure what is to be printed."""
    asset, outputs, metrics = read_asset(context.inputs["glb"]), context.outputs, context.metrics
    if "as_ply" in outputs:
        outputs["as_ply"].write_bytes(ply_bytes(asset, "albedo.png"))
    if "as_usdz" in outputs:
        outputs["as_usdz"].write_bytes(usdz_bytes(asset))
    if {"as_stl", "as_3mf"} & {*outputs}:
        mesh, wrapped = solid(asset.vertices, asset.faces)
        found = printable(mesh)
        metrics.update(found._asdict(), print_faces=len(mesh.faces), wrapped=wrapped)
        if said := advice(found, wrapped):
            metrics["warnings"] = said
        if "as_stl" in outputs:
            outputs["as_stl"].write_bytes(stl_bytes(mesh))
        if "as_3mf" in outputs:
            outputs["as_3mf"].write_bytes(threemf_bytes(mesh, solid_colours(asset, mesh), asset.name))
    metrics["bytes"] = {path.name: path.stat().st_size for _, path in sorted(outputs.items())}


if __name__ == "__main__":
    execute("formats", main)

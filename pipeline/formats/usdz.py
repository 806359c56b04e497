"""USDZ, for Apple's viewers and USD's tools, by PyPI's `usd-core`, an extra of this package.

The package is a zip file whose contents lie uncompressed at multiples of 64 bytes (OpenUSD's USDZ
specification, 1.3); it is packed here, since USD's own packer writes the time into it.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.formats.archive import zipped
from pipeline.formats.asset import Asset
from pipeline.mesh.coloured import to_linear
from pipeline.options.formats import check_installed

ALIGNED = 64
ALBEDO, NORMAL = "textures/albedo.png", "textures/normal.png"


def usdz_bytes(asset: Asset) -> bytes:
    """Return a USDZ file: mesh, UsdPreviewSurface and textures [m, +Y up]. A rig stays in the GLB file.

    Raises:
        InputError: usd-core is not installed.
    """
    check_installed("usdz")
    pictures = [
        (name, content)
        for name, content in ((ALBEDO, asset.albedo), (NORMAL, asset.normal_map))
        if content is not None
    ]
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "asset.usdc"
        _write_stage(scene, asset, [path for path, _ in pictures])
        return zipped([(scene.name, scene.read_bytes()), *pictures], compressed=False, align=ALIGNED)


def _write_stage(path: Path, asset: Asset, pictures: list[str]) -> None:
    from pxr import Kind, Usd, UsdGeom, UsdShade

    name = re.sub(r"[^A-Za-z0-9_]", "_", asset.name)
    root = f"/{name}" if re.match(r"[A-Za-z_]", name) else f"/_{name}"
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    top = UsdGeom.Xform.Define(stage, root)
    Usd.ModelAPI(top).SetKind(Kind.Tokens.component)
    stage.SetDefaultPrim(top.GetPrim())
    mesh, material = (
        _mesh(stage, f"{root}/mesh", asset),
        _material(stage, f"{root}/material", asset, pictures),
    )
    UsdShade.MaterialBindingAPI.Apply(mesh).Bind(material)
    stage.GetRootLayer().Save()


def _mesh(stage: Any, path: str, asset: Asset) -> Any:
    """Define the geometry; return its prim."""
    from pxr import Gf, Sdf, UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, path)
    points = asset.vertices.astype(np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(asset.faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(asset.faces.astype(np.int32).ravel()))
    mesh.CreateExtentAttr([Gf.Vec3f(*map(float, end)) for end in (points.min(axis=0), points.max(axis=0))])
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    if asset.normals is not None:
        mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(asset.normals.astype(np.float32)))
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    if asset.uv is not None:
        turned = (asset.uv * [1, -1] + [0, 1]).astype(np.float32)
        kind = Sdf.ValueTypeNames.TexCoord2fArray
        coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", kind, UsdGeom.Tokens.vertex)
        coordinates.Set(Vt.Vec2fArray.FromNumpy(turned))
    else:
        shade = mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
        shade.Set(Vt.Vec3fArray.FromNumpy(to_linear(asset.colours).astype(np.float32)))
    return mesh.GetPrim()


def _material(stage: Any, path: str, asset: Asset, pictures: list[str]) -> Any:
    """Define the material: it shows the pictures, or without any the colours of the vertices."""
    from pxr import Gf, Sdf, UsdShade

    kinds = Sdf.ValueTypeNames
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", kinds.Float).Set(asset.roughness)
    surface.CreateInput("metallic", kinds.Float).Set(asset.metallic)
    reader = UsdShade.Shader.Define(stage, f"{path}/reader")
    reader.CreateIdAttr("UsdPrimvarReader_float2" if pictures else "UsdPrimvarReader_float3")
    reader.CreateInput("varname", kinds.String).Set("st" if pictures else "displayColor")
    read = reader.CreateOutput("result", kinds.Float2 if pictures else kinds.Float3)
    if not pictures:
        surface.CreateInput("diffuseColor", kinds.Color3f).ConnectToSource(read)
    for picture in pictures:
        bumps = picture == NORMAL
        texture = UsdShade.Shader.Define(stage, f"{path}/{Path(picture).stem}")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", kinds.Asset).Set(picture)
        texture.CreateInput("sourceColorSpace", kinds.Token).Set("raw" if bumps else "sRGB")
        texture.CreateInput("st", kinds.Float2).ConnectToSource(read)
        if bumps:  # bytes are [0, 1], directions [-1, 1]
            texture.CreateInput("scale", kinds.Float4).Set(Gf.Vec4f(2, 2, 2, 1))
            texture.CreateInput("bias", kinds.Float4).Set(Gf.Vec4f(-1, -1, -1, 0))
        for edge in ("wrapS", "wrapT"):
            texture.CreateInput(edge, kinds.Token).Set("clamp")
        shown = texture.CreateOutput("rgb", kinds.Float3)
        goal = ("normal", kinds.Normal3f) if bumps else ("diffuseColor", kinds.Color3f)
        surface.CreateInput(*goal).ConnectToSource(shown)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    return material

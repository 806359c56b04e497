"""Read the models of Debian's `sweethome3d-furniture` (CC0 and CC-BY 3.0) into plain arrays.

Each library is a zip (`.sh3f`) of OBJ + MTL folders and a `PluginFurnitureCatalog.properties` file (latin-1)
with one numbered block of keys a model. Models stand in centimetres, y up, their front to +z.
"""

import re
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from PIL import Image

LIBRARIES = Path("/usr/share/sweethome3d/furniture")
TEXTURE_SIZE = 128
RADIUS = 0.75  # of the ball around every object, in scene units


class Entry(NamedTuple):
    """One catalogue entry."""

    key: str
    name: str
    library: str
    path: Path
    size: tuple[float, float, float]
    """Width, height, depth as the catalogue gives them [cm]."""
    rotation: tuple[float, ...]
    """Row-major 3 x 3, applied to the OBJ's coordinates."""
    creator: str


class Model(NamedTuple):
    """One textured object, centred, its bounding ball of radius `RADIUS`."""

    vertices: np.ndarray
    """(v, 3) float32"""
    faces: np.ndarray
    """(f, 3) int32"""
    uv: np.ndarray
    """(v, 2) float32, origin bottom left"""
    material: np.ndarray
    """(f,) int32, row of the next three"""
    colours: np.ndarray
    """(m, 4) float32 in [0, 1]; alpha below 0.5 is glass"""
    textured: np.ndarray
    """(m,) bool"""
    textures: np.ndarray
    """(m, TEXTURE_SIZE, TEXTURE_SIZE, 4) uint8; a (1, 1, 1, 4) dummy where no material is textured"""
    material_names: tuple[str, ...]


def read_catalogue(work: Path) -> list[Entry]:
    """Unpack the libraries below `work` (once) and list their entries, in catalogue order.

    Raises FileNotFoundError with the package to install when the libraries are missing.
    """
    archives = sorted(LIBRARIES.glob("*.sh3f"))
    if not archives:
        raise FileNotFoundError(f"no *.sh3f in {LIBRARIES}: install Debian's sweethome3d-furniture")
    entries = []
    for archive in archives:
        folder = work / archive.stem
        if not (folder / ".complete").exists():
            with zipfile.ZipFile(archive) as packed:
                packed.extractall(folder)
            (folder / ".complete").touch()
        blocks: dict[int, dict[str, str]] = {}
        for line in (folder / "PluginFurnitureCatalog.properties").read_text("latin-1").splitlines():
            if match := re.match(r"(\w+)#(\d+)=(.*)", line):
                blocks.setdefault(int(match[2]), {})[match[1]] = match[3].strip()
        for block in blocks.values():
            if "model" not in block:
                continue
            width, height, depth = (float(block.get(k, 0) or 0) for k in ("width", "height", "depth"))
            rotation = tuple(float(x) for x in block.get("modelRotation", "1 0 0 0 1 0 0 0 1").split())
            entries.append(
                Entry(f"{archive.stem}/{Path(block['model']).stem}", block["name"], archive.stem,
                      folder / block["model"].lstrip("/"), (width, height, depth), rotation,
                      block.get("creator", ""))
            )  # fmt: skip
    return entries


def load_model(entry: Entry) -> Model:
    """Load an entry's OBJ, scaled to the catalogue's size (uniformly where that would distort by over 15
    %).
    """
    path = entry.path if entry.path.suffix == ".obj" else next(entry.path.parent.glob("*.obj"))
    scene = trimesh.load_scene(path, process=False)
    vertices: list[np.ndarray] = []
    faces, uvs, material, colours = [], [], [], list[np.ndarray]()
    textures, names = [], []
    start = 0
    for name, part in sorted(scene.geometry.items()):
        look = getattr(part.visual, "material", None)
        uv = getattr(part.visual, "uv", None)
        vertices.append(np.asarray(part.vertices, np.float32))
        faces.append(np.asarray(part.faces, np.int32) + start)
        uvs.append(
            np.zeros((len(part.vertices), 2), np.float32) if uv is None else np.asarray(uv[:, :2], np.float32)
        )
        material.append(np.full(len(part.faces), len(colours), np.int32))
        colours.append(
            np.asarray(look.main_color if look is not None else (160, 160, 160, 255), np.float32) / 255
        )
        colours[-1][3] = float((getattr(look, "kwargs", None) or {}).get("d", ["1"])[0])
        textures.append(getattr(look, "image", None) if uv is not None else None)
        names.append(name)
        start += len(part.vertices)
    points = np.concatenate(vertices) @ np.asarray(entry.rotation, np.float32).reshape(3, 3).T
    return Model(
        fit(stretch(points, entry.size)),
        np.concatenate(faces),
        np.concatenate(uvs),
        np.concatenate(material),
        np.stack(colours),
        np.array([t is not None for t in textures]),
        pack_textures(textures),
        tuple(names),
    )


def stretch(points: np.ndarray, size: tuple[float, float, float]) -> np.ndarray:
    """Scale (v, 3) points to `size` unless some axis would be distorted by more than 15 % against the
    others.
    """
    extent = np.ptp(points, axis=0)
    scale = np.asarray(size) / np.maximum(extent, 1e-9)
    if min(size) <= 0 or extent.min() <= 0 or scale.max() > 1.15 * scale.min():
        scale = np.full(3, np.median(scale) if min(size) > 0 else 1.0)
    return points * scale.astype(np.float32)


def fit(points: np.ndarray) -> np.ndarray:
    """Centre (v, 3) points on their bounding box and scale their bounding ball to `RADIUS`."""
    points = points - (points.max(0) + points.min(0)) / 2
    return (points * (RADIUS / np.linalg.norm(points, axis=1).max())).astype(np.float32)


def pack_textures(images: list) -> np.ndarray:
    """Resize the materials' pictures (or None) to one (m, size, size, 4) uint8 array, its first row at v =
    0.
    """
    if not any(i is not None for i in images):
        return np.zeros((1, 1, 1, 4), np.uint8)
    packed = np.full((len(images), TEXTURE_SIZE, TEXTURE_SIZE, 4), 255, np.uint8)
    for row, image in enumerate(images):
        if image is not None:
            resized = image.convert("RGBA").resize((TEXTURE_SIZE, TEXTURE_SIZE), Image.Resampling.BOX)
            packed[row] = np.asarray(resized)[::-1]
    return packed

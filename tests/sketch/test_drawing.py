"""Silhouettes: what counts as the object, and the solid that comes of it."""

from pathlib import Path

import igl
import numpy as np
import pytest
from PIL import Image, ImageDraw

from pipeline.errors import InputError
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.topology import topology
from pipeline.sketch.drawing import extrude, read_silhouette

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 50">{}</svg>'
RING = SVG.format('<path fill-rule="evenodd" d="M10 5h80v40h-80z M30 15h20v20h-20z"/>')


def draw(path: Path, mode: str, background: object, ink: object) -> Path:
    """Draw a wide bar with a round hole, and a separate square."""
    image = Image.new(mode, (300, 200), background)
    pen = ImageDraw.Draw(image)
    pen.rectangle([20, 60, 219, 159], fill=ink)
    pen.ellipse([60, 80, 120, 140], fill=background)
    pen.rectangle([240, 20, 279, 59], fill=ink)
    image.save(path, format="PNG")
    return path


def volume(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(np.float64), 1, 0)
    return float(np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize(
    ("mode", "background", "ink"),
    [("RGB", "white", "black"), ("RGB", (250, 240, 200), (200, 60, 60)),
     ("RGBA", (9, 9, 9, 0), (9, 9, 9, 255)), ("L", 255, 0), ("L", 0, 255), ("1", 1, 0)],
)  # fmt: skip
def test_the_object_is_opaque_or_differs_from_the_border(
    tmp_path: Path, mode: str, background: object, ink: object
) -> None:
    mask = read_silhouette(draw(tmp_path / "a.png", mode, background, ink))
    share = (200 * 100 - np.pi * 30.5**2 + 40 * 40) / (300 * 200)
    assert mask.mean() == pytest.approx(share, rel=0.02)


def test_the_solid_is_the_drawing_as_thick_as_asked(tmp_path: Path) -> None:
    mask = read_silhouette(draw(tmp_path / "a.png", "L", 255, 0))
    mesh = extrude(mask, 0.25)
    rows, columns = np.nonzero(mask)
    depth = 0.25 * (np.ptp(columns) + 1)
    assert topology(mesh).closed
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [np.ptp(columns), np.ptp(rows), depth], atol=2)
    assert volume(mesh) == pytest.approx(mask.sum() * depth, rel=0.02), "outwards, and the hole is a hole"
    centres = np.argwhere(np.ones_like(mask))[:, ::-1] * [1.0, -1.0]
    winding = igl.winding_number(
        mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64), np.pad(centres, ((0, 0), (0, 1)))
    ).reshape(mask.shape)
    assert ((winding > 0.5) != mask).mean() < 0.01, "x to the right, y upwards"
    assert np.quantile(np.abs(winding - winding.round()), 0.98) < 0.01


def test_svg(tmp_path: Path) -> None:
    (tmp_path / "ring.svg").write_text(RING)
    mask = read_silhouette(tmp_path / "ring.svg")
    assert mask.mean() == pytest.approx((80 * 40 - 20 * 20) / (100 * 50), rel=0.02)
    mesh = extrude(mask, 0.5)
    assert topology(mesh).closed
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(2 * np.ptp(mesh.vertices[:, 1]), rel=0.02)


def test_many_holes_and_parts_are_still_closed() -> None:
    rng = np.random.default_rng(0)
    mask = np.kron(rng.random((12, 12)) > 0.4, np.ones((16, 16))).astype(bool)
    mesh = extrude(mask, 0.3)
    rows, columns = np.nonzero(mask)
    depth = 0.3 * (max(np.ptp(rows), np.ptp(columns)) + 1)
    assert volume(mesh) == pytest.approx(mask.sum() * depth, rel=0.05)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.png", b"", "not a readable PNG"),
        ("a.png", b"\x89PNG\r\n\x1a\n" + bytes(40), "not a readable PNG"),
        ("a.png", b"GIF89a", "not a readable PNG"),
        ("a.svg", b"", "not a readable SVG"),
        ("a.svg", b"<html>", "not a readable SVG"),
        ("a.svg", b"\xff\xfe\x00", "not a readable SVG"),
        ("a.svg", SVG.format("").encode(), "no silhouette"),
        ("a.svg", SVG.format('<image href="/etc/hostname" width="9" height="9"/>').encode(), "/etc/hostname"),
        ("a.svg", SVG.format("<svg:image\n xlink:href = 'b.png' />").encode(), "'b.png'.*embed it"),
        ("a.svg", SVG.format('<image href="data:image/png;base64,AA"/>').encode(), "no silhouette"),
        ("a.svg", SVG.format('<rect width="100" height="50"/>').encode(), "no silhouette"),
    ],
)
def test_what_is_no_drawing_is_one_line(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words) as error:
        read_silhouette(tmp_path / name)
    assert name in str(error.value)
    assert "\n" not in str(error.value)


def test_a_tall_svg_takes_no_more_memory_than_a_square_one(tmp_path: Path) -> None:
    (tmp_path / "tall.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="900000">'
        '<rect width="9" height="99999"/></svg>'
    )
    assert read_silhouette(tmp_path / "tall.svg").size <= 512 * 512


def test_specks_are_no_object() -> None:
    mask = np.zeros((400, 400), bool)
    mask[5, 5] = mask[200:203, 100:102] = True
    with pytest.raises(ValueError, match="large enough"):
        extrude(mask, 0.3)


def test_an_empty_page_is_refused(tmp_path: Path) -> None:
    for colour in ("white", "black"):
        Image.new("RGB", (40, 30), colour).save(tmp_path / "empty.png")
        with pytest.raises(InputError, match="no silhouette"):
            read_silhouette(tmp_path / "empty.png")

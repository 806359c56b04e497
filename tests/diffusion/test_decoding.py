"""How many views are decoded for baking."""

import json
from pathlib import Path

import pytest

from pipeline.diffusion.decoding import views_to_decode


@pytest.mark.parametrize(
    ("described", "expected"), [({"image_size": 128}, 24), ({"image_size": 512}, 10), ({}, 10), (None, 10)]
)
def test_large_pictures_are_few(described: dict[str, int] | None, expected: int, tmp_path: Path) -> None:
    """A folder that says nothing is taken for Stable Diffusion's."""
    path = None
    if described is not None:
        path = tmp_path / "bundle.json"
        path.write_text(json.dumps(described))
    assert views_to_decode(24, 10, path) == expected
    assert views_to_decode(6, 10, path) == 6

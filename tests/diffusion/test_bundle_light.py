"""The light that a bundle names."""

import json
from pathlib import Path

import numpy as np
import pytest

from export.everyday_objects.data.render import TOWARDS
from pipeline.diffusion.bundle import training_light
from pipeline.errors import InputError
from pipeline.options.models import MODELS


def test_the_default_bundle_names_the_light_of_its_pictures(tmp_path: Path) -> None:
    found = training_light(MODELS / "everyday-objects" / "bundle.json")
    assert found is not None
    np.testing.assert_allclose(found, TOWARDS, atol=1e-4)
    assert training_light(None) is None
    path = tmp_path / "bundle.json"
    path.write_text("{}")
    assert training_light(path) is None
    path.write_text(json.dumps({"light": [1, 0]}))
    with pytest.raises(InputError, match="light, expected 3 numbers"):
        training_light(path)

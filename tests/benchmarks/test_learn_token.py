"""What a token is taught from: shapes that the model has not seen, in the colours that are said."""

import numpy as np
import pytest

from benchmarks import _scenes as scenes
from benchmarks.learn_token import OBJECTS, shown, unseen
from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.pictures import variant
from pipeline.cameras import orbit_camera


@pytest.mark.parametrize("noun", OBJECTS)
def test_objects_are_of_no_trained_shape_and_dressed_as_said(noun: str) -> None:
    thing, looks = unseen(noun)
    number, kind = list(BY_WORD).index(noun), BY_WORD[noun]
    for seed in range(kind.variants):
        trained = variant(number, seed).shape.vertices
        assert trained.shape != thing.shape.vertices.shape or not np.allclose(trained, thing.shape.vertices)
    roles = {paint.role for paint in thing.shape.paints}
    look, main = OBJECTS[noun], next(iter(kind.roles))
    assert {main, *look.parts} <= roles
    assert {look.colour, *look.parts.values()} <= set(COLOURS)
    first = next(i for i, paint in enumerate(thing.shape.paints) if paint.role == main)
    part = next(i for i, paint in enumerate(thing.shape.paints) if paint.role in look.parts)
    assert np.abs(looks.colours[first] - looks.colours[part]).max() > 0.3


def test_they_are_shown_over_the_scenes_grey() -> None:
    picture = shown(*unseen("chair"), orbit_camera(0.3, 1.3, 2.5, 0.7))
    assert picture.shape == (128, 128, 3)
    assert picture.dtype == np.uint8
    assert (picture[0] == round(255 * scenes.GREY)).all()
    assert (picture != picture[0, 0]).any(-1).mean() > 0.05

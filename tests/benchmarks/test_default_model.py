"""The default model's benchmark: what is asked, and how answers are counted."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks import _scenes, default_model
from benchmarks.default_model import (
    PROMPTS,
    Asked,
    asked_for,
    contact_sheet,
    draw_prompts,
    judge_flat,
    thumbnails,
)
from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.materials import MATERIALS
from export.everyday_objects.networks.judge import KINDS, MADE_OF, SIDES


@pytest.mark.parametrize(
    ("prompt", "kind", "colour", "material"),
    [
        ("a red chair", "chair", "red", None),
        ("an orange armchair", "armchair", "orange", None),
        ("a fire truck", "fire truck", None, None),
        ("a blue striped sofa", "sofa", "blue", "striped"),
        ("a red and white striped sofa", "sofa", None, "striped"),
        ("a house made of bricks", "house", None, "brick"),
        ("a golden owl", "owl", None, "golden"),
        ("a purple vase with flowers", "vase with flowers", "purple", None),
    ],
)
def test_a_prompt_names_kind_colour_and_material(prompt, kind, colour, material) -> None:
    expected = Asked(
        KINDS.index(kind),
        COLOURS.index(colour) if colour else -1,
        MADE_OF.index(material) if material else -1,
    )
    assert asked_for(prompt) == expected


def test_a_prompt_without_a_kind_is_named() -> None:
    with pytest.raises(ValueError, match="a red contraption"):
        asked_for("a red contraption")


def test_meshes_are_asked_for_in_every_material() -> None:
    wanted = [asked_for(prompt) for prompt in PROMPTS]
    assert len(set(PROMPTS)) == 32
    assert len({w.kind for w in wanted}) == len(wanted)
    assert {MADE_OF[w.material] for w in wanted if w.material >= 0} == set(MATERIALS)
    assert len({w.colour for w in wanted}) >= 9
    assert not set(PROMPTS) & set(_scenes.PROMPTS)
    assert all(asked_for(prompt).kind >= 0 for prompt in _scenes.PROMPTS)


def test_every_kind_is_painted_twice_once_in_a_colour() -> None:
    prompts = draw_prompts()
    wanted = [asked_for(prompt) for prompt in prompts]
    assert prompts == draw_prompts()
    assert [w.kind for w in wanted] == list(np.repeat(np.arange(len(KINDS)), 2))
    assert all(w.colour == -1 for w in wanted[::2])
    assert all(w.colour >= 0 for w in wanted[1::2])
    assert {MADE_OF[w.material] for w in wanted if w.material >= 0} == set(MATERIALS)
    assert len({w.colour for w in wanted}) == len(COLOURS) + 1
    assert all(prompt.startswith("an ") == (prompt.split(" ", 1)[1][0] in "aeiou") for prompt in prompts)


def test_the_views_of_a_prompt_are_judged_together_and_two_faces_are_counted(tmp_path, monkeypatch) -> None:
    """Half of the views alone would be wrong about the kind; the mean of four is right."""
    prompts = ["a red horse", "a striped cat", "a blue ball", "a desk"]
    wanted = [asked_for(prompt) for prompt in prompts]
    named = [w.kind for w in wanted[:3]] + [KINDS.index("table")]  # a desk is a table
    images = np.random.default_rng(0).uniform(0, 1, (4, 4, 128, 128, 3)).astype(np.float32)
    monkeypatch.setattr(default_model, "draw_prompts", lambda: prompts)
    monkeypatch.setattr(default_model, "paint_pictures", lambda bundle, texts: images)

    def judge_images(judge, flat):
        assert flat.shape == (16, 128, 128, 3)
        kinds = np.zeros((16, len(KINDS) + 1))
        colours, materials = np.zeros((16, len(COLOURS))), np.zeros((16, len(MADE_OF)))
        for i in range(16):
            kinds[i, named[i // 4]] = 0.6 if i % 2 else 0.3
            kinds[i, -1] = 0.1 if i % 2 else 0.5
            colours[i, COLOURS.index("red")] = 1  # wrong for the ball
            materials[i, MADE_OF.index("striped")] = 1
        return kinds, colours, materials

    def judge_sides(judge, flat):
        sides = np.zeros((16, len(SIDES)))
        fronts = np.arange(16) % 4 == 0
        fronts[2] = True  # the horse's back
        fronts[10] = True  # the ball's, which has none
        sides[np.arange(16), np.where(fronts, 0, 1)] = 1
        return sides

    monkeypatch.setattr(default_model, "judge_images", judge_images)
    monkeypatch.setattr(default_model, "judge_sides", judge_sides)
    summary, table = judge_flat(None, None, tmp_path)
    assert summary["noun_top1_2d"] == 1
    assert summary["colour_top1_2d"] == 0.5
    assert summary["nouns"] == 4
    assert summary["back_as_front_2d"] == pytest.approx(1 / 3, abs=1e-3)
    assert [BY_WORD[k].front for k in ("horse", "cat", "ball", "desk")] == [True, True, False, True]
    assert table["material_top1_2d"] == 1
    assert (tmp_path / "default-model-2d.png").is_file()


def test_sheets_hold_every_strip_at_its_size(tmp_path: Path) -> None:
    images = np.zeros((4, 128, 128, 3), np.float32)
    images[1] = 1
    small = thumbnails(images)
    assert small.shape == (4, 64, 64, 3)
    assert [int(image.mean()) for image in small] == [0, 255, 0, 0]
    contact_sheet(tmp_path / "sheet.png", [("a", small), ("b", small), ("c", small)], 2)
    page = np.asarray(Image.open(tmp_path / "sheet.png"))
    assert page.shape == (2 * 82, 2 * 264, 3)
    assert (page[16:80, 64:128] == 255).all()
    assert (page[16:80, 128:256] == 0).all()

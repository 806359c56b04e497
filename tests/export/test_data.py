"""The default model's objects, their looks, captions and pictures: sound, and what captions say is there."""

import numpy as np
import pytest
import torch

from export.everyday_objects.data.captions import caption, example_texts, known_words, seen_from
from export.everyday_objects.data.colours import COLOURS, PALETTE, draw_colour
from export.everyday_objects.data.kinds import BY_WORD, KINDS
from export.everyday_objects.data.looks import FIRST_COLOUR, Look, draw_look, dress, say
from export.everyday_objects.data.materials import MATERIALS, paint_at
from export.everyday_objects.data.pictures import VIEWS, draw_object, look_of, look_row, write_shard
from export.everyday_objects.data.render import drawable, render
from export.everyday_objects.data.shapes import (
    RADIUS,
    Limb,
    Lump,
    assemble,
    blend,
    box,
    ellipsoid,
    extrude,
    role,
    tube,
    turned,
)
from export.everyday_objects.networks.autoencoder import Encoder
from pipeline.cameras import orbit_camera
from pipeline.diffusion.tokenizer import unknown_words
from pipeline.mesh.rasterize import rasterize

CAMERA = orbit_camera(0.5, 1.2, 2.5, 0.69)
GREY = np.full(3, 0.5, np.float32)


@pytest.mark.parametrize("kind", KINDS, ids=lambda k: k.words[0])
def test_every_kind_is_sound(kind):
    """A variant lies in the ball, has few faces, and the roles that the table names."""
    shape = assemble(kind.make(np.random.default_rng(1)))
    assert np.isfinite(shape.vertices).all()
    assert np.isclose(np.linalg.norm(shape.vertices, axis=1).max(), RADIUS, atol=1e-5)
    assert 0 <= shape.faces.min() <= shape.faces.max() < len(shape.vertices)
    assert len(shape.faces) <= 40_000
    roles = {p.role for p in shape.paints} - {""}
    assert next(iter(kind.roles)) in roles
    assert roles <= set(kind.roles)
    assert set(kind.said) <= set(kind.roles)
    assert all("{}" in words for words in kind.said.values())
    assert all(name in PALETTE for names in kind.roles.values() for name in names)


def test_words_of_kinds_are_their_own():
    words = [w for k in KINDS for w in k.words]
    assert len(words) == len(set(words))


def test_a_variant_is_the_same_every_time():
    for name in ("horse", "house"):
        first, second = (assemble(BY_WORD[name].make(np.random.default_rng(3))) for _ in range(2))
        np.testing.assert_array_equal(first.vertices, second.vertices)


def test_parts_have_the_sizes_they_are_asked_for():
    paint = role("body")
    assert np.ptp(box((1, 2, 3), paint).vertices, axis=0) == pytest.approx([1, 2, 3])
    assert np.ptp(ellipsoid((1, 2, 3), paint).vertices, axis=0) == pytest.approx([2, 4, 6], rel=0.02)
    plate = extrude([(0, 0), (1, 0), (1, 1), (0.5, 0.2), (0, 1)], 0.1, paint)
    assert np.ptp(plate.vertices, axis=0) == pytest.approx([1, 1, 0.1])
    assert turned(box((1, 2, 3), paint), 0, np.pi / 2).vertices[:, 1].max() == pytest.approx(1.5)
    assert tube([(0, 0, 0), (0, 0, 1)], 0.2, paint).vertices[:, 0].max() == pytest.approx(0.2, rel=0.05)


def test_a_blend_is_near_its_pieces():
    skin = blend(
        [Limb((0, 0, 0), (0, 1, 0), 0.2, 0.1), Lump((0, 0, 0), (0.3, 0.3, 0.3))], role("body"), 0.02, 0.02
    )
    assert skin.vertices[:, 1].max() == pytest.approx(1.1, abs=0.02)
    assert skin.vertices[:, 0].max() == pytest.approx(0.3, abs=0.02)


def test_what_nothing_says_mostly_has_its_first_natural_colour():
    kind = BY_WORD["duck"]
    role = next(iter(kind.roles))
    kind = kind._replace(roles={**kind.roles, role: ("red", "blue")})
    shape = assemble(kind.make(np.random.default_rng(2)))
    row = next(i for i, paint in enumerate(shape.paints) if paint.role == role)
    drawn = [dress(np.random.default_rng(i), kind, shape, Look()).colours[row].argmax() for i in range(400)]
    assert np.mean(np.array(drawn) == 0) == pytest.approx(FIRST_COLOUR + (1 - FIRST_COLOUR) / 2, abs=0.05)


def test_pictures_show_the_silhouette_and_the_backdrop():
    kind = BY_WORD["duck"]
    shape = assemble(kind.make(np.random.default_rng(2)))
    looks = dress(np.random.default_rng(0), kind, shape, Look())
    background = np.array([0.2, 0.4, 0.6], np.float32)
    picture = render(drawable(shape), looks, CAMERA, 64, background)
    mask = rasterize(CAMERA, shape.vertices, shape.faces, 64).mask
    empty = np.all(np.isclose(picture, background, atol=1e-6), axis=-1)
    assert (empty == mask).mean() < 0.06  # they may agree only along the anti-aliased rim


def test_what_a_caption_names_is_painted():
    kind = BY_WORD["house"]
    shape = assemble(kind.make(np.random.default_rng(0)))
    looks = dress(np.random.default_rng(0), kind, shape, Look("red", parts={"roof": "blue"}))
    for paint, colour in zip(shape.paints, looks.colours, strict=True):
        if paint.role == next(iter(kind.roles)):
            assert colour.argmax() == 0
        elif paint.role == "roof":
            assert colour.argmax() == 2
    steel = dress(np.random.default_rng(0), kind, shape, Look(material=MATERIALS["steel"]))
    assert {int(c) for c in steel.codes} == {0, MATERIALS["steel"].code}


@pytest.mark.parametrize("material", MATERIALS.values(), ids=lambda m: m.adjective)
def test_materials_have_contrast_and_stay_colours(material):
    rng = np.random.default_rng(0)
    points, normals = rng.uniform(-0.5, 0.5, (2, 600, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    base, other = material.colour or (0.8, 0.1, 0.1), material.other
    seen = np.array(
        [paint_at(material.code, *p, *n, *base, *other) for p, n in zip(points, normals, strict=True)]
    )
    assert seen.min() >= 0
    assert seen.max() <= 1.35  # light and rounding cut it off at 1
    assert seen.std(axis=0).max() > 0.05


def test_sayings():
    rng = np.random.default_rng(0)
    kind = BY_WORD["house"]._replace(words=("house",))
    texts = {say(rng, kind, Look("red", parts={"roof": "blue"})) for _ in range(20)}
    assert texts <= {f"{a}red house with {kind.said['roof'].format('blue')}" for a in ("a ", "")}
    assert {say(rng, kind, Look(material=MATERIALS["lego"])) for _ in range(40)} == {
        "a lego house", "lego house", "a house made of lego", "house made of lego",
    }  # fmt: skip
    assert say(rng, kind, Look("red", "white", material=MATERIALS["striped"])).endswith(
        "red and white striped house"
    )


def test_captions_use_known_words_and_name_the_view():
    known = frozenset(known_words())
    assert not [text for text in example_texts(1500) if unknown_words(text, known)]
    assert seen_from("a chair", np.pi, 1.3) == "a chair, back view"
    rng = np.random.default_rng(0)
    assert caption(np.random.default_rng(5), KINDS[0], Look("red")) == caption(
        np.random.default_rng(5), KINDS[0], Look("red")
    )
    looks = [draw_look(rng, KINDS[0], KINDS[0].roles) for _ in range(400)]
    assert {look.colour for look in looks} == {"", *COLOURS}
    assert {look.material.adjective for look in looks if look.material} == set(MATERIALS)


def test_only_parts_that_are_there_are_named():
    kind = next(k for k in KINDS if k.said)
    looks = [draw_look(np.random.default_rng(i), kind, [next(iter(kind.roles))]) for i in range(200)]
    assert not any(look.parts or (look.second and not look.material) for look in looks)


def test_looks_survive_json():
    for look in (
        Look(),
        Look("red", "white"),
        Look("red", parts={"roof": "blue"}),
        Look(material=MATERIALS["steel"]),
    ):
        assert look_of(look_row(look)) == look


def test_objects_repeat_with_their_seed_and_held_out_shapes_are_others():
    first, second = (draw_object(np.random.default_rng(1), size=16, views=2) for _ in range(2))
    assert first[0] == second[0]
    np.testing.assert_array_equal(first[2], second[2])
    row, _, _ = draw_object(np.random.default_rng(1), held_out=True, size=16, views=1)
    assert row[1] >= BY_WORD[row[0]].variants


def test_shards_hold_views_around_objects(tmp_path, monkeypatch):
    monkeypatch.setattr("export.everyday_objects.data.pictures.OBJECTS", 2)
    torch.manual_seed(0)
    write_shard(tmp_path, 7, Encoder().eval())
    latents = np.load(tmp_path / "00007.npy")
    assert latents.shape == (2, VIEWS, 4, 32, 32)
    with np.load(tmp_path / "00007.npz") as said:
        turns = np.diff(said["cameras"][:, :, 0], axis=1) % (2 * np.pi)
        assert said["backdrops"].shape == (2, VIEWS, 4)
    assert turns.max() < 2 * 2 * np.pi / VIEWS
    # the corner shows the backdrop
    with np.load(tmp_path / "00007.npz") as said:
        np.testing.assert_allclose(latents[:, :, :, 0, 0], said["backdrops"], atol=0.02)


def test_colours_are_what_their_words_say():
    rng = np.random.default_rng(0)
    assert all(draw_colour(rng, name).min() >= 0 and draw_colour(rng, name).max() <= 1 for name in COLOURS)
    assert draw_colour(rng, "red").argmax() == 0
    assert np.ptp(draw_colour(rng, "grey")) < 0.03

import pytest

from pipeline.mesh.materials import MATERIALS, PLAIN, material_of, mtl_text, object_name


@pytest.mark.parametrize(
    ("prompt", "word"),
    [
        ("a red armchair", ""),
        ("a Golden crown on a wooden stand", "golden"),
        ("a golden retriever", ""),
        ("a rubber duck", "rubber"),
        ("an ironing board", ""),
        ("a chair, wooden", "wooden"),
    ],
)
def test_the_first_word_that_is_a_material_decides(prompt: str, word: str) -> None:
    material, found = material_of(prompt, False)
    assert found == word
    assert material == (MATERIALS[word] if word else PLAIN)
    assert material_of(prompt, True)[0] == material._replace(unlit=True)


def test_factors_are_what_gltf_allows() -> None:
    for material in MATERIALS.values():
        assert 0 < material.roughness <= 1
        assert material.metallic in (0, 1)


@pytest.mark.parametrize(
    ("prompt", "name"),
    [
        ("a red armchair", "red_armchair"),
        ("The  big, *blue* house!", "big_blue_house"),
        ("ein roter Stuhl é", "ein_roter_stuhl_é"),
        ("a", "a"),
        ("🪑 ../..", "asset"),
        ("red " * 100, "_".join(["red"] * 12)),
    ],
)
def test_names_are_what_engines_take(prompt: str, name: str) -> None:
    assert object_name(prompt) == name
    assert len(object_name(prompt)) <= 48


def test_an_mtl_file_has_a_material_of_every_name() -> None:
    text = mtl_text(["seat", "legs"], MATERIALS["golden"], "albedo.png", "normal.png")
    assert [line for line in text.splitlines() if line.startswith("newmtl")] == ["newmtl seat", "newmtl legs"]
    assert text.count("map_Kd albedo.png") == text.count("norm normal.png") == text.count("illum 2") == 2
    assert "Pm 1" in text
    assert "Ns 244.9" in text  # 2 / 0.3^4 - 2
    unlit = mtl_text(["all"], PLAIN._replace(unlit=True), "albedo.png")
    assert "illum 0" in unlit
    assert "Ks 0 0 0" in unlit

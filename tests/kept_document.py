"""What a painted glTF document must have kept of the one that was given: all but colours."""

from typing import Any

import numpy as np

from pipeline.mesh.gltf_document import Document

COLOURS = {"TEXCOORD_0", "TEXCOORD_1", "COLOR_0", "_COLOR_0"}


def assert_kept(before: Document, after: Document) -> None:
    """See that all but texture coordinates, images and materials is equal, numbers to the bit."""
    for name in ("asset", "scene", "scenes", "cameras", "nodes"):
        assert after.json[name] == before.json[name], name
    for old, new in zip(before.json["skins"], after.json["skins"], strict=True):
        assert {**old, "inverseBindMatrices": 0} == {**new, "inverseBindMatrices": 0}
        assert_same(before, old["inverseBindMatrices"], after, new["inverseBindMatrices"])
    for old, new in zip(before.json["animations"], after.json["animations"], strict=True):
        assert [old["name"], old["channels"]] == [new["name"], new["channels"]]
        for one, other in zip(old["samplers"], new["samplers"], strict=True):
            assert {**one, "input": 0, "output": 0} == {**other, "input": 0, "output": 0}
            for key in ("input", "output"):
                assert_same(before, one[key], after, other[key])
    for old, new in zip(before.json["meshes"], after.json["meshes"], strict=True):
        assert {**old, "primitives": 0} == {**new, "primitives": 0}
        for one, other in zip(old["primitives"], new["primitives"], strict=True):
            assert_primitive(before, one, after, other)


def assert_same(before: Document, row: int, after: Document, other: int) -> None:
    np.testing.assert_array_equal(before.elements(row), after.elements(other), strict=True)
    old, new = (
        {k: v for k, v in d.json["accessors"][r].items() if k not in ("bufferView", "byteOffset", "sparse")}
        for d, r in ((before, row), (after, other))
    )
    assert old == new


def assert_primitive(before: Document, one: dict[str, Any], after: Document, other: dict[str, Any]) -> None:
    assert one.get("extras") == other.get("extras")
    assert one.get("mode", 4) == other.get("mode", 4)
    groups = [(one["attributes"], other["attributes"])]
    groups += list(zip(one.get("targets", []), other.get("targets", []), strict=True))
    corners = [
        np.arange(d.json["accessors"][p["attributes"]["POSITION"]]["count"])
        if "indices" not in p
        else d.elements(p["indices"])[:, 0].astype(int)
        for d, p in ((before, one), (after, other))
    ]
    for old, new in groups:
        assert set(old) - COLOURS == set(new) - COLOURS
        for name in set(old) - COLOURS:
            first, second = before.elements(old[name]), after.elements(new[name])
            np.testing.assert_array_equal(second[: len(first)], first, strict=True)  # in their places
            # every corner of every triangle has the very numbers that it had
            np.testing.assert_array_equal(second[corners[1]], first[corners[0]], strict=True)

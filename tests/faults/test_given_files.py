"""Files of strangers: refused in one line that names them as they were typed, within seconds."""

import pytest

from tests.faults import hostile
from tests.faults.door import Door

MESHES, DRAWINGS, TOKENS = hostile.MESHES, hostile.DRAWINGS, hostile.TOKENS


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh(door: Door, name: str) -> None:
    make, words = MESHES[name]
    (door.given / name).write_bytes(make())
    door.refused("plan", f"given/{name}", words, MESH=f"given/{name}")


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_drawing(door: Door, name: str) -> None:
    make, words = DRAWINGS[name]
    (door.given / name).write_bytes(make())
    door.refused("plan", f"given/{name}", words, SKETCH=f"given/{name}")


@pytest.mark.parametrize("name", TOKENS)
def test_a_token(door: Door, name: str) -> None:
    make, words = TOKENS[name]
    (door.given / name).write_bytes(make())
    door.refused("plan", f"given/{name}", words, TOKEN=f"given/{name}")


STARTS = ("nan.obj", "cut.stl", "claims.gltf", "past.glb", "readme.md")


@pytest.mark.parametrize("name", STARTS)
def test_a_start(door: Door, name: str) -> None:
    make, words = MESHES[name]
    (door.given / name).write_bytes(make())
    door.refused("plan", f"given/{name}", words, START=f"given/{name}")


def test_a_start_that_its_stage_refuses(door: Door) -> None:
    """Named as it was typed: a run of a stranger, and a mesh without colours."""
    stranger = door.given / "stranger"
    stranger.mkdir()
    (stranger / "job.yaml").write_text(f"prompt: x\nmodel: {door.folder / 'model'}\n")
    (stranger / "field.npz").write_bytes(hostile.packed(bytes(10_000_000)))
    assert door.refused("run", START="given/stranger").startswith(
        "error: given/stranger/field.npz is no scene"
    )
    (door.given / "plain.ply").write_bytes(hostile.ball("ply"))
    assert door.refused("run", START="given/plain.ply").startswith("error: given/plain.ply has no colours")


@pytest.mark.parametrize("name", ["thin.obj", "apart.obj"])
def test_a_mesh_that_its_stage_refuses(door: Door, name: str) -> None:
    make, words = hostile.UNPAINTABLE[name]
    (door.given / name).write_bytes(make())
    said = door.refused("run", words, MESH=f"given/{name}")
    assert said.startswith(f"error: given/{name}: "), "as it was typed, not as the stage sees it"


def test_run_refuses_what_plan_refuses(door: Door) -> None:
    (door.given / "nan.obj").write_bytes(MESHES["nan.obj"][0]())
    (door.given / "nested.svg").write_bytes(DRAWINGS["nested.svg"][0]())
    mesh, sketch = {"MESH": "given/nan.obj"}, {"SKETCH": "given/nested.svg"}
    assert door.refused("run", **mesh) == door.refused("plan", **mesh)
    assert door.refused("run", **sketch) == door.refused("plan", **sketch)


@pytest.mark.parametrize("name", hostile.ENDLESS)
def test_a_filter_without_end(name: str, tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pipeline.errors import InputError
    from pipeline.sketch import svg

    path = tmp_path / "a.svg"
    path.write_bytes(hostile.svg(f'<filter id="f">{hostile.ENDLESS[name]}</filter><rect filter="url(#f)"/>'
                                 '<rect filter="url(#f)" width="50" height="50"/>'))  # fmt: skip
    monkeypatch.setattr(svg, "WAITING_SECONDS", 1)  # the processor time is not ours to shorten
    with pytest.raises(InputError, match="cannot be drawn within"):
        svg.svg_to_png(path, 512)


def test_a_drawing_is_drawn_without_any_other_file(door: Door) -> None:
    """What the check of references might miss, the process that draws cannot open."""
    import subprocess
    import sys

    code = "import sys; from pipeline.sketch import svg; svg.fault = lambda drawing: ''; svg.main(64)"
    (door.given / "other.png").write_bytes(hostile.png(8, 8))
    drawing = hostile.svg(f'<image href="{door.given / "other.png"}" width="99" height="99"/>')
    picture = subprocess.run(
        [sys.executable, "-c", code], input=drawing, capture_output=True, env=door.environment(), check=True
    ).stdout
    empty = subprocess.run(
        [sys.executable, "-c", code],
        input=hostile.svg(""),
        capture_output=True,
        env=door.environment(),
        check=True,
    ).stdout
    assert picture == empty

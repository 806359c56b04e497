"""The extension in a Blender without a window: PyPI's bpy, in an environment of its own.

    python3.11 -m venv build/bpy && build/bpy/bin/pip install bpy
    build/bpy/bin/python integrations/blender/test_headless.py . build/bpy

The first argument is the program or a clone, the second a folder to work in. Paints a shape of Blender's own
with a prompt, makes one from a sketch, and writes a rendered picture of what was imported.
"""

import sys
import time
from pathlib import Path

import bpy

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))


def wait(module, seconds: float) -> list:
    """Do what Blender's timer does until the job has ended; return the imported objects."""
    deadline = time.monotonic() + seconds
    while module.tick() is not None:
        assert time.monotonic() < deadline, module._running
        time.sleep(0.2)
    assert "made" in module._running, module._running["message"]
    return [bpy.data.objects[name] for name in module._running.pop("made")]


def textures(one) -> list:
    """Return the pictures in the materials of an object."""
    trees = [slot.material.node_tree for slot in one.material_slots if slot.material]
    return [node.image for tree in trees for node in tree.nodes if node.type == "TEX_IMAGE" and node.image]


def render(path: Path) -> None:
    """Render what is selected, in the sun."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.device, scene.cycles.use_denoising = 16, "CPU", False
    scene.render.resolution_x = scene.render.resolution_y = 384
    scene.render.filepath = str(path)
    scene.view_settings.view_transform = "Standard"
    world = scene.world or bpy.data.worlds.new("world")
    scene.world, world.color = world, (0.8, 0.8, 0.8)
    bpy.ops.object.light_add(type="SUN", rotation=(0.6, 0.2, 0.8))
    bpy.context.object.data.energy = 3
    bpy.ops.object.camera_add(location=(1.2, -4.6, 1.2), rotation=(1.33, 0, 0.25))
    scene.camera = bpy.context.object
    bpy.ops.render.render(write_still=True)


def main(program: str, folder: Path) -> None:
    """Do as a user would, and look at what comes."""
    import addon_utils  # it is there when bpy is

    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon_utils.enable("io_scene_gltf2")
    module = addon_utils.enable("latent_nerf", default_set=True)
    assert module is not None, "the extension does not load"
    chosen = bpy.context.preferences.addons["latent_nerf"].preferences
    chosen.program, chosen.runs = program, str(folder / "runs")
    asked = bpy.context.scene.latent_nerf

    asked.use = "MESH"
    try:
        bpy.ops.latent_nerf.make()
        raise AssertionError("made something of nothing")
    except RuntimeError as error:
        assert "select a mesh" in str(error)
    bpy.ops.mesh.primitive_monkey_add()
    source = bpy.context.object
    asked.prompt, asked.quality = "a brown bear", "draft"
    began = time.monotonic()
    assert bpy.ops.latent_nerf.make() == {"FINISHED"}
    assert not bpy.ops.latent_nerf.make.poll(), "one at a time"
    (painted,) = [one for one in wait(module, 900) if one.type == "MESH"]
    print(f"painted in {time.monotonic() - began:.0f} s: {painted.name}, {len(painted.data.polygons)} faces")
    assert painted.name == "a brown bear"
    triangles = sum(len(face.vertices) - 2 for face in source.data.polygons)
    assert len(painted.data.polygons) == triangles
    for axis in range(3):
        own = [(source.matrix_world @ v.co)[axis] for v in source.data.vertices]
        got = [(painted.matrix_world @ v.co)[axis] for v in painted.data.vertices]
        assert abs(min(own) - min(got)) < 1e-4, "it does not stand where it stood"
        assert abs(max(own) - max(got)) < 1e-4
    (picture,) = textures(painted)
    assert picture.size[0] >= 512
    source.hide_render = True
    render(folder / "painted.png")

    # A job that is cancelled says so, and nothing comes into the scene.
    asked.use, asked.prompt = "NONE", "a blue mug"
    count = len(bpy.data.objects)
    bpy.ops.latent_nerf.make()
    time.sleep(2)
    bpy.ops.latent_nerf.cancel()
    deadline = time.monotonic() + 120
    while module.tick() is not None:
        assert time.monotonic() < deadline
        time.sleep(0.2)
    assert module._running["message"].startswith("cancelled")
    assert len(bpy.data.objects) == count

    chosen.program = str(folder / "nowhere")
    try:
        bpy.ops.latent_nerf.make()
        raise AssertionError("started what is not there")
    except RuntimeError as error:
        assert "is not there" in str(error)
    addon_utils.disable("latent_nerf")
    print(f"all good; look at {folder / 'painted.png'}")


if __name__ == "__main__":
    main(str(Path(sys.argv[1]).resolve()), Path(sys.argv[2]).resolve())

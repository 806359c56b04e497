"""Latent-NeRF for Blender: a panel that asks, watches, and puts the asset into the scene.

The work is done by the program latent-nerf in a process of its own; Blender stays free meanwhile. See
       README.md
beside this folder.
"""

import hashlib
import tempfile
from pathlib import Path

import bpy

from .job import Job, ProgramMissing, program_command

_running: dict[str, object] = {}
"""The job that runs and what it is for; one at a time."""
INTERVAL = 0.5
"""Between two looks at the job [seconds]."""


class Preferences(bpy.types.AddonPreferences):
    """Where the program is, and where runs are kept."""

    bl_idname = __package__

    program: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="latent-nerf",
        description="The program, or a clone of its repository; empty: what PATH has",
        subtype="FILE_PATH",
    )
    runs: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Runs",
        description="The folder that runs are kept in",
        subtype="DIR_PATH",
        default=str(Path.home() / "latent-nerf-runs"),
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Show the two paths."""
        self.layout.prop(self, "program")
        self.layout.prop(self, "runs")


class Settings(bpy.types.PropertyGroup):
    """What the panel asks for."""

    prompt: bpy.props.StringProperty(name="Prompt", default="a red armchair")  # type: ignore[valid-type]
    quality: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Quality",
        items=[
            ("draft", "Draft", "about half the time"),
            ("standard", "Standard", ""),
            ("high", "High", "finer throughout: twice the time"),
        ],
        default="draft",
    )
    seed: bpy.props.IntProperty(name="Seed", min=0, default=0)  # type: ignore[valid-type]
    use: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Selected mesh",
        items=[
            ("NONE", "Not used", "the shape comes from the prompt"),
            ("SKETCH", "As a sketch", "the asset keeps to its shape"),
            ("MESH", "Painted", "it gets new colours; its geometry stays as it is"),
        ],
        default="NONE",
    )
    sigma_s: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Freedom", description="How freely the sketch is followed", min=0.05, max=1.5, default=0.3
    )


def preferences(context: bpy.types.Context) -> Preferences:
    """Return this extension's preferences."""
    return context.preferences.addons[__package__].preferences


def export_selection(context: bpy.types.Context, folder: Path) -> Path:
    """Write the active mesh as OBJ, +Y up and its front to +Z, named after its content; return the file.

    Raises:
        RuntimeError: the active object is no mesh with faces.
    """
    active = context.view_layer.objects.active
    if active is None or active.type != "MESH" or not active.data.polygons:
        raise RuntimeError("select a mesh with faces first")
    folder.mkdir(parents=True, exist_ok=True)
    chosen = list(context.selected_objects)
    for one in chosen:
        one.select_set(False)
    active.select_set(True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        written = Path(scratch) / "mesh.obj"
        try:
            bpy.ops.wm.obj_export(
                filepath=str(written), export_selected_objects=True, export_materials=False,
                forward_axis="NEGATIVE_Z", up_axis="Y",
            )  # fmt: skip
        finally:
            active.select_set(False)
            for one in chosen:
                one.select_set(True)
        # The same mesh is the same job: the comments of the file, its name among them, are left out.
        lines = [
            line
            for line in written.read_text(encoding="utf-8").splitlines()
            if line[:2] in ("v ", "vt", "f ")
        ]
    text = "\n".join(lines) + "\n"
    target = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:16]}.obj"
    target.write_text(text, encoding="utf-8")
    return target


def import_asset(context: bpy.types.Context, asset: Path, name: str) -> list[bpy.types.Object]:
    """Bring an asset into the scene with its material; return its objects, the only ones selected."""
    before = set(bpy.data.objects)
    bpy.ops.import_scene.gltf(filepath=str(asset))
    made = [one for one in bpy.data.objects if one not in before]
    for one in context.view_layer.objects:
        one.select_set(one in made)
    meshes = [one for one in made if one.type == "MESH"]
    for one in meshes:
        one.name = one.data.name = name
    if meshes:
        context.view_layer.objects.active = meshes[0]
    return made


def tick() -> float | None:
    """Look at the job; return when to look again [seconds], or None when it has ended."""
    job = _running.get("job")
    if not isinstance(job, Job):
        return None
    ended = job.poll()
    _running["message"] = job.message
    for window in getattr(bpy.context.window_manager, "windows", []):
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
    if not ended:
        return INTERVAL
    _running.pop("job")
    if job.asset is not None:
        _running["made"] = [one.name for one in import_asset(bpy.context, job.asset, str(_running["name"]))]
        _running["message"] = f"done: {job.asset.parent.name}"
    else:
        _running["message"] = f"it failed: {job.error}" if job.error else "cancelled; Make goes on from there"
    return None


class Make(bpy.types.Operator):
    """Make the asset in the background and put it into the scene."""

    bl_idname = "latent_nerf.make"
    bl_label = "Make"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """One job at a time."""
        return "job" not in _running and bool(context.scene.latent_nerf.prompt.strip())

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start it."""
        asked, chosen = context.scene.latent_nerf, preferences(context)
        runs = Path(bpy.path.abspath(chosen.runs)).expanduser()
        variables = {
            "PROMPT": asked.prompt,
            "QUALITY": asked.quality,
            "SEED": str(asked.seed),
            "OUT": str(runs),
        }
        try:
            command = program_command(bpy.path.abspath(chosen.program) if chosen.program else "")
            runs.mkdir(parents=True, exist_ok=True)
            if asked.use != "NONE":
                variables[asked.use] = str(export_selection(context, runs / ".blender"))
            if asked.use == "SKETCH":
                variables["SIGMA_S"] = f"{asked.sigma_s:.4g}"
            _running.update(job=Job(command, variables, runs), name=asked.prompt[:60], message="starting")
        except (ProgramMissing, RuntimeError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        bpy.app.timers.register(tick, first_interval=INTERVAL)
        return {"FINISHED"}


class Cancel(bpy.types.Operator):
    """Stop the job; what it has made stays, and the same goes on from there."""

    bl_idname = "latent_nerf.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Where one runs."""
        return "job" in _running

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Tell it."""
        _running["job"].cancel()
        return {"FINISHED"}


class Panel(bpy.types.Panel):
    """In the sidebar of the 3D view (N)."""

    bl_idname = "VIEW3D_PT_latent_nerf"
    bl_label = "Latent-NeRF"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Latent-NeRF"

    def draw(self, context: bpy.types.Context) -> None:
        """Ask, and show how far it is."""
        asked, layout = context.scene.latent_nerf, self.layout
        layout.use_property_split = True
        for name in ("prompt", "quality", "seed", "use"):
            layout.prop(asked, name)
        if asked.use == "SKETCH":
            layout.prop(asked, "sigma_s")
        job = _running.get("job")
        if isinstance(job, Job):
            layout.progress(factor=job.share, text=job.message)
            layout.operator(Cancel.bl_idname)
        else:
            layout.operator(Make.bl_idname)
            if message := _running.get("message"):
                layout.label(text=str(message))


CLASSES = (Preferences, Settings, Make, Cancel, Panel)


def register() -> None:
    """Called by Blender."""
    for one in CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Scene.latent_nerf = bpy.props.PointerProperty(type=Settings)


def unregister() -> None:
    """Called by Blender; a job that runs is stopped."""
    job = _running.pop("job", None)
    if isinstance(job, Job):
        job.cancel()
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    del bpy.types.Scene.latent_nerf
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)

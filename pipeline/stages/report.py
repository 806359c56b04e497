"""Stage `report`: what was made and how, for a person (report.html) and for a program (manifest.json)."""

import json
from pathlib import Path
from typing import Any

from pipeline.documents import read_json
from pipeline.files import file_sha256
from pipeline.options.job import to_yaml
from pipeline.report.page import Page, render
from pipeline.run.chain import stage_options
from pipeline.run.stage import Context, execute

FILES = {
    "asset.glb": "the asset: mesh and texture in one file (glTF 2.0)",
    "asset_lod1.glb": "a quarter of its faces, with albedo.png and normal.png beside it",
    "asset_lod2.glb": "6 % of its faces, likewise",
    "asset.obj": "the mesh for other programs",
    "asset.mtl": "its material",
    "asset.ply": "the mesh with colours at its vertices and texture coordinates",
    "asset.stl": "the closed surface for printing [mm]",
    "asset.3mf": "the same with colours, for slicers",
    "asset.usdz": "the asset for Apple's viewers and USD",
    "albedo.png": "its texture",
    "normal.png": "its normal map (tangent space, MikkTSpace)",
    "preview.png": "eight views and four normal maps",
    "turntable.mp4": "one turn around the asset",
    "job.yaml": "what was asked for, complete: JOB=job.yaml makes it again",
    "manifest.json": "checksums, options, versions and metrics of every stage",
}


def make_manifest(
    job: dict[str, Any], entries: list[dict[str, Any]], files: dict[str, Path]
) -> dict[str, Any]:
    """Return the manifest: the job's short facts, every stage's entry, and size and sha256 of every file.

    `files` maps names relative to the run's folder to where the bytes are now.
    """
    return {
        "format": 1,
        "job": job,
        "seconds": round(sum(entry["seconds"] for entry in entries), 3),
        "peak_memory_mb": max(entry["peak_memory_mb"] for entry in entries),
        "stages": entries,
        "files": {
            name: {"bytes": path.stat().st_size, "sha256": file_sha256(path)}
            for name, path in sorted(files.items())
        },
    }


def main(context: Context) -> None:
    """Read the entries of all stages; write the page and the manifest."""
    inputs, outputs = context.inputs, context.outputs
    preview, turntable = inputs["preview"], inputs["turntable"]
    paths = {name: path for name, path in inputs.items() if path.suffix == ".json"}
    entries = [read_json(path, "delete it and run again") for path in paths.values()]
    facts = stage_options(context.job, "report")

    made = [Path(output["path"]) for entry in entries for output in entry["outputs"].values()]
    files = {path.as_posix(): path for path in [Path("job.yaml"), *made, *paths.values()]}
    page = Page(
        prompt=facts["prompt"],
        negative=facts["negative"],
        facts={
            **{name: Path(facts[name]).name for name in ("sketch", "mesh", "start") if facts[name]},
            **{name: str(facts[name]) for name in ("model", "quality", "seed")},
        },
        entries=entries,
        preview_png=preview.read_bytes(),
        turntable_mp4=turntable.read_bytes(),
        asset_glb=inputs["glb"].read_bytes(),
        links=[
            (name, what, files[name].stat().st_size if name in files else None)
            for name, what in FILES.items()
            if name in files or name == outputs["manifest"].name
        ],
        job_yaml=to_yaml(context.job),
        contest_png=inputs["contest_sheet"].read_bytes() if "contest_sheet" in inputs else None,
    )
    outputs["report"].write_text(render(page), encoding="utf-8")
    manifest = make_manifest(facts, entries, files | {outputs["report"].name: outputs["report"]})
    outputs["manifest"].write_text(
        json.dumps(manifest, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
    )


if __name__ == "__main__":
    execute("report", main)

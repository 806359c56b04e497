"""The judgement of a chain without running it."""

import json
from pathlib import Path

import pytest

from pipeline.files import file_sha256
from pipeline.options.asset import Bake, Clean, Extract
from pipeline.options.job import Job
from pipeline.options.nerf import Refinement, SketchField, TrainNerf
from pipeline.run import staleness
from pipeline.run.chain import STAGES, stage_options, stages_of
from pipeline.run.estimate import estimate, machine_pace
from pipeline.run.plan import make_plan
from pipeline.run.snakefiles import Link, read_chain

TEXT_STAGES = ["embed", "train_nerf", "extract", "clean", "unwrap", "bake", "publish", "report"]
JOB = Job(prompt="a red ball")
CHAIN = [
    Link("extract", {"scene": "../field.npz"}, {"mesh": "mesh_raw.ply"}),
    Link("clean", {"mesh": "mesh_raw.ply"}, {"mesh": "mesh.ply"}),
    Link("report", {"clean": "stages/clean.json"}, {"report": "report.html"}),
]


def make(run: Path, link: Link, job: Job = JOB) -> None:
    """Make a stage's outputs and entry as the stage would."""
    (run / "stages").mkdir(parents=True, exist_ok=True)
    for name, path in link.outputs.items():
        (run / path).write_text(f"{link.stage} {name}")
    inputs = {name: {"path": path, "sha256": file_sha256(run / path)} for name, path in link.inputs.items()}
    options = stage_options(job, link.stage)
    module = f"pipeline.stages.{link.stage}"
    source, versions = staleness.code(module)
    entry = {
        "key": staleness.key(options, module, {name: value["sha256"] for name, value in inputs.items()}),
        "options": options,
        "inputs": inputs,
        "metrics": {},
        "seconds": 1.0,
        "peak_memory_mb": 100.0,
        "outputs": {n: {"path": path, "sha256": file_sha256(run / path)} for n, path in link.outputs.items()},
        "source": source,
        "versions": versions,
    }
    staleness.entry_path(run, link.stage).write_text(json.dumps(entry))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "field.npz").write_text("field")
    for link in CHAIN:
        make(tmp_path / "first", link)
    return tmp_path / "first"


def verdicts(run: Path, job: Job = JOB) -> list[tuple[str, str]]:
    return [(step.verdict, step.reason) for step in make_plan(job, run, CHAIN)]


def test_a_finished_run_is_unchanged(run: Path) -> None:
    assert verdicts(run) == [("unchanged", "")] * 3


def test_a_run_that_does_not_exist_reuses_its_siblings(run: Path) -> None:
    plan = verdicts(run.parent / "second")
    assert plan == [("reuse", "from first"), ("reuse", "from first"), ("run", "after clean")]
    assert not (run.parent / "second").exists()
    (run / "mesh.ply").write_text("broken")
    assert verdicts(run.parent / "second")[1] == ("run", "not made yet")


def test_reasons(run: Path) -> None:
    coarse = Job(prompt="a red ball", extract=Extract(resolution=32))
    assert verdicts(run, coarse) == [
        ("run", "options changed"),
        ("run", "after extract"),
        ("run", "after clean"),
    ]
    small = Job(prompt="a red ball", clean=Clean(faces=100))
    assert verdicts(run, small) == [("unchanged", ""), ("run", "options changed"), ("run", "after clean")]
    (run / "mesh.ply").write_text("")
    assert verdicts(run)[1] == ("run", "mesh.ply is empty")
    make(run, CHAIN[1])
    (run.parent / "field.npz").write_text("another field")
    assert verdicts(run)[0] == ("run", "scene changed")


def test_source_and_versions_are_reasons(run: Path) -> None:
    path = staleness.entry_path(run, "clean")
    entry = json.loads(path.read_text())
    path.write_text(json.dumps({**entry, "key": "other", "source": "other"}))
    assert verdicts(run)[1] == ("run", "source changed")
    path.write_text(json.dumps({**entry, "key": "other", "versions": {"numpy": "0"}}))
    assert verdicts(run)[1] == ("run", "package versions changed")


def test_an_input_that_nothing_makes_must_exist(run: Path) -> None:
    (run.parent / "field.npz").unlink()
    with pytest.raises(FileNotFoundError):
        make_plan(JOB, run, CHAIN)


@pytest.mark.parametrize("present", [True, False])
def test_the_snakefile_is_read_as_it_is(tmp_path: Path, present: bool) -> None:
    bundle = tmp_path / "a {b} model"
    (bundle / "vae_encoder").mkdir(parents=True) if present else bundle.mkdir()
    (bundle / "bundle.json").write_text("{}") if present else None
    chain = read_chain(Job(prompt="x", model=str(bundle)), tmp_path / "runs" / "x")
    assert [link.stage for link in chain] == TEXT_STAGES
    assert ("vae_encoder" in chain[0].inputs) == present
    assert ("description" in chain[0].inputs) == present
    made: set[str] = set()
    for link in chain:
        for path in link.inputs.values():
            assert path in made or path.startswith("../../a {b} model/"), "each after those it depends on"
        made |= {*link.outputs.values(), f"stages/{link.stage}.json"}
    assert {"asset.glb", "report.html", "manifest.json"} <= made
    assert not (tmp_path / "runs").exists()


def test_formats_are_made_of_the_asset_of_either_chain(tmp_path: Path) -> None:
    (tmp_path / "model").mkdir()
    mesh = tmp_path / "fish.obj"
    mesh.write_text("")
    for given in ("", str(mesh)):
        job = Job(prompt="x", model=str(tmp_path / "model"), mesh=given, formats="3mf,usdz")
        links = {link.stage: link for link in read_chain(job, tmp_path / "runs" / "x")}
        assert list(links)[-2:] == ["formats", "report"]
        assert links["formats"].inputs == {"glb": "asset.glb"}
        assert links["formats"].outputs == {"as_3mf": "asset.3mf", "as_usdz": "asset.usdz"}
        assert links["report"].inputs["formats"] == "stages/formats.json"


def test_a_sketch_is_a_stage_of_its_own_and_reaches_the_training(tmp_path: Path) -> None:
    (tmp_path / "model").mkdir()
    mesh = tmp_path / "a house.obj"
    mesh.write_text("")
    job = Job(prompt="x", model=str(tmp_path / "model"), sketch=str(mesh))
    links = {link.stage: link for link in read_chain(job, tmp_path / "runs" / "x")}
    assert list(links) == ["embed", "sketch", *TEXT_STAGES[1:]]
    assert links["sketch"].inputs == {"sketch": "../../a house.obj"}
    assert links["train_nerf"].inputs["sketch"] == "sketch.npz"
    assert links["report"].inputs["sketch"] == "stages/sketch.json"


def test_the_buffers_of_a_gltf_sketch_are_inputs_too(tmp_path: Path) -> None:
    (tmp_path / "model").mkdir()
    (tmp_path / "a.gltf").write_text(json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": "a.bin"}]}))
    (tmp_path / "a.bin").write_bytes(b"numbers")
    job = Job(prompt="x", model=str(tmp_path / "model"), sketch=str(tmp_path / "a.gltf"))
    links = {link.stage: link for link in read_chain(job, tmp_path / "runs" / "x")}
    assert links["sketch"].inputs == {"sketch": "../../a.gltf", "buffer0": "../../a.bin"}


def test_refinement_is_a_stage_and_the_rest_works_on_what_it_makes(tmp_path: Path) -> None:
    for name in ("vae_encoder", "vae_encoder_vjp"):
        (tmp_path / "model" / name).mkdir(parents=True)
    job = Job(prompt="x", model=str(tmp_path / "model"), refine=True)
    links = {link.stage: link for link in read_chain(job, tmp_path / "runs" / "x")}
    assert list(links) == [*TEXT_STAGES[:2], "refine", *TEXT_STAGES[2:]]
    assert links["refine"].inputs["vae_encoder_vjp"] == "../../model/vae_encoder_vjp"
    assert links["refine"].inputs["scene"] == "field.npz"
    assert links["extract"].inputs["scene"] == links["bake"].inputs["scene"] == "field_rgb.npz"
    assert "vae_decoder" not in links["bake"].inputs
    assert links["report"].inputs["refine"] == "stages/refine.json"
    assert "vae_encoder_vjp" not in links["embed"].inputs


@pytest.mark.parametrize("refine", [False, True])
@pytest.mark.parametrize("given", ["", "sketch", "mesh"])
def test_the_stages_are_known_without_asking_snakemake(tmp_path: Path, given: str, refine: bool) -> None:
    for name in ("vae_encoder", "vae_encoder_vjp"):
        (tmp_path / "model" / name).mkdir(parents=True)
    mesh = tmp_path / "a.obj"
    mesh.write_text("")
    job = Job(
        prompt="x", model=str(tmp_path / "model"), refine=refine, **({given: str(mesh)} if given else {})
    )
    assert [stage.name for stage in stages_of(job)] == [
        link.stage for link in read_chain(job, tmp_path / "runs" / "x")
    ]


def test_estimates_grow_with_the_work() -> None:
    base = JOB
    more = {
        "train_nerf": Job(prompt="x", train_nerf=TrainNerf(steps=base.train_nerf.steps * 2)),
        "sketch": Job(prompt="x", sketch_field=SketchField(cells=base.sketch_field.cells * 2)),
        "refine": Job(prompt="x", refinement=Refinement(steps=base.refinement.steps * 2)),
        "extract": Job(prompt="x", extract=Extract(resolution=base.extract.resolution * 2)),
        "clean": Job(prompt="x", clean=Clean(faces=base.clean.faces * 2)),
        "bake": Job(prompt="x", bake=Bake(views=base.bake.views * 2)),
    }
    for stage, job in more.items():
        assert (
            estimate(stage, job, 32, {"unet": 20}).seconds
            > estimate(stage, base, 32, {"unet": 20}).seconds
            > 0
        )
    assert (
        estimate("train_nerf", base, 64, {"unet": 1700}).seconds
        > 20 * estimate("train_nerf", base, 32, {"unet": 20}).seconds
    )
    for stage in STAGES:
        assert estimate(stage, base, 32, {"unet": 20}).memory_mb < 4096


def test_a_large_network_is_seen_in_the_memory_of_the_stages_that_open_it() -> None:
    large = {"unet": 3400.0, "vae_decoder": 200.0, "text_encoder": 490.0, "vae_encoder": 140.0}
    extra = {
        stage: estimate(stage, JOB, 64, large).memory_mb - estimate(stage, JOB, 64, {}).memory_mb
        for stage in ("embed", "train_nerf", "bake", "clean")
    }
    # The text encoder is released before the VAE encoder is opened: the larger of the two counts.
    assert extra == {"embed": 980.0, "train_nerf": 6800.0, "bake": 400.0, "clean": 0.0}
    # Refinement has them open together.
    for stage in ("refine", "refine_paint"):
        more = estimate(stage, JOB, 64, large).memory_mb - estimate(stage, JOB, 64, {}).memory_mb
        assert more == pytest.approx(2 * (3400 + 200 + 140))


def test_a_slower_machine_takes_longer_most_of_all_to_denoise() -> None:
    assert 0.01 < machine_pace() < 1000
    for stage, least, most in (("train_nerf", 2.5, 4), ("clean", 1.999, 2.001)):
        times = [estimate(stage, JOB, 32, {"unet": 200}, pace).seconds for pace in (1.0, 0.25)]
        assert least < times[1] / times[0] < most

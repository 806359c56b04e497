"""One job from many places: precedence, ranges, and errors that name the key."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.options import asset
from pipeline.options import job as jobs
from pipeline.options.job import Job, resolve
from pipeline.options.nerf import TrainNerf
from pipeline.options.quality import QUALITY
from pipeline.options.schema import build, describe


@pytest.fixture
def models(tmp_path: Path) -> Path:
    """Two models: one plain, one that recommends options."""
    (tmp_path / "models" / "plain").mkdir(parents=True)
    (tmp_path / "models" / "tuned").mkdir()
    tuned = {"distillation": {"guidance_scale": 15, "radius": [2, 3], "steps": 77}}
    (tmp_path / "models" / "tuned" / "bundle.json").write_text(json.dumps(tuned))
    return tmp_path / "models"


def write(folder: Path, text: str) -> str:
    path = folder / "job.yaml"
    path.write_text(text)
    return str(path)


def test_each_layer_wins_over_the_one_below(models: Path) -> None:
    base = {"PROMPT": "a cup", "MODEL": "plain"}
    assert resolve(base, models) == Job(prompt="a cup", model="plain")
    draft = resolve({**base, "QUALITY": "draft"}, models)
    assert draft.train_nerf.steps == QUALITY["draft"]["train_nerf"]["steps"] != TrainNerf().steps
    tuned = resolve({**base, "QUALITY": "draft", "MODEL": "tuned"}, models)
    assert (tuned.train_nerf.steps, tuned.train_nerf.guidance_scale, tuned.train_nerf.radius) == (
        77,
        15.0,
        (2.0, 3.0),
    )
    assert tuned.clean.faces == draft.clean.faces, (
        "a section that the model does not mention keeps its quality"
    )
    asked = "prompt: a jug\nseed: 5\nquality: draft\nmodel: tuned\ntrain_nerf: {steps: 9}\n"
    written = resolve({"JOB": write(models, asked)}, models)
    assert (written.prompt, written.seed, written.train_nerf.steps) == ("a jug", 5, 9)
    assert written.train_nerf.guidance_scale == 15.0
    said = resolve({"JOB": write(models, asked), "PROMPT": "a cup", "SEED": "6", "QUALITY": "high"}, models)
    assert (said.prompt, said.seed, said.quality, said.train_nerf.steps) == ("a cup", 6, "high", 9)
    assert said.clean == asset.Clean(**QUALITY["high"]["clean"])


def test_another_quality_for_a_complete_file_is_refused(models: Path) -> None:
    complete = jobs.to_yaml(resolve({"PROMPT": "a jug", "MODEL": "plain", "QUALITY": "draft"}, models))
    file = write(models, complete)
    assert resolve({"JOB": file, "QUALITY": "draft", "SEED": "3"}, models).seed == 3
    with pytest.raises(InputError, match=r"QUALITY=high changes nothing.*draft"):
        resolve({"JOB": file, "QUALITY": "high"}, models)
    kept = write(models, complete.replace("  steps: 100\n", "", 1).replace("  samples_per_ray: 48\n", "", 1))
    assert resolve({"JOB": kept, "QUALITY": "high"}, models).train_nerf.samples_per_ray == 96
    broken = write(models, "prompt: x\nmodel: plain\nquality: [a]\n")
    assert resolve({"JOB": broken, "QUALITY": "high"}, models).quality == "high"


def test_a_sketch_and_its_sigma_win_over_the_file(models: Path) -> None:
    house = write(
        models, "prompt: x\nmodel: plain\nsketch: nowhere.obj\ntrain_nerf: {sigma_s: 1.0, steps: 9}\n"
    )
    job = resolve({"JOB": house, "SKETCH": house, "SIGMA_S": "0.05"}, models)
    assert (job.sketch, job.train_nerf.sigma_s, job.train_nerf.steps) == (house, 0.05, 9)
    assert resolve({"JOB": house, "SKETCH": house}, models).train_nerf.sigma_s == 1.0
    assert jobs.run_name(job) != jobs.run_name(dataclasses.replace(job, sketch=""))
    broken = write(models, "prompt: x\nmodel: plain\ntrain_nerf: 3\n")
    with pytest.raises(InputError, match="train_nerf is 3"):
        resolve({"JOB": broken, "SKETCH": broken, "SIGMA_S": "0.05"}, models)


def test_refinement_is_asked_for_and_goes_on_where_training_ends(models: Path) -> None:
    tuned = {"distillation": {"guidance_scale": 20, "guidance_scale_end": 5, "timestep_max_end": 0.4}}
    (models / "tuned" / "bundle.json").write_text(json.dumps(tuned))
    base = {"PROMPT": "a cup", "MODEL": "tuned"}
    job = resolve({**base, "REFINE": "1"}, models)
    assert (job.refine, job.refinement.guidance_scale, job.refinement.timestep_max) == (True, 5.0, 0.4)
    assert not resolve({**base, "REFINE": "0", "JOB": write(models, "refine: true")}, models).refine
    (models / "tuned" / "bundle.json").write_text(json.dumps({**tuned, "refinement": {"steps": 7}}))
    assert resolve(base, models).refinement.steps == 7


@given(prompt=st.text())
def test_any_prompt_survives_the_file(prompt: str) -> None:
    try:
        job = Job(prompt=prompt)
    except InputError:
        assert not prompt.strip() or "\0" in prompt or any(0xD800 <= ord(c) < 0xE000 for c in prompt)
        return
    assert build(Job, yaml.safe_load(jobs.to_yaml(job))) == job
    name = jobs.run_name(job)
    assert name == Path(name).name
    assert name.replace("-", "").isalnum()
    assert name.isascii()


def test_the_listing_of_options_is_a_job_of_defaults() -> None:
    listed = yaml.safe_load(describe(Job))
    assert build(Job, {**listed, "prompt": "x"}) == Job(prompt="x")
    for section, options in dataclasses.asdict(Job(prompt="x")).items():
        assert section in listed
        if isinstance(options, dict):
            assert set(options) == set(listed[section])


def test_the_name_of_a_run_is_the_hash_of_everything_asked_for() -> None:
    job = Job(prompt="A red   armchair!")
    assert jobs.run_name(job).startswith("a-red-armchair-")
    others = [
        dataclasses.replace(job, prompt="a red armchair"),
        dataclasses.replace(job, negative="blue"),
        dataclasses.replace(job, seed=1),
        dataclasses.replace(job, clean=asset.Clean(faces=19_999)),
    ]
    assert len({jobs.run_name(j) for j in [job, *others, dataclasses.replace(job)]}) == 5
    assert jobs.run_name(Job(prompt="🪑")).startswith("prompt-")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"promt": "x"}, ["promt", "prompt", "negative", "train_nerf"]),
        ({"train_nerf": {"step": 1}}, ["train_nerf.step", "steps"]),
        ({"train_nerf": 3}, ["train_nerf", "mapping"]),
        ({"train_nerf": {"steps": 0}}, ["train_nerf.steps", "0", "1", "100000"]),
        ({"train_nerf": {"steps": 1.5}}, ["train_nerf.steps", "1.5", "whole number"]),
        ({"train_nerf": {"steps": True}}, ["train_nerf.steps", "True"]),
        ({"train_nerf": {"steps": "many"}}, ["train_nerf.steps", "'many'"]),
        ({"train_nerf": {"guidance_scale": float("nan")}}, ["train_nerf.guidance_scale", "nan"]),
        ({"train_nerf": {"radius": [2, 1]}}, ["train_nerf.radius", "rising"]),
        ({"train_nerf": {"radius": [1]}}, ["train_nerf.radius"]),
        ({"train_nerf": {"background": "pink"}}, ["train_nerf.background", "random", "learned"]),
        ({"train_nerf": {"timestep_min": 0.99}}, ["timestep_min", "timestep_max"]),
        ({"refine": 1}, ["refine", "1", "true | false"]),
        ({"refinement": {"fit_steps": 0, "steps": 0}}, ["refinement", "expected a step"]),
        ({"refinement": {"gradient": "both"}}, ["refinement.gradient", "encoder | image"]),
        ({"refinement": {"shading": 2}}, ["refinement.shading", "0", "1"]),
        ({"train_nerf": {"gradient_clip_end": 2}}, ["gradient_clip_end", "gradient_clip is 0"]),
        ({"train_nerf": {"gradient_clip": -1}}, ["train_nerf.gradient_clip", "-1", "0", "1000"]),
        ({"train_nerf": {"guidance_rescale": 1.5}}, ["train_nerf.guidance_rescale", "1.5", "0", "1"]),
        ({"train_paint": {"perp_neg": 11}}, ["train_paint.perp_neg", "11", "0", "10"]),
        ({"train_nerf": {"view_text": "none"}}, ["train_nerf.view_text", "bins | interpolated"]),
        ({"train_nerf": {"timestep_annealing": "cosine"}}, ["timestep_annealing", "linear | sqrt"]),
        ({"seed": -1}, ["seed", "-1", "0", "4294967295"]),
        ({"seed": 2**32}, ["seed", "4294967296"]),
        ({"quality": "best"}, ["quality", "best", "draft", "standard", "high"]),
        ({"prompt": 7}, ["prompt", "7", "text"]),
        ({"prompt": "  \n"}, ["empty", "make run"]),
        ({"prompt": "a\0b"}, ["NUL"]),
        ({"negative": "a\0b"}, ["negative", "NUL"]),
        ({"prompt": "a\udc80"}, ["UTF-8"]),
    ],
)
def test_errors_name_the_key_the_value_and_what_is_allowed(values: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(InputError) as error:
        build(Job, {"prompt": "x", **values}, "chairs.yaml")
    text = str(error.value)
    assert "\n" not in text
    assert text.startswith("chairs.yaml: ")
    for word in words:
        assert word in text


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({}, ["prompt is empty"]),
        ({"PROMPT": "x", "SEED": "1.5"}, ["SEED", "1.5", "4294967295"]),
        ({"PROMPT": "x", "SEED": "-1"}, ["SEED", "-1", "4294967295"]),
        ({"PROMPT": "x", "SEED": "4294967296"}, ["SEED", "4294967295"]),
        ({"PROMPT": "x", "SEED": "٣"}, ["SEED"]),
        ({"PROMPT": "x", "QUALITY": "ultra"}, ["QUALITY", "ultra", "draft | standard | high"]),
        ({"PROMPT": "x", "SIGMA_S": "0.3"}, ["SIGMA_S", "SKETCH=file"]),
        ({"PROMPT": "x", "SKETCH": "absent.obj"}, ["SKETCH", "absent.obj"]),
        (
            {"PROMPT": "x", "SKETCH": __file__, "SIGMA_S": "1e9"},
            ["SIGMA_S", "1000000000", "0.01", "10"],
        ),
        ({"PROMPT": "x", "SKETCH": __file__, "SIGMA_S": "nan"}, ["SIGMA_S", "nan"]),
        ({"PROMPT": "x", "SKETCH": __file__, "SIGMA_S": "o.3"}, ["SIGMA_S", "o.3"]),
        ({"PROMPT": "x", "REFINE": "yes"}, ["REFINE", "yes", "1", "0"]),
        ({"PROMPT": "x", "MODEL": "none"}, ["MODEL", "none", "plain, tuned"]),
        ({"PROMPT": "x", "MODEL": ".."}, ["MODEL", "plain, tuned"]),
        ({"PROMPT": "x", "JOB": "absent.yaml"}, ["absent.yaml", "does not exist"]),
    ],
)
def test_errors_of_the_environment(models: Path, environment: dict[str, str], words: list[str]) -> None:
    with pytest.raises(InputError) as error:
        resolve(environment, models)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "!!python/object/apply:os.system ['touch hacked']",
        "prompt: !!python/name:os.system",
        "- a list",
        "prompt: [unclosed",
        "\t",
        "a: " + "[" * 5000,
        "seed: 2024-13-45",
        "train_nerf: {steps: 5}\ntrain_nerf: {steps: 6}",
        "seed: 1" + "0" * 400,
        "train_nerf: {learning_rate: 1" + "0" * 400 + "}",
        "seed: " + "9" * 5000,
        "\n".join(
            ["a0: &a0 [x]", *(f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 9)}]" for i in range(12))]
        ).replace("a12:", "train_nerf:"),
    ],
)
def test_yaml_that_is_not_a_plain_mapping_is_one_line(
    models: Path, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(models)
    with pytest.raises(InputError) as error:
        resolve({"PROMPT": "x", "MODEL": "plain", "JOB": write(models, text)}, models)
    assert "job.yaml" in str(error.value)
    assert "\n" not in str(error.value)
    assert not (models / "hacked").exists()


def test_numbers_may_have_exponents(models: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(models)
    job = write(models, "train_nerf: {learning_rate: 1e-3}")
    assert resolve({"PROMPT": "x", "MODEL": "plain", "JOB": job}, models).train_nerf.learning_rate == 1e-3


def test_a_broken_recommendation_of_a_model_is_named(models: Path) -> None:
    for content in ("{", "[]", '{"distillation": {"stepz": 1}}', '{"distillation": {"steps": -1}}'):
        (models / "tuned" / "bundle.json").write_text(content)
        with pytest.raises(InputError, match=r"bundle\.json"):
            resolve({"PROMPT": "x", "MODEL": "tuned"}, models)


def test_the_examples_are_jobs() -> None:
    examples = Path(__file__).parents[2] / "examples"
    job = resolve({"PROMPT": "a brown horse", "NEGATIVE": "a chair", "JOB": str(examples / "two-faced.yaml")})
    assert job.train_nerf.perp_neg == 1.0


def test_how_an_asset_is_published_can_be_said_in_the_environment(models: Path) -> None:
    base = {"PROMPT": "a cup", "MODEL": "plain"}
    job = resolve({**base, "UNLIT": "1", "PIVOT": "centre", "SIZE_M": "0.12"}, models)
    assert (job.publish.unlit, job.publish.pivot, job.publish.size_m) == (True, "centre", 0.12)
    assert resolve({**base, "UNLIT": "0"}, models).publish == asset.Publish()
    for name, value, words in (
        ("UNLIT", "yes", r"UNLIT is 'yes', expected 1"),
        ("PIVOT", "top", "base | centre"),
        ("SIZE_M", "tall", "SIZE_M is 'tall'"),
        ("SIZE_M", "-1", "from 0 to 10000"),
    ):
        with pytest.raises(InputError, match=words):
            resolve({**base, name: value}, models)
    mesh = write(models, "")
    with pytest.raises(InputError, match="PIVOT is given with MESH"):
        resolve({**base, "MESH": mesh, "PIVOT": "base"}, models)

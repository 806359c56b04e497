"""The one table of stages, and that whatever a stage needs elsewhere is there."""

import dataclasses
import re
from typing import Any

from pipeline.options.job import Job
from pipeline.options.nerf import Refinement
from pipeline.options.schema import snake
from pipeline.run import costs
from pipeline.run.chain import STAGES, stage_options, stages_of
from pipeline.run.staleness import ROOT


def test_every_stage_has_a_file_a_rule_and_a_cost() -> None:
    rules = {
        name
        for file in ("Snakefile", "Snakefile.paint", "common.smk", "last.smk")
        for name in re.findall(r"^ *rule (\w+):", (ROOT / "pipeline" / file).read_text(), re.MULTILINE)
    }
    files = {path.stem for path in (ROOT / "pipeline" / "stages").glob("*.py")}
    assert rules - {"all"} == files - {"__init__"} == set(STAGES)
    for name, stage in STAGES.items():
        assert stage.name == name
        assert getattr(costs, name)(costs.Work(Job(prompt="x"), 32, 20.0)).seconds > 0


def test_every_option_reaches_a_stage_and_no_stage_asks_for_one_that_is_not_there() -> None:
    fields = {field.name for field in dataclasses.fields(Job)}
    assert {name for stage in STAGES.values() for name in stage.options} == fields


def test_trainings_name_a_section_of_their_options() -> None:
    for stage in STAGES.values():
        assert not stage.training or stage.training in stage.options
        assert ("unet" in stage.networks + stage.together) == bool(stage.training)
    assert snake(Refinement.__name__) == STAGES["refine"].training


def test_a_job_has_the_stages_that_it_asks_for() -> None:
    def stages(**asked: Any) -> list[str]:
        return [stage.name for stage in stages_of(Job(prompt="x", **asked))]

    made = ["extract", "clean", "unwrap", "bake", "publish", "report"]
    painted = ["publish_paint", "report"]
    assert stages() == ["embed", "train_nerf", *made]
    assert stages(sketch="a.obj", refine=True) == ["embed", "sketch", "train_nerf", "refine", *made]
    assert stages(start="b.glb") == ["embed", "start", "train_nerf", *made]
    assert stages(seeds=4) == ["embed", "contest", "train_nerf", *made]
    assert stages(mesh="a.obj") == ["embed", "prepare", "train_paint", "bake_paint", *painted]
    assert stages(mesh="a.obj", start="b", refine=True) == [
        "embed", "prepare", "start_paint", "train_paint", "bake_paint", "refine_paint", *painted
    ]  # fmt: skip
    assert stages(formats="stl") == ["embed", "train_nerf", *made[:-1], "formats", "report"]
    assert stages(mesh="a.obj", formats="ply")[-3:] == ["publish_paint", "formats", "report"]
    assert stage_options(Job(prompt="x", seed=3), "publish_paint").keys() == {"prompt", "param", "publish"}

"""The one table of stages, and that whatever a stage needs elsewhere is there."""

import dataclasses
import re

from pipeline.options.job import Job
from pipeline.options.nerf import Refinement
from pipeline.options.schema import snake
from pipeline.run import costs
from pipeline.run.chain import PAINT, REPORT, STAGES, TEXT, stage_options, stages_of
from pipeline.run.staleness import ROOT


def test_every_stage_has_a_file_a_rule_and_a_cost() -> None:
    rules = {
        name
        for file in ("Snakefile", "Snakefile.paint", "common.smk")
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
    plain = [stage.name for stage in stages_of(Job(prompt="x"))]
    assert plain == [stage.name for stage in TEXT if not stage.optional] + ["report"]
    whole = stages_of(Job(prompt="x", sketch="a.obj", refine=True))
    assert whole == [*TEXT, REPORT]
    assert [stage.name for stage in stages_of(Job(prompt="x", mesh="a.obj"))] == [
        stage.name for stage in (*PAINT, REPORT) if not stage.optional
    ]
    assert stage_options(Job(prompt="x", seed=3), "publish_paint").keys() == {"prompt", "param", "publish"}

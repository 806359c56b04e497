"""Where a training with a start sets out, and what START may name."""

from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.options.job import resolve
from pipeline.options.nerf import TrainNerf
from pipeline.options.start import StartFit, check_start, lasting, set_out, started

ANNEALED = TrainNerf(steps=200, timestep_min=0.2, timestep_max=0.98, timestep_max_end=0.4)


def test_strength_says_the_noise_level_and_the_steps() -> None:
    half = set_out(ANNEALED, 0.5)
    assert half.steps == 100
    assert half.timestep_max == pytest.approx(0.59)
    assert half.timestep_max_end == 0.4
    little = set_out(ANNEALED, 0.1)
    assert little.steps == 20
    assert little.timestep_max == little.timestep_max_end == pytest.approx(0.278)
    assert set_out(ANNEALED, 1.0) == ANNEALED
    assert set_out(TrainNerf(steps=1), 0.01).steps == 1
    assert started(ANNEALED, StartFit(updates_per_call=5), 1.0) == replace(ANNEALED, updates_per_call=5)
    assert started(replace(ANNEALED, updates_per_call=2), StartFit(), 1.0).updates_per_call == 2


def finished(run: Path) -> Path:
    run.mkdir(parents=True)
    (run / "field.npz").write_bytes(b"x")
    return run


def test_a_link_is_followed_when_the_job_is_made(tmp_path: Path) -> None:
    """`latest` will point to the run that starts from it."""
    run = finished(tmp_path / "runs" / "a")
    (tmp_path / "runs" / "latest").symlink_to("a")
    assert lasting(str(tmp_path / "runs" / "latest")) == str(run)
    job = resolve({"PROMPT": "x", "START": str(tmp_path / "runs" / "latest")})
    assert job.start == str(run)
    (run / "asset.obj").write_text("")
    job = resolve({"PROMPT": "x", "MESH": str(tmp_path / "runs" / "latest" / "asset.obj")})
    assert job.mesh == str(run / "asset.obj")
    assert lasting(str(run / "asset.obj")) == str(run / "asset.obj")


def test_hostile_values_end_in_one_line(tmp_path: Path) -> None:
    run = finished(tmp_path / "run")
    (tmp_path / "empty").mkdir()
    for given, fault in (
        ({"START": "nowhere"}, "START 'nowhere' does not exist: give"),
        ({"START": str(tmp_path / "empty")}, "is no run that has got as far as its shape"),
        ({"START": "a\0b"}, "START holds a NUL"),
        ({"STRENGTH": "0.5"}, "STRENGTH is given, but no START"),
        *(
            ({"START": str(run), "STRENGTH": value}, fault)
            for value, fault in (
                ("0", "STRENGTH is 0.0, expected a number from 0.01 to 1"),
                ("-1", "STRENGTH is -1.0"),
                ("2", "STRENGTH is 2.0"),
                ("nan", "STRENGTH is nan"),
                ("1e999", "STRENGTH is inf"),
                ("much", "STRENGTH is 'much', expected a number"),
            )
        ),
    ):
        with pytest.raises(InputError) as error:
            resolve({"PROMPT": "x", **given})
        assert fault in str(error.value), given
        assert "\n" not in str(error.value)
    check_start(str(run))

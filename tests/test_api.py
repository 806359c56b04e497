"""The Python interface, as docs/python.md shows it."""

import functools
import inspect
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pipeline import api
from pipeline.errors import InputError
from tests.fake_project import ROOT, clean_environment
from tests.tiny_bundle import write_tiny_bundle

PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
SMALL: dict[str, dict[str, Any]] = {
    "train_nerf": {"steps": 30, "cameras_per_step": 2, "samples_per_ray": 32, "guidance_scale": 1.5},
    "extract": {"resolution": 32, "views": 6},
    "unwrap": {"resolution": 128, "padding": 2},
    "bake": {"views": 6, "texture": 128},
    "publish": {"preview_size": 48, "turntable_size": 48, "turntable_frames": 6},
}


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, where jobs take seconds: a tiny model, little of everything."""
    write_tiny_bundle(tmp_path / "model", latent_size=16)
    options = {"model": str(tmp_path / "model"), **SMALL}
    monkeypatch.setattr(api, "resolve", functools.partial(api.resolve, **options))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_example_runs(small: Path) -> None:
    (small / "example.py").write_text(
        f"import functools\nfrom pipeline import api\napi.resolve = functools.partial(api.resolve, "
        f"**{ {'model': str(small / 'model'), **SMALL} })\n{BLOCKS[0]}"
    )
    result = subprocess.run(
        [sys.executable, "example.py"],
        env={**clean_environment(), "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert "train_nerf run after embed" in result.stdout
    assert int(result.stdout.split()[-1]) == 16, "latents of the tiny model"
    assert (small / "runs" / "latest" / "asset.glb").is_file()


def test_a_denoiser_of_ones_own_trains_a_field(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    values: dict[str, Any] = {}
    exec(compile(BLOCKS[1], "docs/python.md", "exec"), values)
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in said[:-1]] == [str(step) for step in range(1, len(said))]
    mesh = values["mesh"]
    assert len(mesh.faces) > 100
    assert abs(mesh.vertices.mean(axis=0)).max() < 0.3, "the ball is in the middle"


def test_the_page_lists_what_there_is() -> None:
    listed = dict(re.findall(r"^\| `(\w+)\((.*?)\)` \|", PAGE, flags=re.MULTILINE))
    functions = {name for name in api.__all__ if inspect.isfunction(getattr(api, name))}
    assert set(listed) == functions
    for name, said in listed.items():
        real = inspect.signature(getattr(api, name)).parameters
        assert [word.strip("* ").partition("=")[0] for word in said.split(",")] == list(real)[
            : said.count(",") + 1
        ]


def test_errors_are_for_the_caller(small: Path) -> None:
    with pytest.raises(InputError, match=r"quality is 'ultra', expected draft \| standard"):
        api.resolve("a chair", quality="ultra")
    with pytest.raises(InputError, match="unknown key 'colour'"):
        api.resolve("a chair", colour="red")
    with pytest.raises(InputError, match="prompt is empty"):
        api.resolve()
    mesh = small / "it.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="no sketch and no mesh"):
        api.train_field(api.resolve("a chair", mesh=str(mesh)), lambda *_: None)


def test_what_is_said_in_python_wins_over_the_file(small: Path) -> None:
    (small / "job.yaml").write_text("prompt: a red mug\nseed: 4\nquality: draft\n")
    job = api.resolve(file="job.yaml", seed=9)
    assert (job.prompt, job.seed, job.quality) == ("a red mug", 9, "draft")

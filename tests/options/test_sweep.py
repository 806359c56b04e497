"""What a sweep's file asks for."""

from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.options.sweep import Sweep, read_sweep


def read(folder: Path, text: str, name: str = "sweep.yaml") -> Sweep:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return read_sweep(path)


def test_lists_are_multiplied_the_first_slowest(tmp_path: Path) -> None:
    text = (
        "prompt: [a mug, a duck]\nquality: draft\nseed: [0, 1]\nclean: {faces: [500, 1000], smoothing: 3}\n"
    )
    sweep = read(tmp_path, text)
    found = [(job.prompt, job.seed, job.clean.faces) for job in sweep.jobs]
    assert found == [(p, s, f) for p in ("a mug", "a duck") for s in (0, 1) for f in (500, 1000)]
    assert {(job.quality, job.clean.smoothing) for job in sweep.jobs} == {("draft", 3)}
    assert sweep.varied == ("prompt", "seed", "clean.faces")
    assert sweep.values(sweep.jobs[1]) == {"prompt": "a mug", "seed": 0, "clean.faces": 1000}


def test_a_pair_is_one_value_and_a_list_of_pairs_is_varied(tmp_path: Path) -> None:
    one = read(tmp_path, "prompt: a mug\ntrain_nerf: {radius: [1.0, 1.5]}\n")
    assert [job.train_nerf.radius for job in one.jobs] == [(1.0, 1.5)]
    two = read(tmp_path, "prompt: a mug\ntrain_nerf: {radius: [[1.0, 1.5], [2, 3]]}\n")
    assert [job.train_nerf.radius for job in two.jobs] == [(1.0, 1.5), (2.0, 3.0)]


def test_a_text_file_has_a_prompt_a_line(tmp_path: Path) -> None:
    sweep = read(tmp_path, "# chairs\na red chair\n\n  a blue chair: old \na red chair\n", "prompts.txt")
    assert [job.prompt for job in sweep.jobs] == ["a red chair", "a blue chair: old"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("prompt: []\n", "prompt is an empty list"),
        ("prompt: [a, b]\nseed: [0, -1]\n", "seed is -1"),
        ("prompt: a\nquality: [draft, ultra]\n", "'ultra'"),
        ("prompt: a\ncolour: [red]\n", "unknown key 'colour'"),
        ("prompt: a\nclean: [{faces: 500}]\n", "lists"),
        ("seed: [1, 2]\n", "prompt is empty"),
        (
            f"prompt: a\nseed: {list(range(200))}\nclean: {{faces: {list(range(100, 300))}}}\n",
            "40000 jobs, expected at most 20000",
        ),
        ("- a\n- b\n", "expected a mapping"),
    ],
)
def test_mistakes_are_named_with_the_file(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=r"sweep\.yaml") as error:
        read(tmp_path, text)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_files_without_prompts(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no prompt"):
        read(tmp_path, "# nothing\n", "prompts.txt")
    with pytest.raises(InputError, match="cannot be read"):
        read_sweep(tmp_path / "absent.txt")

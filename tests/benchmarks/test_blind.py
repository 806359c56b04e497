"""Blind naming: what is asked covers everything and tells nothing; answers are scored, bad ones are named."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks import __main__ as all_benchmarks
from benchmarks._results import VIEWS, Result, nothing, views_of_run
from benchmarks.blind import __main__ as blind
from benchmarks.blind.prompts import Asked, ask, draw_prompts
from benchmarks.blind.scoring import (
    ACCEPTED,
    Answer,
    figures,
    mark,
    names_kind,
    read_answers,
    score,
    score_table,
)
from benchmarks.blind.sheets import (
    A_SHEET,
    HEADER,
    Entry,
    draw_sheets,
    key_text,
    kinds_text,
    numbered,
    questions,
    read_key,
)
from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kinds import BY_WORD, KINDS
from export.everyday_objects.data.materials import MATERIALS
from pipeline.mesh.mesh import Mesh, write_obj
from pipeline.paint.given_mesh import PaintMesh, save_paint_mesh

SOFA = Entry("a red striped sofa", "sofa", "red", "striped", "", 0, "0123456789", "")
CAR = Entry("a car", "car", "", "", "", 1, "abcdef0123", "")
KEY = {1: SOFA, 2: CAR}
GOOD = f"{HEADER}\n1,an old couch,Sofa,red,striped,4\n2,chair,chair,blue,plain,1\n"


def test_prompts_cover_every_kind_and_are_the_same_every_time() -> None:
    prompts = draw_prompts(0)
    assert {asked.kind for asked in prompts} == set(BY_WORD)
    assert len(prompts) == len(KINDS)
    more = draw_prompts(2 * len(KINDS) + 7)
    assert more[: len(KINDS)] == prompts == draw_prompts(0)
    assert len({asked.prompt for asked in more}) == 2 * len(KINDS) + 7
    assert {asked.colour for asked in more} == {"", *COLOURS}
    assert {asked.material for asked in more} == {"", *MATERIALS}
    assert any(asked.part for asked in more)


def test_a_kinds_prompt_does_not_depend_on_the_others() -> None:
    alone = draw_prompts(1, [BY_WORD["house"]])
    assert alone[0] in draw_prompts(0)


def test_prompts_say_what_they_ask_for() -> None:
    for asked in draw_prompts(4 * len(KINDS)):
        assert asked.kind in asked.prompt
        assert asked.colour in asked.prompt.split() or not asked.colour
        assert asked.part.removeprefix("a ") in asked.prompt
        assert " a o" not in f" {asked.prompt}"
        words = MATERIALS[asked.material] if asked.material else None
        assert words is None or words.adjective in asked.prompt or f"made of {words.noun}" in asked.prompt
    house = BY_WORD["house"]
    assert ask(house, "red", part="a blue roof").prompt == "a red house with a blue roof"
    assert ask(house, "", "lego", made_of=True).prompt == "a house made of lego"
    assert ask(house, "orange", "striped", made_of=True).prompt == "an orange striped house"
    assert ask(BY_WORD["pancakes"]).prompt == "pancakes"


def test_every_prompt_comes_with_every_seed_in_another_order() -> None:
    prompts = draw_prompts(0)
    pairs = numbered(prompts, 2)
    assert sorted(pairs) == sorted((asked, seed) for asked in prompts for seed in (0, 1))
    assert [asked for asked, _ in pairs[:20]] != prompts[:20]
    assert pairs == numbered(prompts, 2)


def test_sheets_hold_some_results_and_their_names_tell_numbers_only() -> None:
    pages = draw_sheets([nothing(16)] * (A_SHEET + 1))
    assert list(pages) == ["sheet-01.png", "sheet-02.png"]
    assert pages["sheet-01.png"].height == A_SHEET * pages["sheet-02.png"].height
    assert not pages["sheet-01.png"].info
    assert np.asarray(pages["sheet-02.png"]).min() < 100, "the number is missing"


def test_questions_list_all_there_is_but_kinds_and_no_prompt() -> None:
    text = questions(2 * A_SHEET + 1)
    assert all(word in text for word in (*COLOURS, *MATERIALS, HEADER))
    assert "sheet-03.png" in text
    assert "sheet-04.png" not in text
    assert sorted(kinds_text().splitlines()) == sorted(kind.words[0] for kind in KINDS)
    assert not [word for word in ("sofa", "horse", "airplane") if word in text]
    assert not [asked.prompt for asked in draw_prompts(0) if " " in asked.kind and asked.prompt in text]


def test_the_key_survives_its_file() -> None:
    assert read_key(key_text([SOFA, CAR])) == KEY


def test_good_answers_are_scored() -> None:
    answers, faults = read_answers(GOOD, "a.csv", KEY)
    assert not faults
    assert mark(SOFA, answers[1]) == (True, True, True, True, 4)
    assert mark(CAR, answers[2]) == (False, False, None, None, 1)
    found = figures([mark(KEY[n], answers[n]) for n in KEY])
    assert found == {
        "answers": 2, "kind_listed": 0.5, "kind_free": 0.5, "colour": 1.0, "material": 1.0, "rating": 2.5,
        "rated_3_or_more": 0.5,
    }  # fmt: skip


def test_several_namers_are_averaged() -> None:
    first, _ = read_answers(GOOD, "a.csv", KEY)
    second = {1: Answer("lump", "bed", "blue", "plain", 2), 2: Answer("car", "car", "red", "plain", 3)}
    scores = score(KEY, {"a.csv": first, "b.csv": second})
    assert scores["summary"]["all"]["kind_listed"] == 0.5
    assert scores["summary"]["all"]["rating"] == 2.5
    assert scores["namers"]["b.csv"]["colour"] == 0.0
    assert scores["kinds"]["sofa"]["kind_free"] == 0.5
    assert scores["kinds"]["car"]["material"] is None
    lines = score_table(scores).splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["all", "a.csv", "b.csv", "car", "sofa"]
    assert "never" not in score_table(scores)


@pytest.mark.parametrize(
    ("name", "kind", "right"),
    [
        ("couch", "sofa", True), ("A Red Settee", "sofa", True), ("armchair", "chair", False),
        ("two old boots", "boot", True), ("race car", "car", True), ("carpet", "car", False),
        ("T-Rex", "dinosaur", True), ("a dog", "German Shepherd", True), ("nothing", "house", False),
        ("glass of water", "vase", False), ("bus", "bus", True),
    ],
)  # fmt: skip
def test_free_words_count_as_whole_words(name: str, kind: str, right: bool) -> None:
    assert names_kind(name, kind) == right


def test_further_words_are_of_kinds() -> None:
    assert set(ACCEPTED) <= set(BY_WORD)


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("7,x,sofa,red,plain,3", "a.csv:2: number '7' is on no sheet, expected 1 to 2"),
        ("x,x,sofa,red,plain,3", "a.csv:2: number 'x' is on no sheet, expected 1 to 2"),
        ("1,x,couch,red,plain,3", "a.csv:2: kind 'couch' is none of the list in kinds.txt"),
        ("1,x,sofa,teal,plain,3", "a.csv:2: colour 'teal' is none of red, "),
        ("1,x,sofa,red,silk,3", "a.csv:2: material 'silk' is none of plain, "),
        ("1,x,sofa,red,plain,6", "a.csv:2: rating '6' is no whole number from 1 to 5"),
        ("1,x,sofa,red,plain,2.5", "a.csv:2: rating '2.5' is no whole number"),
        ("1,,sofa,red,plain,3", "a.csv:2: name is empty"),
        ("1,x,sofa,red,3", f"a.csv:2: 5 columns, expected {HEADER}"),
    ],
)
def test_a_bad_line_is_named(line: str, fault: str) -> None:
    _, faults = read_answers(f"{HEADER}\n{line}\n", "a.csv", KEY)
    assert len(faults) == 1
    assert faults[0].startswith(fault)
    assert "\n" not in faults[0]


def test_missing_and_repeated_lines_are_named() -> None:
    line = '1,"sofa, red",sofa,red,plain,3\n'
    assert read_answers(f"{HEADER}\n\n{line}", "a.csv", KEY)[1] == ["a.csv:4: no line for 2"]
    assert read_answers(f"{HEADER}\n{line}{line}", "a.csv", KEY)[1] == [
        "a.csv:3: number 1 has a line already"
    ]
    assert read_answers("", "a.csv", KEY)[1] == ["a.csv:1: no line for 1, 2"]


def faked(asked: dict[str, str], runs: Path, size: int) -> Result:
    return Result(f"{asked['PROMPT']}-{asked['SEED']}", 1.0, nothing(size), "it is empty")


def test_from_sheets_to_a_score(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(blind, "at_once", lambda function, calls, label: [faked(*call) for call in calls])
    folder = tmp_path / "set"
    assert blind.main(["make", str(folder), "--kinds", "sofa", "--count", "2"]) == 0
    assert sorted(path.name for path in folder.iterdir()) == [
        "key.json", "kinds.txt", "questions.md", "sheet-01.png",
    ]  # fmt: skip
    with Image.open(folder / "sheet-01.png") as page:
        assert not page.info
    assert "4 of them empty" in capsys.readouterr().out
    assert {entry.kind for entry in read_key((folder / "key.json").read_text()).values()} == {"sofa"}

    lines = [HEADER, *(f"{n},couch,sofa,red,plain,3" for n in (1, 2, 3, 4))]
    (folder / "answers.csv").write_text("\n".join(lines))
    assert blind.main(["score", str(folder)]) == 0
    assert json.loads((folder / "score.json").read_text())["summary"]["all"]["kind_free"] == 1.0
    assert (folder / "score.md").read_text() in capsys.readouterr().out

    assert blind.main(["make", str(folder), "--kinds", "sofa"]) == 2
    assert "holds answers to other sheets (answers.csv)" in capsys.readouterr().err
    (folder / "answers.csv").write_text("\n".join([*lines[:-1], "4,couch,sofa,red,plain,0"]))
    assert blind.main(["score", str(folder)]) == 2
    assert capsys.readouterr().err == (
        f"error: {folder / 'answers.csv'}:5: rating '0' is no whole number from 1 to 5\n"
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["make", "x", "--kinds", "unicorn"], "--kinds names unicorn"),
        (["make", "x", "--seeds", "0"], "--seeds is 0"),
        (["score", "x"], "x has no key.json"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert blind.main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {said}")
    assert error.count("\n") == 1


def test_make_bench_does_not_list_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ONLY", "blind")
    assert all_benchmarks.main() == 2
    assert "paper" in capsys.readouterr().err


def test_asked_and_entry_agree() -> None:
    assert Entry._fields[: len(Asked._fields)] == Asked._fields


CORNERS = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
UV = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])


@pytest.mark.parametrize("painted", [False, True])
def test_views_of_both_kinds_of_run(painted: bool, tmp_path: Path) -> None:
    """A red square that faces the front: seen from there and from behind, not from its sides. Its colour is
    the preview's, whatever the texture is without light or before it was refined."""
    names = ("albedo_refined", "albedo_baked", "albedo") if painted else ("albedo_baked", "albedo")
    for name, colour in zip(names, ("red", "blue", "lime"), strict=False):
        Image.new("RGB", (8, 8), colour).save(tmp_path / f"{name}.png")
    if painted:
        part = np.zeros(2, np.int32)
        save_paint_mesh(tmp_path / "mesh.npz", PaintMesh(CORNERS, CORNERS, FACES, part, ("x",), UV, FACES))
    else:
        write_obj(tmp_path / "mesh_uv.obj", Mesh(CORNERS, FACES, UV, FACES))
    views = views_of_run(tmp_path, 32)
    assert views.shape == (6, 32, 32, 3)
    assert views.dtype == np.uint8
    reds = dict(zip(VIEWS, (views[..., 0] > views[..., 1:].max(-1) + 150.0).mean(axis=(1, 2)), strict=True))
    assert reds["front"] > 0.2
    assert reds["front"] > reds["front right"] > reds["right"] < 0.02
    assert reds["from above"] < reds["front"]

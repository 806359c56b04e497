"""The command line of blind naming: all that reads or writes files. See the package's docstring."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import benchmarks.blind as blind
from benchmarks._pool import at_once
from benchmarks._results import make_result
from benchmarks.blind.prompts import Asked, draw_prompts
from benchmarks.blind.scoring import read_answers, score, score_table
from benchmarks.blind.sheets import (
    TILE,
    Entry,
    draw_sheets,
    key_text,
    kinds_text,
    numbered,
    questions,
    read_key,
)
from export.everyday_objects.data.kinds import BY_WORD, KINDS
from pipeline.errors import InputError

RUNS = Path("build/blind")


def main(arguments: Sequence[str]) -> int:
    """Carry out one command and return the exit status."""
    options = parse(arguments)
    try:
        if options.command == "score":
            return print_score(options.folder, options.answers or [options.folder / "answers.csv"])
        unknown = [word for word in options.kinds if word not in BY_WORD]
        if unknown:
            raise InputError(f"--kinds names {', '.join(unknown)}, expected main words of data/kinds.py")
        if options.seeds < 1:
            raise InputError(f"--seeds is {options.seeds}, expected 1 or more")
        kinds = [kind for kind in KINDS if not options.kinds or kind.words[0] in options.kinds]
        asked = numbered(draw_prompts(options.count, kinds), options.seeds)
        make(options.folder, asked, {"QUALITY": options.quality, "MODEL": options.model})
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the options of a command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.blind",
        description=blind.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="make results, sheets, questions and key")
    making.add_argument("folder", type=Path)
    making.add_argument("--seeds", type=int, default=2, help="results of a prompt")
    making.add_argument("--count", type=int, default=96, help="prompts; more where there are more kinds")
    making.add_argument("--quality", default="standard")
    making.add_argument("--model", default="", help="as MODEL= of make run")
    making.add_argument("--kinds", nargs="*", default=[], help="these alone, by their main words")
    scoring = commands.add_parser("score", help="compare answers with the key")
    scoring.add_argument("folder", type=Path)
    scoring.add_argument(
        "--answers", type=Path, nargs="+", help="a file a namer; left out: FOLDER/answers.csv"
    )
    return parser.parse_args(arguments)


def make(folder: Path, asked: Sequence[tuple[Asked, int]], variables: dict[str, str]) -> None:
    """Make the results of prompts and seeds as far as they are missing; write sheets, questions and key."""
    answered = sorted(path.name for path in folder.glob("*.csv"))
    if answered:
        raise InputError(
            f"{folder} holds answers to other sheets ({', '.join(answered)}): name another folder"
        )
    calls = [({"PROMPT": one.prompt, "SEED": str(seed), **variables}, RUNS, TILE) for one, seed in asked]
    results = at_once(make_result, calls, "blind")
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("sheet-*.png"):
        old.unlink()
    for name, page in draw_sheets([result.views for result in results]).items():
        page.save(folder / name, optimize=True)
    entries = [
        Entry(*one, seed, result.run.rpartition("-")[2], result.fault)
        for (one, seed), result in zip(asked, results, strict=True)
    ]
    (folder / "questions.md").write_text(questions(len(entries)), encoding="utf-8")
    (folder / "kinds.txt").write_text(kinds_text(), encoding="utf-8")
    (folder / "key.json").write_text(key_text(entries), encoding="utf-8")
    failed = [f"{entry.prompt}, seed {entry.seed}: {entry.fault}" for entry in entries if entry.fault]
    print("\n".join([f"{len(entries)} results in {folder}, {len(failed)} of them empty", *failed]))


def print_score(folder: Path, files: Sequence[Path]) -> int:
    """Compare every namer's file with the key; write score.json and score.md, or say what is wrong."""
    if not (folder / "key.json").is_file():
        raise InputError(f"{folder} has no key.json: make the sheets first")
    key = read_key((folder / "key.json").read_text(encoding="utf-8"))
    namers, faults = {}, []
    for path in files:
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{path} cannot be read: {error}") from None
        namers[str(path)], found = read_answers(text, str(path), key)
        faults += found
    for fault in faults:
        print(f"error: {fault}", file=sys.stderr)
    if faults:
        return 2
    scores = score(key, namers)
    (folder / "score.json").write_text(json.dumps(scores, indent=1) + "\n", encoding="utf-8")
    (folder / "score.md").write_text(score_table(scores), encoding="utf-8")
    print(score_table(scores), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

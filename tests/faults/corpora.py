"""``python -m tests.faults.corpora FOLDER``: every mesh of a folder through reading and preparing.

For collections that people have: assimp's `test/models`, the files of Khronos' glTF validator, ModelNet40.
Each file is read in a fork with the limits of the fuzzer, and given texture coordinates where it has at most
20,000 faces. The table says of each whether it was read, refused (with the line), or anything else, which is
a fault; the last line counts. Nothing is written but the table, on standard output.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from pipeline.mesh.file_checks import FORMATS
from tests.faults.fuzz import Ended, run_fork
from tests.faults.targets import prepare_mesh

MOST_FACES = 20_000
"""xatlas takes seconds for so many."""


def try_mesh(path: Path, folder: Path) -> tuple[Ended, str]:
    """Read and prepare a mesh in a fork; return how it ended and the last line that it said."""
    ended = run_fork(path.suffix, lambda: prepare_mesh(path, MOST_FACES), folder)
    said = (folder / "said").read_text(errors="replace").strip().splitlines()
    return ended, said[-1].removeprefix("InputError: ") if said else ""


def main(arguments: list[str]) -> int:
    """Print the table; return 1 if anything but reading and refusing happened."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults.corpora", description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args(arguments).folder
    paths = [path for path in sorted(folder.rglob("*")) if path.suffix.lower() in FORMATS and path.is_file()]
    counts = {"read": 0, "refused": 0, "failed": 0}
    with tempfile.TemporaryDirectory() as scratch:
        for path in paths:
            ended, said = try_mesh(path, Path(scratch))
            status = ended.status if ended.status in counts else "failed"
            counts[status] += 1
            word = said if status == "refused" else ended.status if status == "failed" else ""
            word = word.removeprefix(f"{path}: ")
            print(f"{path.relative_to(folder)} | {status} | {ended.seconds:.1f} s | {word}", flush=True)
    print(f"{len(paths)} files: " + ", ".join(f"{count} {status}" for status, count in counts.items()))
    return int(bool(counts["failed"]))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Runs benchmarks: ``python -m benchmarks``, with ONLY=name[,name] in the environment for some of them.

Without ONLY all run that measure time against error: half an hour on two cores. Those of `BY_NAME` train
many scenes, or want 8 GB of memory, and run when they are named.

A benchmark is a module of this folder named after ONLY (dashes are underscores) with a function
``main(folder) -> dict``: it may write pictures and a table (.md), named after itself, into the folder, and
returns its figures, among them ``summary``. They are written with the machine and the versions to
benchmarks/results/<name>.json, and the table into the page of docs/ that has a mark for it.

`blind` is a package and none of these: people take part in it (``python -m benchmarks.blind``).
"""

import importlib
import importlib.metadata
import json
import os
import platform
import sys
import time
from pathlib import Path

HERE = Path(__file__).parent
RESULTS, DOCS = HERE / "results", HERE.parent / "docs"
BY_NAME = {
    "asset": "6 min",
    "default-model": "35 min",
    "distillation": "30 min",
    "guidance": "16 min",
    "hand-over": "10 min",
    "latent-vs-rgb": "5 min",
    "learn-token": "16 min",
    "oracle-choices": "15 min",
    "paint": "15 min",
    "paper": "40 min",
    "refine": "6 min",
    "sd14": "12 min and 8 GB",
    "sigma-s": "40 min",
}
PACKAGES = ("numpy", "torch", "onnxruntime", "numba", "trimesh", "xatlas")


def main() -> int:
    """Run the benchmarks named by ONLY, or all but `BY_NAME`; return the exit status."""
    names = sorted(path.stem.replace("_", "-") for path in HERE.glob("[!_]*.py"))
    chosen = [name for name in os.environ.get("ONLY", "").split(",") if name]
    for name in chosen:
        if name not in names:
            print(f"error: ONLY names {name!r}, expected some of {', '.join(names)}", file=sys.stderr)
            return 2
    RESULTS.mkdir(exist_ok=True)
    for name in chosen or [name for name in names if name not in BY_NAME]:
        print(f"{name}:", flush=True)
        began = time.monotonic()
        figures = importlib.import_module(f"benchmarks.{name.replace('-', '_')}").main(RESULTS)
        record = {
            "benchmark": name,
            "seconds": round(time.monotonic() - began, 1),
            "machine": {"processor": processor(), "cores": len(os.sched_getaffinity(0))},
            "versions": {
                "python": platform.python_version(),
                **{package: importlib.metadata.version(package) for package in PACKAGES},
            },
            **figures,
        }
        path = RESULTS / f"{name}.json"
        path.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        print(json.dumps(record["summary"], indent=1))
        print(path)
        if (RESULTS / f"{name}.md").is_file():
            for page in DOCS.glob("*.md"):
                include(page, name, (RESULTS / f"{name}.md").read_text(encoding="utf-8"))
    if not chosen:
        listed = ", ".join(f"{name} ({cost})" for name, cost in BY_NAME.items())
        print(f"not run, since ONLY did not name them: {listed}")
    return 0


def include(page: Path, name: str, table: str) -> None:
    """Replace what stands in the page between `<!-- bench name -->` and `<!-- end -->`, if that is there."""
    text = page.read_text(encoding="utf-8")
    before, mark, rest = text.partition(f"<!-- bench {name} -->\n")
    _, end, after = rest.partition("<!-- end -->")
    if end:
        page.write_text(f"{before}{mark}\n{table}\n{end}{after}", encoding="utf-8")


def processor() -> str:
    """Return the processor's name as Linux knows it, else its architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.machine()


if __name__ == "__main__":
    sys.exit(main())

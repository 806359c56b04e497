"""Runs benchmarks: ``python -m benchmarks``, with ONLY=name in the environment for one of them.

A benchmark is a module of this folder named after ONLY (dashes are underscores) with a function
``main(folder) -> dict``: it may write pictures, named after itself, into the folder, and returns its figures,
among them ``summary``. They are written with the machine and the versions to benchmarks/results/<name>.json.
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
RESULTS = HERE / "results"
PACKAGES = ("numpy", "torch", "onnxruntime", "numba", "trimesh", "xatlas")


def main() -> int:
    """Run the benchmark named by ONLY, or all; return the exit status."""
    names = sorted(path.stem.replace("_", "-") for path in HERE.glob("[!_]*.py"))
    only = os.environ.get("ONLY", "")
    if only and only not in names:
        print(f"error: ONLY is {only!r}, expected one of {', '.join(names)}", file=sys.stderr)
        return 2
    RESULTS.mkdir(exist_ok=True)
    for name in [only] if only else names:
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
    return 0


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

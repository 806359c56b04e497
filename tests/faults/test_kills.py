"""Killed or interrupted in every stage of every chain, the same command ends with the same bytes.

Five jobs have all stages: a sketch refined in colours, a mesh painted and refined, two seeds, and a text or a
mesh that starts from an asset. Each is stopped in every stage by SIGKILL to all its processes or, in every
second one, by Ctrl-C, and finished then; the thorough test has it the other way round.
"""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from pipeline.files import file_sha256
from pipeline.run.chain import STAGES
from tests.faults.door import Door

CUBE = (
    "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n"
    "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 1 5 8 4\nf 2 3 7 6\n"
)
CHAINS = {
    "text": {"SKETCH": "cube.obj", "REFINE": "1", "FORMATS": "ply,stl,3mf"},
    "paint": {"MESH": "cube.obj", "REFINE": "1"},
    "seeds": {"SEEDS": "2"},
    "start": {"START": "first/latest", "FORMATS": "stl"},
    "start_paint": {"MESH": "cube.obj", "START": "first/latest", "FORMATS": "ply,3mf"},
}
PECULIAR = {
    "text": {"sketch", "refine", "formats"},
    "paint": {"prepare", "refine_paint"},
    "seeds": {"contest"},
    "start": {"start", "formats"},
    "start_paint": {"start_paint", "formats"},
}
"""Stages that a chain is here for."""


def stop_in(door: Door, stage: str, number: signal.Signals, **variables: str) -> bool:
    """Start the command and send a signal to all its processes in that stage, in a training once it has a
    checkpoint. Return whether the stage was reached, which it is not where it has ended before."""
    with subprocess.Popen(
        door.command("run", **variables),
        cwd=door.folder,
        env=door.environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # tests in the background ignore it
    ) as process:
        assert process.stderr is not None
        said = []
        for line in process.stderr:
            said.append(line)
            if line.startswith(f"{stage} ..."):
                _wait_for_checkpoint(door.folder / variables["OUT"], stage)
                os.killpg(process.pid, number)
                rest = process.communicate()[1]
                assert "Traceback" not in rest
                if number == signal.SIGINT and process.returncode:
                    assert "the same command goes on from here" in rest
                return True
        assert process.wait() == 0, "".join(said)
    return False


def _wait_for_checkpoint(out: Path, stage: str) -> None:
    """Wait until a training has written a state, two seconds at most; other stages have none."""
    for _ in range(200 if STAGES[stage].training else 0):
        if list(out.glob(f"*/checkpoints/{stage}/*.checkpoint")):
            return
        time.sleep(0.01)


def made(run: Path) -> dict[str, str]:
    """Return the sha256 of everything that was made and does not tell the time."""
    manifest = json.loads((run / "manifest.json").read_text())
    names = [name for name in manifest["files"] if not name.endswith((".json", ".html"))]
    assert "asset.glb" in names
    return {name: file_sha256(run / name) for name in names}


@pytest.mark.parametrize(
    "chain", ["text", *(pytest.param(name, marks=pytest.mark.thorough) for name in CHAINS if name != "text")]
)
@pytest.mark.parametrize("first", [0, pytest.param(1, marks=pytest.mark.thorough)])
def test_stopped_in_every_stage(door: Door, chain: str, first: int) -> None:
    signals = (signal.SIGKILL, signal.SIGINT)
    (door.folder / "cube.obj").write_text(CUBE)
    variables = CHAINS[chain]
    if "START" in variables:
        assert door.ask("run", OUT="first").status == 0
    answer = door.ask("run", OUT=f"whole-{chain}-{first}", **variables)
    assert answer.status == 0, answer.stderr
    whole = door.folder / Path(answer.stdout.splitlines()[-1]).parent
    stages = [line.removesuffix(" ...") for line in answer.stderr.splitlines() if line.endswith(" ...")]
    assert PECULIAR[chain] < {*stages}
    out = f"stopped-{chain}-{first}"
    for count, stage in enumerate(stages, first):
        stop_in(door, stage, signals[count % 2], OUT=out, **variables)
    answer = door.ask("run", OUT=out, **variables)
    assert answer.status == 0, answer.stderr
    assert made(whole.parents[1] / out / whole.name) == made(whole)
    assert door.ask("verify", RUN=f"{out}/latest").status == 0

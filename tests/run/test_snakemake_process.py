"""Snakemake as a process: the signals that reach it, and those that do not."""

import os
import signal
import time
from pathlib import Path

import pytest

from pipeline.run import snakemake_process


def test_a_signal_that_the_caller_ignores_stays_ignored() -> None:
    """As under nohup."""
    former = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with snakemake_process._termination_as_interrupt():
            os.kill(os.getpid(), signal.SIGHUP)
            with pytest.raises(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGTERM)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, former)


@pytest.mark.parametrize("obeys", [True, False])
def test_snakemake_may_call_off_its_jobs_before_it_ends(tmp_path: Path, obeys: bool) -> None:
    ready = tmp_path / "ready"
    process = os.fork()
    if process == 0:
        try:
            signal.signal(signal.SIGINT, signal.default_int_handler if obeys else signal.SIG_IGN)
            ready.touch()
            time.sleep(60)
        except KeyboardInterrupt:
            (tmp_path / "called off").touch()
        finally:
            os._exit(0)
    while not ready.exists():
        time.sleep(0.01)
    snakemake_process.end_snakemake(process, tmp_path / "no log", 30.0 if obeys else 0.2)
    assert (tmp_path / "called off").exists() == obeys
    with pytest.raises(ChildProcessError):
        os.waitpid(process, 0)

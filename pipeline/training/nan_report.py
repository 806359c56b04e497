"""What the user hears when a training meets a NaN or an infinity: where, what is kept, what to do."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import InputError
from pipeline.training import checkpoints


@contextmanager
def explained(stage: str, section: str, step: Callable[[], int], folder: Path) -> Iterator[None]:
    """Turn what stops a training into one line with the step and the checkpoint that is kept.

    Checkpoints hold only states that were found finite, so the newest one is the last good state. `section`
    names the stage's options, `step` gives the steps done, `folder` is that of the checkpoints.

    Raises:
        InputError: for a FloatingPointError, which names the tensor, and for an InputError (the denoiser's,
            which names the network and its timestep).
    """
    try:
        yield
    except FloatingPointError as error:
        raise InputError(
            f"{stage} stopped at step {step()}: {error}; {_kept(folder)}; lower {section}.learning_rate, set "
            f"{section}.gradient_clip, or try another SEED"
        ) from error
    except InputError as error:
        raise InputError(f"{stage} stopped at step {step()}: {error}; {_kept(folder)}") from error


def _kept(folder: Path) -> str:
    newest = checkpoints.newest(folder)
    if newest is None:
        return "there was no checkpoint yet"
    return f"the last good state, after step {int(newest.stem)}, is kept in {newest}"

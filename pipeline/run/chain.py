"""The one table of stages: what is known of each outside its own file. Everything that lists stages reads it.

A stage to add: a row here, its file in stages/, its options in options/, its cost in run/costs.py (a function
of its name), and its rule in a Snakefile, whose inputs and outputs say what it reads and writes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pipeline.options.job import Job
from pipeline.options.schema import plain


@dataclass(frozen=True)
class Stage:
    """One stage of a chain."""

    name: str
    options: tuple[str, ...]
    """What it may read of the job: these make up its key. It reads nothing else."""
    asked: Callable[[Job], bool] = lambda job: True
    """Whether a job has it."""
    optional: str = ""
    """What a run without it did not ask for; empty: nobody would miss it."""
    networks: tuple[str, ...] = ()
    """Graphs of the bundle that it opens, one after the other."""
    together: tuple[str, ...] = ()
    """And those that it opens at once."""
    training: str = ""
    """The section of its options that says how it trains."""
    warm: bool = True
    """Whether it is forked from a process that has imported torch, for which the first one would wait."""


_ENCODING = ("vae_encoder", "vae_decoder")
_REFINING = ("unet", "vae_encoder", "vae_encoder_vjp", "vae_decoder")

TEXT = (
    Stage(
        "embed",
        ("prompt", "negative", "token", "provider"),
        networks=("text_encoder", "vae_encoder"),
        warm=False,
    ),
    Stage("sketch", ("sketch_field",), lambda job: bool(job.sketch), "a sketch"),
    Stage(
        "start",
        ("seed", "prepare", "start_fit", "train_nerf", "provider"),
        lambda job: bool(job.start),
        together=_ENCODING,
    ),
    Stage(
        "contest",
        ("seed", "seeds", "contest", "train_nerf", "provider"),
        lambda job: job.seeds > 1,
        networks=("unet",),
        training="train_nerf",
    ),
    Stage(
        "train_nerf",
        ("seed", "start_fit", "strength", "train_nerf", "provider"),
        networks=("unet",),
        training="train_nerf",
    ),
    Stage(
        "refine",
        ("seed", "train_nerf", "refinement", "provider"),
        lambda job: job.refine,
        "refinement",
        together=_REFINING,
        training="refinement",
    ),
    Stage("extract", ("extract",)),
    Stage("clean", ("clean",)),
    Stage("unwrap", ("unwrap",)),
    Stage("bake", ("bake", "provider"), networks=("vae_decoder",)),
    Stage("publish", ("prompt", "publish")),
)
"""From a text to a mesh."""

PAINT = (
    TEXT[0],
    Stage("prepare", ("param", "prepare")),
    Stage(
        "start_paint",
        ("param", "seed", "prepare", "start_fit", "train_paint", "provider"),
        lambda job: bool(job.start),
        together=_ENCODING,
    ),
    Stage(
        "train_paint",
        ("param", "seed", "strength", "train_paint", "provider"),
        networks=("unet",),
        training="train_paint",
    ),
    Stage("bake_paint", ("bake_paint", "provider"), networks=("vae_decoder",)),
    Stage(
        "refine_paint",
        ("param", "seed", "train_paint", "refinement", "provider"),
        lambda job: job.refine,
        "refinement",
        together=_REFINING,
        training="refinement",
    ),
    Stage("publish_paint", ("prompt", "param", "publish")),
)
"""From a text and a mesh to that mesh with colours."""

FORMATS = Stage("formats", ("formats",), lambda job: bool(job.formats))
"""The same asset in other files, after either."""

REPORT = Stage(
    "report",
    ("prompt", "negative", "token", "model", "sketch", "refine", "mesh", "start", "seed", "seeds", "quality"),
)
"""The last stage of both."""

STAGES = {stage.name: stage for stage in (*TEXT, *PAINT, FORMATS, REPORT)}


def stages_of(job: Job) -> list[Stage]:
    """Return the stages of a job's chain in their order, without asking Snakemake, which takes a second."""
    chain = (*(PAINT if job.mesh else TEXT), FORMATS, REPORT)
    return [stage for stage in chain if stage.asked(job)]


def stage_options(job: Job, name: str) -> dict[str, Any]:
    """Return the part of the job that a stage depends on, as plain JSON values."""
    values = plain(job)
    return {option: values[option] for option in STAGES[name].options}

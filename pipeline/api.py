"""The Python interface: few functions that stay as they are from release to release.

    from pipeline.api import resolve, plan, run

    job = resolve("a red armchair", quality="draft")
    folder = run(job, "runs")                     # folder / "asset.glb"

What else `pipeline` holds may change with any release. Errors for the user are `InputError`, one line each.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.diffusion.graphs import usable_threads
from pipeline.diffusion.sessions import Denoise
from pipeline.errors import InputError
from pipeline.options import job as jobs
from pipeline.options.job import Job
from pipeline.options.models import DEFAULT_MODEL, bundle_folder
from pipeline.run import engine
from pipeline.run.costs import Cost
from pipeline.run.engine import StageFailure
from pipeline.run.plan import Step

if TYPE_CHECKING:  # they import torch, which takes seconds
    from pipeline.mesh.mesh import Mesh
    from pipeline.nerf.scene import Scene

__all__ = [
    "Bundle",
    "Cost",
    "Denoise",
    "InputError",
    "Job",
    "StageFailure",
    "Step",
    "field_mesh",
    "load_bundle",
    "plan",
    "resolve",
    "run",
    "train_field",
]


def resolve(prompt: str = "", file: str | Path = "", **options: Any) -> Job:
    """Return the complete job that is asked for: what `make run` makes of its variables.

    Args:
        prompt: what to make; may stand in `file` instead.
        file: a job file (YAML), which the rest wins over; "": none.
        options: as in a job file: ``seed=3``, ``quality="draft"``, ``mesh="fish.obj"``, and sections as
            mappings, ``clean={"faces": 5000}``.

    Raises:
        InputError: an unknown option, a value of the wrong type or out of range, a file that does not exist.
    """
    return jobs.resolve({"JOB": str(file), "PROMPT": prompt} if file else {"PROMPT": prompt}, options=options)


def plan(job: Job, out: str | Path = "runs") -> list[tuple[Step, Cost]]:
    """Return what `run` would do, a stage a row: run, reuse or leave it, why, in how much time and memory.
    Writes nothing.

    Raises:
        InputError: the model cannot work.
    """
    return engine.plan_run(job, Path(out))


def run(job: Job, out: str | Path = "runs", threads: int = 0, profile: str = "local") -> Path:
    """Make the asset and return the folder that holds it; what is there already is not made again.

    Progress goes to standard error. It starts processes of its own, and on Linux and macOS forks this one:
    call it where no other thread holds a lock, the main thread.

    Args:
        out: the folder that holds the runs' folders.
        threads: of a stage; 0: all cores.
        profile: where stages run: local, slurm, or a folder with a Snakemake profile.

    Raises:
        InputError: something that the caller can mend; nothing that was there is lost.
        StageFailure: a stage failed for another reason; the text names the log.
    """
    return engine.run_job(job, Path(out), threads or usable_threads(), profile)


def load_bundle(model: str = DEFAULT_MODEL, verify: bool = True) -> Bundle:
    """Return the description of a model, by name or by path, after checking its files.

    Args:
        verify: also compare every file's checksum.

    Raises:
        InputError: there is no such model, or a file is missing or damaged.
    """
    return open_bundle(bundle_folder(model), verify=verify)


class _Told(list[dict[str, Any]]):
    """A history that passes every row on."""

    def __init__(self, tell: Callable[[int, Mapping[str, Any]], None]) -> None:
        super().__init__()
        self.tell = tell

    def append(self, row: dict[str, Any]) -> None:
        """Keep a row, and tell of it."""
        super().append(row)
        self.tell(row["step"], row)


def train_field(
    job: Job, denoise: Denoise, on_step: Callable[[int, Mapping[str, Any]], None] = lambda step, metrics: None
) -> "Scene":
    """Return the field that a denoiser of the caller's own trains, with the options and the texts of a job.

    Args:
        job: from `resolve`; its model gives the text encoder and the schedule of noise.
        denoise: (noisy latents (n, c, h, w), timesteps (n,), text (n, l, d)) -> the prediction (n, c, h, w)
            that the schedule's `prediction_type` says, float32. Half of the rows have the negative text.
        on_step: told after every step, by number, what was measured.

    Raises:
        InputError: the model cannot work, or the job has a sketch or a mesh, which this does not take.
        FloatingPointError: the denoiser returned a NaN or an infinity.
    """
    import torch

    from pipeline.diffusion.schedule import load_schedule
    from pipeline.diffusion.sessions import text_encoder
    from pipeline.diffusion.tokenizer import load_tokenizer
    from pipeline.diffusion.view_gradient import Embeddings, distillation_gradient, flat_backgrounds
    from pipeline.nerf.step import initial_state
    from pipeline.nerf.train import train
    from pipeline.stages.embed import embed_texts, prepare_texts

    if job.sketch or job.mesh:
        raise InputError("train_field takes no sketch and no mesh: leave them out of the job")
    bundle = load_bundle(job.model, verify=False)
    tokenizer = load_tokenizer(bundle.path / "tokenizer")
    texts = prepare_texts(job.prompt, job.negative, tokenizer, bundle.view_prompts, bundle.known_words)
    with text_encoder(bundle.path / "text_encoder", provider=job.provider) as encode_text:
        rows = embed_texts([*texts.views, texts.negative], tokenizer, encode_text)
    embeddings = Embeddings(rows[:-1], rows[-1], bundle.view_prompts, None)
    torch.manual_seed(job.seed)
    options, history = job.train_nerf, _Told(on_step)
    state = initial_state(options, flat_backgrounds(embeddings), job.seed)
    schedule = load_schedule(bundle.path / "scheduler")
    view_gradient = distillation_gradient(denoise, schedule, embeddings, options)
    train(state, history, options, options.resolution or bundle.latent_size, view_gradient)
    return state.scene


def field_mesh(scene: "Scene", job: Job) -> "Mesh":
    """Return the surface of a field as a triangle mesh in scene units, cleaned as the job says."""
    from pipeline.stages.clean import clean_mesh
    from pipeline.stages.extract import scene_surface

    raw, _ = scene_surface(scene, job.extract)
    return clean_mesh(raw, job.clean.faces, job.clean.smoothing, job.clean.min_component)[0]

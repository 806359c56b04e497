"""What the work of each stage costs: seconds and memory, by what the options ask for; a function a stage.

Each figure is a constant plus work times a rate, fitted to runs of the default bundle on two Zen 5 cores and
on two threads of a Zen 3 core.
"""

from typing import NamedTuple

from pipeline.diffusion.bundle import STABLE_DIFFUSION_LATENTS
from pipeline.options.asset import Bake
from pipeline.options.distillation import Distillation
from pipeline.options.job import Job
from pipeline.options.nerf import TrainNerf
from pipeline.options.paint import BakePaint
from pipeline.options.start import set_out, started


class Cost(NamedTuple):
    """Of a stage."""

    seconds: float
    memory_mb: float


class Work(NamedTuple):
    """What costs depend on."""

    job: Job
    latent_size: int
    """Side of the bundle's latents."""
    denoiser_mb: float
    """Its weights, which stand for its work; larger where the machine multiplies slowly."""


def denoiser_work(options: Distillation, work: Work) -> float:
    """Return the work of the denoiser in one step: megabytes of weights times passes times relative area."""
    passes = 1 if options.guidance_scale == options.guidance_scale_end == 1 else 3 if options.perp_neg else 2
    return options.cameras_per_step * passes * work.denoiser_mb * (work.latent_size / 32) ** 2


def embed(work: Work) -> Cost:
    """Of some texts and backgrounds."""
    return Cost(0.2, 0.0)


def sketch(work: Work) -> Cost:
    """Of the lattice."""
    cells = work.job.sketch_field.cells**3
    return Cost(0.3 + 6e-6 * cells, 1e-4 * cells)


def _encoding(work: Work) -> float:
    """Return the seconds of encoding the views of a start."""
    return work.job.start_fit.views * 2.6e-5 * work.latent_size**2


def start(work: Work) -> Cost:
    """Of encoding views and the fit to them."""
    train = work.job.train_nerf
    samples = train.cameras_per_step * work.latent_size**2 * train.samples_per_ray
    fit = work.job.start_fit.steps * (0.02 + 6e-8 * samples)
    return Cost(1.0 + _encoding(work) + fit, 150 + 4e-4 * samples)


def start_paint(work: Work) -> Cost:
    """Of the views' weights, their encoding and the least squares."""
    views = work.job.train_paint.views
    return Cost(
        2.0 + 2e-4 * views * work.latent_size + _encoding(work), 150 + 3e-4 * views * work.latent_size**2
    )


def _distilling(train: TrainNerf, work: Work, steps: float) -> Cost:
    """Of so many steps of rendering and the denoiser."""
    samples = train.cameras_per_step * (train.resolution or work.latent_size) ** 2 * train.samples_per_ray
    update = 0.02 + 6e-8 * samples
    step = train.updates_per_call * update + 1.5e-4 * denoiser_work(train, work)
    return Cost(steps * step, 150 + 4e-4 * samples)


def contest(work: Work) -> Cost:
    """Of the beginning of every seed."""
    job = work.job
    return _distilling(job.train_nerf, work, job.seeds * (job.contest.share * job.train_nerf.steps + 3))


def train_nerf(work: Work) -> Cost:
    """Of the steps that are left."""
    train = work.job.train_nerf
    if work.job.start:
        train = started(train, work.job.start_fit, work.job.strength)
    done = work.job.contest.share if work.job.seeds > 1 else 0.0
    return _distilling(train, work, (1 - done) * train.steps)


def _refinement(work: Work) -> tuple[float, float, int]:
    """Return the seconds of a step of refinement and of the fit before it, and the side of its views: half
    of an image of four pixels a latent."""
    refine = work.job.refinement
    side = refine.resolution or min(2 * work.latent_size, 128)
    samples = refine.cameras_per_step * side**2 * work.job.train_nerf.samples_per_ray
    # The encoder and its gradient, or the decoder: as much as decoding, twice.
    pictures = refine.cameras_per_step * 1.8e-5 * 2 * work.latent_size**2
    return (
        8.4e-8 * samples + 1.26e-4 * denoiser_work(refine, work) + pictures,
        1.2e-7 * samples + pictures,
        side,
    )


def refine(work: Work) -> Cost:
    """Of the fit and of distillation in RGB."""
    step, fit, side = _refinement(work)
    refine = work.job.refinement
    samples = refine.cameras_per_step * side**2 * work.job.train_nerf.samples_per_ray
    return Cost(refine.steps * step + refine.fit_steps * fit, 150 + 4e-4 * samples)


def extract(work: Work) -> Cost:
    """Of the lattice and the views."""
    cells = work.job.extract.resolution**3
    return Cost(6e-7 * cells + 0.02 * work.job.extract.views, 50 + 2e-5 * cells)


def clean(work: Work) -> Cost:
    """Of decimation, and of the diffusion of normals, whose steps are as many as its faces are small."""
    options = work.job.clean
    faces = max(40_000, 2 * options.faces)
    steps = min(1.2 * options.denoise**2 * faces, 2000)
    return Cost(0.7 + 7.5e-5 * options.faces + 4.5e-8 * steps * faces, 0.0)


def unwrap(work: Work) -> Cost:
    """Of xatlas."""
    faces = work.job.clean.faces
    return Cost(0.4 + 1.9e-6 * faces**1.5, 4e-3 * faces)


def _baking(options: Bake | BakePaint, latent_size: int) -> Cost:
    # A latent pixel stands for eight of the picture where these are large.
    large = latent_size >= STABLE_DIFFUSION_LATENTS
    views = min(options.views, options.large_views) if large else options.views
    view_resolution, texture = options.view_resolution, options.texture
    texels, side = texture**2, view_resolution or max(latent_size, 64)
    return Cost(views * (1.8e-5 * side**2 + 3e-8 * texels), 50 + 1e-4 * texels)


def bake(work: Work) -> Cost:
    """Of decoding and projecting the views."""
    return _baking(work.job.bake, work.latent_size)


def bake_paint(work: Work) -> Cost:
    """Of decoding and projecting the views."""
    return _baking(work.job.bake_paint, work.latent_size)


def publish_paint(work: Work) -> Cost:
    """Of the turntable."""
    options = work.job.publish
    return Cost(0.8 + 2e-7 * options.turntable_frames * options.turntable_size**2, 0.0)


def publish(work: Work) -> Cost:
    """Of the turntable and the levels of detail."""
    return Cost(publish_paint(work).seconds + 5e-5 * work.job.clean.faces, 0.0)


def formats(work: Work) -> Cost:
    """Of all of them; a surface that has to be closed first takes some seconds more."""
    return Cost(1.0 + 4e-5 * work.job.clean.faces, 0.0)


def prepare(work: Work) -> Cost:
    """Of texture coordinates for a mesh of middling size."""
    return Cost(3.0, 50.0)


def train_paint(work: Work) -> Cost:
    """Of the views' weights and the denoiser."""
    paint = work.job.train_paint
    if work.job.start:
        paint = set_out(paint, work.job.strength)
    side = paint.resolution or work.latent_size
    seconds = 0.5 + 2e-4 * paint.views * side + paint.steps * (0.002 + 1.26e-4 * denoiser_work(paint, work))
    return Cost(seconds, 150 + 3e-4 * paint.views * side**2)


def refine_paint(work: Work) -> Cost:
    """Of the views' weights and distillation in RGB."""
    step, _, side = _refinement(work)
    views = work.job.train_paint.views
    return Cost(0.5 + 2e-4 * views * side + work.job.refinement.steps * step, 150 + 3e-4 * views * side**2)


def report(work: Work) -> Cost:
    """Of the page."""
    return Cost(0.3, 0.0)

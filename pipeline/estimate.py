"""What a stage will cost, before it runs: seconds and peak memory on two ordinary cores.

Each figure is a constant plus the work that the options ask for times a rate, measured with the default
bundle on two Zen 5 cores.
"""

from typing import NamedTuple

from pipeline.job import Job

START = 1.5
"""Python, its libraries and, at first, compiled kernels [seconds a stage]."""
BASE_MB = 450.0
"""Python with torch [MiB]."""


class Cost(NamedTuple):
    seconds: float
    memory_mb: float


def estimate(stage: str, job: Job, latent_size: int, denoiser_megabytes: float) -> Cost:
    """Return what a stage costs; `denoiser_megabytes` is the size of the UNet's files: its pace."""
    train, views = job.train_nerf, job.bake.view_resolution or max(latent_size, 64)
    side = train.resolution or latent_size
    samples = train.cameras_per_step * side**2 * train.samples_per_ray
    passes = train.cameras_per_step * (
        1 if train.guidance_scale == 1 and train.guidance_scale_end in (0, 1) else 2
    )
    denoiser = passes * denoiser_megabytes * (latent_size / 32) ** 2
    texels, faces = job.bake.texture**2, job.clean.faces
    cells = job.extract.resolution**3
    frames = job.publish.turntable_frames * job.publish.turntable_size**2
    costs = {
        "embed": Cost(0.2, 0.0),
        "sketch": Cost(0.3 + 6e-6 * job.sketch_field.cells**3, 1e-4 * job.sketch_field.cells**3),
        "train_nerf": Cost(train.steps * (8.4e-8 * samples + 1.26e-4 * denoiser), 150 + 4e-4 * samples),
        "extract": Cost(2e-7 * cells + 0.04 * job.extract.views, 50 + 2e-5 * cells),
        "clean": Cost(0.7 + 7.5e-5 * faces, 0.0),
        "unwrap": Cost(0.4 + 2e-4 * faces, 0.0),
        "bake": Cost(job.bake.views * (0.02 + 1.8e-5 * views**2), 50 + 1e-4 * texels),
        "publish": Cost(0.8 + 2e-7 * frames, 0.0),
        "report": Cost(0.3, 0.0),
    }
    cost = costs[stage]
    return Cost(START + cost.seconds, BASE_MB + cost.memory_mb)


def available_memory_mb() -> float | None:
    """Return the memory that programs can still take [MiB], or None where the system does not say."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            figures = dict(line.split(":", 1) for line in lines)
        return int(figures["MemAvailable"].split()[0]) / 1024
    except (OSError, KeyError, ValueError, IndexError):
        return None

"""What a stage will cost, before it runs: seconds and peak memory on two ordinary cores.

Each figure is a constant plus the work that the options ask for times a rate, measured with the default
bundle on two Zen 5 cores.
"""

from typing import NamedTuple

from pipeline.job import Job

START = 3.0
"""Python, its libraries and, at first, compiled kernels [seconds a stage]."""
BASE_MB = 450.0
"""Python with torch [MiB]."""


class Cost(NamedTuple):
    seconds: float
    memory_mb: float


def estimate(stage: str, job: Job, latent_size: int, denoiser_megabytes: float) -> Cost:
    """Return what a stage costs; `denoiser_megabytes` is the size of the UNet's files: its pace."""
    train, views = job.train_nerf, job.bake.view_resolution or latent_size
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
        "embed": Cost(1.0, 0.2 * BASE_MB),
        "train_nerf": Cost(train.steps * (4.0e-7 * samples + 1.0e-4 * denoiser), 500 + 1.0e-3 * samples),
        "extract": Cost(3e-6 * cells + 0.1 * job.extract.views, 100 + 5e-5 * cells),
        "clean": Cost(2.0 + 1e-4 * faces, 300.0),
        "unwrap": Cost(1.0 + 2e-4 * faces, 100 + 5e-3 * faces),
        "bake": Cost(job.bake.views * (0.1 + 4e-5 * views**2), 200 + 1e-4 * texels),
        "publish": Cost(2.0 + 4e-7 * frames, 200.0),
        "report": Cost(0.5, 0.0),
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

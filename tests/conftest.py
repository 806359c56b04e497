"""Every typed function checks its shapes and types while the tests run."""

from hypothesis import settings
from jaxtyping import install_import_hook

import tests.checker  # noqa: F401 (the hook looks it up by name)

# Before any of them is imported. Compiled kernels take plain arrays and are left alone; a job checks itself,
# and the loop is generic in a way that beartype does not take.
CHECKED = [
    "cameras", "diffusion", "files", "formats", "mesh", "nerf", "paint", "report", "run", "sketch", "stages",
    "training.adam", "training.background", "training.batch", "training.checkpoints",
]  # fmt: skip
install_import_hook([f"pipeline.{name}" for name in CHECKED], "tests.checker.check")

settings.register_profile("no clock", deadline=None)  # a busy machine is no fault
settings.load_profile("no clock")

"""What pyproject.toml cannot say: the wheel carries the bundled model, as pipeline/onnx_models/."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

BUNDLED = Path("onnx_models", "everyday-objects")


class BuildWithModel(build_py):
    """Copies the model beside the package's modules; an editable installation finds it in the clone."""

    def run(self) -> None:
        """Build the modules, then copy the model."""
        super().run()
        if self.editable_mode:
            return
        if not (BUNDLED / "bundle.json").is_file():
            raise SystemExit(f"error: {BUNDLED}/bundle.json is missing: build the wheel in a clone")
        shutil.copytree(BUNDLED, Path(self.build_lib, "pipeline", BUNDLED), dirs_exist_ok=True)


setup(cmdclass={"build_py": BuildWithModel})

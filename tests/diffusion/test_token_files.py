"""Tensors that a learned token's file may hold, and what only looks like numbers."""

from pathlib import Path

import pytest
import torch

from pipeline.diffusion.token_files import read_token
from pipeline.errors import InputError

STRANGE = {
    "sparse": lambda: torch.ones(1, 16).to_sparse(),
    "nowhere": lambda: torch.ones(1, 16, device="meta"),
    "complex": lambda: torch.ones(1, 16, dtype=torch.complex64),
}


@pytest.mark.parametrize("name", STRANGE)
def test_tensors_that_are_no_plain_numbers_are_refused(name: str, tmp_path: Path) -> None:
    torch.save({"<c>": STRANGE[name]()}, tmp_path / "a.pt")
    with pytest.raises(InputError, match="expected plain floats"):
        read_token(tmp_path / "a.pt")


@pytest.mark.parametrize("shape", [(), (76, 4), (75, 10_000_000), (1, 0), (2, 2, 2)])
def test_shapes_are_seen_before_numbers_are_made(shape: tuple[int, ...], tmp_path: Path) -> None:
    torch.save(
        {"<c>": torch.zeros(()).expand(shape)}, tmp_path / "a.pt"
    )  # one number, as often as it is asked
    with pytest.raises(InputError, match="expected 1 to 75 embeddings"):
        read_token(tmp_path / "a.pt")


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float64, torch.int32])
def test_plain_numbers_of_any_kind_are_read(dtype: torch.dtype, tmp_path: Path) -> None:
    torch.save({"<c>": torch.arange(6).reshape(2, 3).to(dtype)}, tmp_path / "a.pt")
    assert read_token(tmp_path / "a.pt").vectors.tolist() == [[0, 1, 2], [3, 4, 5]]

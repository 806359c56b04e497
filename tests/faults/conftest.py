"""The door that all tests of this folder use."""

import pytest

from tests.faults.door import Door


@pytest.fixture(scope="session")
def door(tmp_path_factory: pytest.TempPathFactory) -> Door:
    """A door whose runs share what they can."""
    return Door(tmp_path_factory.mktemp("faults") / "it's {here}")

"""What every test runs under."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import gettempdir

import pytest
import torch
from hypothesis import configuration, settings
from hypothesis.internal.conjecture import providers
from hypothesis.internal.constants_ast import Constants

settings.register_profile("refracal", derandomize=True, deadline=None, database=None)
settings.load_profile("refracal")
configuration.set_hypothesis_home_dir(Path(gettempdir()) / "refracal-hypothesis")  # its tables of Unicode: not into the checkout
# It would draw constants from whatever modules of ours are loaded: others for each choice of tests and each worker.
setattr(providers, "_get_local_constants", Constants)  # noqa: B010


@pytest.fixture(autouse=True, scope="session")
def _own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What the terminal UI keeps for its person: not into the home of who runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(autouse=True, scope="session")
def _activated() -> Iterator[None]:
    """As in an activated virtual environment: what the commands say to type next begins with their bare names."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
        yield


@pytest.fixture(autouse=True, scope="session")
def _one_thread() -> None:
    """Small tensors: threads only cost time, most of all on a busy machine."""
    torch.set_num_threads(1)

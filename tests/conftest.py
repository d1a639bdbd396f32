"""What every test runs under."""

import pytest
import torch


@pytest.fixture(autouse=True, scope="session")
def _one_thread() -> None:
    """Small tensors: threads only cost time, most of all on a busy machine."""
    torch.set_num_threads(1)

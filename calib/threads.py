"""How many threads torch may use."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def single_thread() -> Iterator[None]:
    """Within, torch computes on one thread.

    A fit is thousands of operations of some microseconds each. Sharing one out over threads costs more than it saves, and on a
    busy machine ten times more than the operation.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)

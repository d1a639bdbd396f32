"""How many threads torch and scipy may use."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from threadpoolctl import threadpool_limits


@contextmanager
def single_thread() -> Iterator[None]:
    """Within, torch and scipy compute on one thread.

    A fit is thousands of operations of some microseconds each. Sharing one out over threads costs
    more than it saves, and on a busy machine ten to a hundred times more than the operation.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        torch.set_num_threads(before)

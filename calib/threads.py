"""The number of threads of torch and scipy."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from threadpoolctl import threadpool_limits


@contextmanager
def single_thread() -> Iterator[None]:
    """Limit torch and scipy to one thread within the context.

    A fit is thousands of operations of some microseconds each. Distributing one over threads costs
    more than it saves, and on a busy machine ten to a hundred times more than the operation.
    """
    previous_threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        torch.set_num_threads(previous_threads)

"""Slow libraries are loaded in the least time: what no command uses of them is left until it is
asked for, and nothing is collected.
"""

import gc
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import PackageNotFoundError, version
from types import ModuleType

TRIED = ("2.13.",)
"""Versions of torch that were seen to work so: any other is loaded as it comes."""
LATER = frozenset(
    {
        "numpy.f2py",
        "numpy.testing",
        "torch._decomp",
        "torch._meta_registrations",
        "torch._size_docs",
        "torch._storage_docs",
        "torch._tensor_docs",
        "torch.ao",
        "torch.distributed._meta_registrations",
        "torch.distributions",
        "torch.export",
        "torch.hub",
        "torch.masked",
        "torch.nn.intrinsic",
        "torch.nn.qat",
        "torch.nn.quantizable",
        "torch.nn.quantized",
        "torch.optim",
        "torch.profiler",
        "torch.quantization",
        "torch.utils.data",
    }
)
"""Of torch, what its import ends with and none of which is needed to compute with tensors: tracing
and compiling, tensors without data, quantised networks, distributions, what helps to train
networks, docstrings. Of numpy, what scipy takes, without using it, when it takes all.
"""


@contextmanager
def quickly() -> Iterator[None]:
    """For a command's imports.

    What they load stays until the process ends, so that no later collection goes through it.
    """
    if "torch" in sys.modules or not _is_tried():
        yield
        return
    collects = gc.isenabled()
    gc.disable()
    later = _Later()
    sys.meta_path.insert(0, later)
    try:
        yield
    finally:
        sys.meta_path.remove(later)
        if collects:
            gc.freeze()
            gc.enable()


def _is_tried() -> bool:
    try:
        return version("torch").startswith(TRIED)
    except PackageNotFoundError:
        return False


class _Later(MetaPathFinder, Loader):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        spec = PathFinder.find_spec(fullname, path, target) if fullname in LATER else None
        if spec:
            spec.loader_state, spec.loader = spec.loader, self
        return spec

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _Unread(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Nothing yet."""


class _Unread(ModuleType):
    """A module whose file is read as soon as something is asked of it."""

    def __getattr__(self, name: str) -> object:
        spec = self.__spec__
        if name.startswith("__") or spec is None:  # what is asked of every module there is
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        object.__setattr__(self, "__class__", ModuleType)
        spec.loader = self.__loader__ = spec.loader_state
        spec.loader.exec_module(self)
        return getattr(self, name)

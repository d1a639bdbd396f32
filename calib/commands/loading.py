"""A context that imports slow libraries faster: it defers modules that no command uses until
something reads their attributes, and it stops the garbage collector.
"""

import gc
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import PackageNotFoundError, version
from types import ModuleType

TESTED_VERSIONS = ("2.13.",)
"""The versions of torch that are tested with deferred modules. Any other is imported as usual."""
DEFERRED = frozenset(
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
"""The modules whose import is deferred. Those of torch are not needed to compute with tensors: they
trace and compile, hold tensors without data, quantise and train networks, sample distributions, or
add docstrings. scipy imports those of numpy and does not use them.
"""


@contextmanager
def fast_imports() -> Iterator[None]:
    """Import the modules of a command in this context.

    Their objects live until the process ends, so they are excluded from all further collections.
    """
    if "torch" in sys.modules or not _is_tested():
        yield
        return
    collects = gc.isenabled()
    gc.disable()
    finder = _DeferringFinder()
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
        if collects:
            gc.freeze()
            gc.enable()


def _is_tested() -> bool:
    try:
        return version("torch").startswith(TESTED_VERSIONS)
    except PackageNotFoundError:
        return False


class _DeferringFinder(MetaPathFinder, Loader):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        spec = PathFinder.find_spec(fullname, path, target) if fullname in DEFERRED else None
        if spec:
            spec.loader_state = spec.loader
            spec.loader = self
        return spec

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _DeferredModule(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Do nothing: `_DeferredModule` runs the file when something reads an attribute."""


class _DeferredModule(ModuleType):
    """A module whose file runs when something first reads one of its attributes."""

    def __getattr__(self, name: str) -> object:
        spec = self.__spec__
        if name.startswith("__") or spec is None:  # Python reads these of every module
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        object.__setattr__(self, "__class__", ModuleType)
        spec.loader = self.__loader__ = spec.loader_state
        spec.loader.exec_module(self)
        return getattr(self, name)
